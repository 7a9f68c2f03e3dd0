"""The SDF reader against models built by hand: random trees, in any of the format's spellings."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from sdf_texts import couplings

MOVING = ("revolute", "continuous", "prismatic", "screw", "ball", "fixed")


class Drawing:
    """A random tree: where everything is drawn, as text and as a Pinocchio model."""

    def __init__(self, seed: int, count: int = 8) -> None:
        self.rng = np.random.default_rng(seed)
        self.at = {"__model__": pin.SE3.Identity()}  # where each part is in the model
        self.parts: list[str] = []
        self.mimics: dict[str, tuple[str, float, float]] = {}  # leader, ratio, offset
        self.wMo = pin.SE3.Random()
        self.model = pin.Model()
        self.model.gravity.linear = self.rng.normal(size=3)
        self.carrier = {"l0": (0, self.wMo * self.link("l0"))}
        for k in range(1, count):
            self.joint(f"j{k}", f"l{self.rng.integers(k)}", f"l{k}")
            if self.rng.random() < 0.4:
                self.frame(f"f{k}", f"l{k}")

    def text(self) -> str:
        gravity = " ".join(map(repr, self.model.gravity.linear.tolist()))
        parts = list(self.parts)
        self.rng.shuffle(parts)
        return (
            f'<sdf version="1.11"><world name="w"><gravity>{gravity}</gravity><model name="drawn">'
            f"{self.pose(self.wMo, '')}{''.join(parts)}</model></world></sdf>"
        )

    def pose(self, M: pin.SE3, base: str) -> str:
        said = f' relative_to="{base}"' if base else ""
        p = " ".join(map(repr, M.translation.tolist()))
        turn = Rotation.from_matrix(M.rotation)
        form = self.rng.integers(3)
        if form == 0:
            words, said = turn.as_quat() * 1.1, said + ' rotation_format="quat_xyzw"'
        elif form == 1:
            words, said = turn.as_euler("xyz", degrees=True), said + ' degrees="true"'
        else:
            words = turn.as_euler("xyz")
        return f"<pose{said}>{p} {' '.join(map(repr, words.tolist()))}</pose>"

    def drawn(self, name: str, default: str) -> str:
        """Put a part somewhere, in a base that is drawn by then; return its pose."""
        base = str(self.rng.choice(list(self.at)))
        oMx = self.at[name] = pin.SE3.Random()
        return self.pose(self.at[base].actInv(oMx), "" if base == default else base)

    def link(self, name: str) -> pin.SE3:
        Y = pin.Inertia.Random()
        self.inertia, cMi = Y, pin.SE3(pin.SE3.Random().rotation, Y.lever)
        moments = cMi.rotation.T @ Y.inertia @ cMi.rotation
        entries = {f"i{'xyz'[i]}{'xyz'[j]}": moments[i, j] for i in range(3) for j in range(i, 3)}
        tensor = "".join(f"<{key}>{float(x)!r}</{key}>" for key, x in entries.items())
        self.parts.append(
            f'<link name="{name}">{self.drawn(name, "__model__")}<inertial>{self.pose(cMi, "")}'
            f"<mass>{Y.mass!r}</mass><inertia>{tensor}</inertia></inertial></link>"
        )
        return self.at[name]

    def frame(self, name: str, link: str) -> None:
        pose = self.drawn(name, link)
        self.parts.append(f'<frame name="{name}" attached_to="{link}">{pose}</frame>')

    def joint(self, name: str, parent: str, child: str) -> None:
        oMc = self.link(child)
        pose, kind = self.drawn(name, child), str(self.rng.choice(MOVING))
        axis, base = self.rng.normal(size=3), str(self.rng.choice(list(self.at)))
        a = self.at[name].rotation.T @ self.at[base].rotation @ (axis / np.linalg.norm(axis))
        pitch = float(self.rng.normal())  # metres in a turn
        i, iMp = self.carrier[parent]
        iMj = iMp * self.at[parent].actInv(self.at[name])
        made = {
            "revolute": lambda: pin.JointModelRevoluteUnaligned(a),
            "continuous": lambda: pin.JointModelRevoluteUnaligned(a),
            "prismatic": lambda: pin.JointModelPrismaticUnaligned(a),
            "screw": lambda: pin.JointModelHelicalUnaligned(a, pitch / (2 * np.pi)),
            "ball": pin.JointModelSpherical,
        }
        if kind != "fixed":
            i, iMj = self.model.addJoint(i, made[kind](), iMj, name), pin.SE3.Identity()
        jMc = self.at[name].actInv(oMc)
        self.carrier[child] = i, iMj * jMc
        if i:
            self.model.appendBodyToJoint(i, self.inertia, iMj * jMc)
        thread = f"<screw_thread_pitch>{pitch!r}</screw_thread_pitch>"
        if self.rng.random() < 0.5:
            thread = f"<thread_pitch>{-2 * np.pi / pitch!r}</thread_pitch>"
        words = " ".join(map(repr, axis.tolist()))
        self.parts.append(
            f'<joint name="{name}" type="{kind}">{pose}<parent>{parent}</parent>'
            f"<child>{child}</child>{thread if kind == 'screw' else ''}"
            f'<axis><xyz expressed_in="{base}">{words}</xyz>{self.mimic(name, kind)}</axis></joint>'
        )

    def mimic(self, name: str, kind: str) -> str:
        joints = zip(self.model.names, self.model.joints, strict=True)
        leaders = [j for j, joint in list(joints)[1:] if joint.nv == 1 and j != name]
        if kind in ("fixed", "ball") or not leaders or self.rng.random() < 0.5:
            return ""
        leader, (m, offset, reference) = str(self.rng.choice(leaders)), self.rng.normal(size=3)
        self.mimics[name] = leader, float(m), float(offset - m * reference)
        return (
            f'<mimic joint="{leader}"><multiplier>{float(m)!r}</multiplier>'
            f"<offset>{float(offset)!r}</offset><reference>{float(reference)!r}</reference></mimic>"
        )


@pytest.mark.parametrize("seed", range(12))
def test_a_random_tree_moves_as_one_built_by_hand(tmp_path, seed):
    from condyn_pin.io.sdf import read_sdf

    pin.seed(seed)
    drawing = Drawing(seed)
    path = tmp_path / "drawn.sdf"
    path.write_text(drawing.text())
    robot = read_sdf(path, root="l0")
    by_hand, model = drawing.model, robot.model
    assert sorted(by_hand.names) == sorted(model.names)
    assert robot.unmodelled == ()
    data, data_by_hand = model.createData(), by_hand.createData()
    rng = np.random.default_rng(seed)
    q = pin.randomConfiguration(by_hand, -np.ones(by_hand.nq), np.ones(by_hand.nq))
    v = rng.normal(size=by_hand.nv)
    order_q, order_v = [], []
    for name in list(model.names)[1:]:
        joint = by_hand.joints[by_hand.getJointId(name)]
        order_q += range(joint.idx_q, joint.idx_q + joint.nq)
        order_v += range(joint.idx_v, joint.idx_v + joint.nv)
    rest = pin.rnea(by_hand, data_by_hand, q, 0 * v, 0 * v)
    # column by column: crba needs joints that are depth-first
    M = np.column_stack(
        [pin.rnea(by_hand, data_by_hand, q, 0 * v, e) - rest for e in np.eye(by_hand.nv)]
    )[np.ix_(order_v, order_v)]
    np.testing.assert_allclose(np.triu(pin.crba(model, data, q[order_q])), np.triu(M), atol=1e-11)
    np.testing.assert_allclose(
        pin.nonLinearEffects(model, data, q[order_q], v[order_v]),
        pin.nonLinearEffects(by_hand, data_by_hand, q, v)[order_v],
        atol=1e-10,
    )
    found = {c.joint_a: (c.joint_b, c.ratio, c.offset) for c in couplings(robot)}
    assert found.keys() == drawing.mimics.keys()
    for name, (leader, ratio, offset) in drawing.mimics.items():
        assert found[name][0] == leader
        np.testing.assert_allclose(found[name][1:], (ratio, offset), rtol=1e-14)
