"""What others make of a published file, beside a robot; with a reader of SDF of its own.

MuJoCo says M, h, springs and dampers, a, gaps of loops by `MujocoBridge.compare`; rows of loops and
couplings are compared here, all together, by their rank. Its own compiler reads MJCF and URDF, and
refuses inertias that no solid has: those of a URDF are put in afterwards.

An SDF is made a MuJoCo model by what it draws. That reader shares no line with `condyn_pin.io`, and
reads only what moves: links, joints, frames, models in models and includes beside the file. Every
part x has a pose in a base, so that oMx = oMbase baseMx; a joint is drawn on its child. A link that
no joint carries stands where it is drawn. Screws, merged includes and joints of the world are left
to other judges: `Unread`.
"""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import condyn_pin as cp
from condyn_pin._core._pin import dry_friction
from condyn_pin.constraints import Coupling, Loop
from condyn_pin.io.mjcf_file import compiled
from condyn_pin.io.xml import open_xml

Array = np.ndarray
PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # entries of a tensor

STATES, AGREES = 3, 1e-8  # measured: 2e-10 and better
OPEN = 1e-8  # of loops [m, rad]
NO_NUMBER = 1e9  # beyond it a limit is none


def compared(robot: cp.Robot, path: Path, model: str | None) -> tuple[str, float, list[str]]:
    """Return the judge, the worst difference of what agrees, and what differs."""
    if path.suffix == ".xml":
        try:
            return _beside_mujoco(robot, mujoco.MjModel.from_xml_path(str(path)), "MuJoCo")
        except ValueError:  # a mesh that only draws is not there
            return _beside_mujoco(robot, compiled(path)[0], "MuJoCo without lost meshes")
    try:
        if path.suffix == ".sdf":
            mj = Drawn(path, model or "").mujoco(robot.joints, robot.model.gravity.linear)
            return _beside_mujoco(robot, mj, "MuJoCo by published_sdf")
        return _beside_mujoco(robot, _urdf(robot, path), "MuJoCo")
    except (ValueError, KeyError, cp.CondynError) as error:
        raise Unread(" ".join(str(error).split())) from error


def _urdf(robot: cp.Robot, path: Path) -> Any:
    """Return MuJoCo's reading of a URDF, with a site and an equality for the ends of each loop."""
    spec = mujoco.MjSpec.from_string(_bare(path))
    links = {joint.get("name"): child.get("link", "") for joint in open_xml(path).iter("joint")
             if (child := joint.find("child")) is not None}  # fmt: skip
    for loop in robot.loops:
        if not (isinstance(loop, Loop) and loop.called in ("ball", "weld")):
            continue
        for frame in (loop.frame_a, loop.frame_b):
            body = links.get(frame, frame)
            if spec.body(body) is None:
                break
            spec.body(body).add_site(name=frame)
        else:
            welds = loop.called == "weld"
            made = spec.add_equality(
                name=loop.name, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=loop.frame_a,
                type=mujoco.mjtEq.mjEQ_WELD if welds else mujoco.mjtEq.mjEQ_CONNECT,
                name2=loop.frame_b,
            )  # fmt: skip
            made.data[10] = 1.0  # else turns stay free
    masses = {link.get("name", ""): link.find("inertial") for link in open_xml(path).iter("link")}
    heavy = {name: body for name in masses if (body := spec.body(name)) is not None}
    for body in heavy.values():
        stand_in(body)
    made = spec.compile()
    for name in heavy:
        weigh(made, name, *_inertial(masses[name]))
    mujoco.mj_setConst(made, mujoco.MjData(made))
    return made


def _inertial(element: ET.Element | None) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the mass of a link of a URDF, its pose (4, 4), and the tensor there (3, 3)."""
    said, mass = (None if element is None else element.find(tag) for tag in ("inertia", "mass"))
    if element is None or said is None or mass is None:
        return 0.0, np.eye(4), np.zeros((3, 3))
    origin = element.find("origin")
    pose = ET.Element("pose")
    if origin is not None:
        pose.text = f"{origin.get('xyz', '0 0 0')} {origin.get('rpy', '0 0 0')}"
    tensor = np.zeros((3, 3))
    for i, j in PRODUCTS:
        tensor[i, j] = tensor[j, i] = float(said.get(f"i{'xyz'[i]}{'xyz'[j]}", 0.0))
    return float(mass.get("value", 0.0)), moved(pose), tensor


def _beside_mujoco(robot: cp.Robot, mj: Any, judge: str) -> tuple[str, float, list[str]]:
    bridge = cp.study.MujocoBridge(robot, mj)
    worst, found, rng = 0.0, dict[str, str](), np.random.default_rng(0)
    for q in _configurations(robot, rng):
        v, tau = rng.normal(size=(2, robot.nv))
        check = bridge.compare(q, v, tau)
        terms = [term for term in check.terms if term.term != "J"]
        for term in terms:
            if term.error <= AGREES:
                worst = max(worst, term.error)
            else:
                text = f"{term.term} of {term.where}: {term.here} here, {term.there}"
                found.setdefault(term.term, text)
        found |= {cause: cause for cause in check.causes if "armature" in cause or "mass" in cause}
        if (robot.loops or mj.neq) and (said := _rows(robot, bridge, q)):
            if said.startswith("J"):
                found["J"] = said
            elif said not in judge:
                judge += f", {said}"
    return judge, worst, [*found.values(), *_bounds(robot, bridge)]


def _rows(robot: cp.Robot, bridge: Any, q: np.ndarray) -> str:
    """Return what differs between the rows of all equalities, as far as they can be compared."""
    scene = cp.Scene(robot, robot.loops)
    work, mj = cp.Workspace(scene), bridge.model
    data = mujoco.MjData(mj)
    data.qpos[:], _ = bridge.to_mujoco(q, np.zeros(robot.nv))
    mujoco.mj_forward(mj, data)
    J = np.zeros((data.nefc, mj.nv))
    if mujoco.mj_isSparse(mj):
        mujoco.mju_sparse2dense(J, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr,
                                data.efc_J_colind)  # fmt: skip
    else:
        J[:] = data.efc_J.reshape(-1, mj.nv)
    ties = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    theirs, ours = J[ties] @ bridge.velocity_map(q), work.jacobian(q)
    if np.abs(work.violation(q)).max(initial=0.0) > OPEN:
        return "loops open, rows not judged"
    if len(ours) and not len(theirs):
        return "loops not judged"
    if np.abs(data.efc_pos[ties]).max(initial=0.0) > 10 * OPEN:
        return f"J: closed here, open by {np.abs(data.efc_pos[ties]).max():.2g} in MuJoCo"
    ranks = [int(np.linalg.matrix_rank(rows, tol=1e-7 * max(np.abs(rows).max(initial=0.0), 1e-9)))
             for rows in (ours, theirs, np.vstack((ours, theirs)))]  # fmt: skip
    return (
        "" if len(set(ranks)) == 1 else "J has rank {} here, {} in MuJoCo, {} both".format(*ranks)
    )


def _bounds(robot: cp.Robot, bridge: Any) -> list[str]:
    """Return limits and dry friction that are not those of MuJoCo; tendons may narrow ours."""
    mj, found, narrower = bridge.model, [], bridge.model.ntendon > 0
    friction = dry_friction(robot.model)
    for pair in bridge.pairs:
        if pair.kind not in ("hinge", "slide"):
            continue
        theirs = [-np.inf, np.inf]
        if mj.jnt_limited[pair.there]:
            theirs = [x if abs(x) < NO_NUMBER else s * np.inf for x, s in zip(
                mj.jnt_range[pair.there], (-1, 1), strict=True)]  # fmt: skip
        if pair.q.stop - pair.q.start == 1:
            ends = (robot.model.lowerPositionLimit, robot.model.upperPositionLimit)
            ours = [float(end[pair.q.start]) for end in ends]
            ours = [x if abs(x) < NO_NUMBER else np.sign(x) * np.inf for x in ours]
            inside = narrower and ours[0] >= theirs[0] and ours[1] <= theirs[1]
            fixed = ours[0] == ours[1] and not mj.jnt_limited[pair.there]
            if not (inside or fixed or np.allclose(ours, theirs, rtol=1e-9, atol=1e-9)):
                found.append(f"limits of {pair.name}: {ours} here, {theirs}")
        rubs = float(mj.dof_frictionloss[pair.dof.start])
        if abs(friction[pair.v.start] - rubs) > 1e-12 and not narrower:
            found.append(f"friction of {pair.name}: {friction[pair.v.start]} here, {rubs}")
    return found


def _configurations(robot: cp.Robot, rng: np.random.Generator) -> list[np.ndarray]:
    """Return random q on the loops; where they cannot be closed, q off them."""
    found, start = [], robot.postures.get("qpos0", pin.neutral(robot.model))
    for _ in range(STATES):
        q = pin.integrate(robot.model, start, rng.normal(size=robot.nv))
        if robot.loops:
            with contextlib.suppress(cp.CondynError):
                q = cp.Scene(robot, robot.loops).sample(rng)[0]
        found.append(q)
    return found


def _bare(path: Path) -> str:
    """Return a URDF without shapes and without what else MuJoCo would read."""
    root = open_xml(path)
    for element in [root, *root.iter("link")]:
        for tag in ("visual", "collision", "transmission", "gazebo", "mujoco"):
            for part in element.findall(tag):
                element.remove(part)
    settings = {"fusestatic": "false", "inertiafromgeom": "false"}
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", settings)
    return ET.tostring(root, encoding="unicode")


def sums(robot: cp.Robot, path: Path, why: str) -> tuple[str, float, list[str]]:
    """Return how masses and gravity compare with the numbers in the file."""
    judge = f"sums; {why[:60]}"
    if path.suffix == ".xml":
        return judge, 0.0, []
    links = [link for link in open_xml(path).iter("link") if "name" in link.attrib]
    masses = [float((m.get("value") or m.text or "0") if (m := x.find("inertial/mass")) is not None
                    else path.suffix == ".sdf") for x in links]  # fmt: skip
    if path.suffix == ".sdf" and len(list(open_xml(path).iter("model"))) > 1:
        return judge, 0.0, []  # which of them are the robot's, that reader did not find
    off = abs(sum(Y.mass for Y in robot.model.inertias) - sum(masses)) / max(sum(masses), 1.0)
    return judge, off, [f"mass by {off:.1e}"] if off > 1e-9 else []


def mimics(robot: cp.Robot, path: Path) -> list[str]:
    """Return couplings that are not those of the file."""
    wanted = Counter(
        (
            joint.get("name"),
            m.get("joint"),
            float(m.get("multiplier", 1)),
            float(m.get("offset", 0)),
        )
        for joint in open_xml(path).findall("joint")
        if (m := joint.find("mimic")) is not None and joint.get("type") != "fixed"
    )
    had = Counter((c.joint_a, c.joint_b, c.ratio, c.offset)
                  for c in robot.loops if isinstance(c, Coupling))  # fmt: skip
    return [f"mimic {one}" for one in (wanted - had)]


# --- SDF

HINGES = ("revolute", "continuous")
SERIES = ("universal", "revolute2")


class Unread(Exception):
    """What this reader has no judge for."""


class Part(NamedTuple):
    """A link, joint, frame or model: its element, the names around it, the axes of old files."""

    element: ET.Element
    scope: str
    old: bool  # before 1.5 axes were those of the model


def stand_in(body: Any) -> None:
    """Let a body of a mujoco.MjSpec weigh anything, off its axes, lest it is compiled as simple."""
    body.mass, body.inertia, body.explicitinertial = 1.0, np.ones(3), True
    body.fullinertia[:] = np.nan
    body.ipos, body.iquat = np.ones(3), np.full(4, 0.5)


def weigh(made: Any, name: str, mass: float, M: Array, tensor: Array) -> None:
    """Give a body of a mujoco.MjModel a mass and a tensor at M, also those the compiler refuses."""
    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] *= np.linalg.det(axes)
    placed, k = M.copy(), made.body(name).id
    placed[:3, :3] = M[:3, :3] @ axes
    made.body_ipos[k], made.body_iquat[k] = _placed(placed).values()
    made.body_mass[k], made.body_inertia[k] = mass, moments


def moved(element: ET.Element | None) -> Array:
    """Return a pose, (4, 4)."""
    M = np.eye(4)
    if element is not None and (element.text or "").split():
        x = np.array((element.text or "").split(), dtype=float)
        turned = element.get("degrees", "false") in ("1", "true")
        quat = element.get("rotation_format") == "quat_xyzw"
        R = Rotation.from_quat(x[3:]) if quat else Rotation.from_euler("xyz", x[3:], degrees=turned)
        M[:3, :3], M[:3, 3] = R.as_matrix(), x[:3]
    return M


class Drawn:
    """One model of an SDF file, flat: parts by name, placed in the world."""

    def __init__(self, path: Path, model: str = "") -> None:
        root = open_xml(path)
        self.top, self.parts, self.placed = path.parent, dict[str, Part](), dict[str, Array]()
        worlds = [root, *root.findall("world")]
        found = [(m, p) for w in worlds for m, p in self._models(w, "", root.get("version", ""))]
        named = [m for m in found if (m[0].get("name") == model if model else not _static(m[0]))]
        if len(named) != 1:
            raise Unread(f"{len(named)} models")
        of_physics = root.get("version") in ("1.4", "1.5")
        where = "physics/gravity" if of_physics else "gravity"
        said = [w.findtext("gravity") or w.findtext(where) for w in worlds[1:]]
        self.world = bool(said)
        self.gravity = [float(x) for x in ((said[0] if said else "") or "0 0 -9.8").split()]
        (element, part), self.drawn = named[0], moved(named[0][1].element.find("pose"))
        self._flatten(element, "", part.old)

    def _models(
        self, owner: ET.Element, scope: str, said: str
    ) -> Iterator[tuple[ET.Element, Part]]:
        """Yield the models below an element, and what places each."""
        old = said in ("1.3", "1.4")
        for element in owner:
            if element.tag == "model":
                yield element, Part(element, scope, old)
            elif element.tag == "include":
                name = (element.findtext("uri") or "").strip().removeprefix("model://")
                file = self.top / name
                file = file / "model.sdf" if file.is_dir() else file
                if not file.is_file() and not scope and owner.tag != "model":
                    continue  # what stands around
                if element.get("merge") or not file.is_file():
                    raise Unread(f"include {name}")
                root = open_xml(file)
                (model,) = root.findall("model")
                model.set("name", (element.findtext("name") or model.get("name", "")).strip())
                placed = element if element.find("pose") is not None else model
                yield model, Part(placed, scope, root.get("version") in ("1.3", "1.4"))

    def _flatten(self, model: ET.Element, scope: str, old: bool) -> None:
        self.parts[f"{scope}__model__"] = Part(model, scope, old)
        for element in model:
            if element.tag in ("link", "joint", "frame"):
                name = scope + element.get("name", "")
                self.parts[name] = Part(element, scope, old)
        for inner, part in self._models(model, scope, "1.4" if old else ""):
            name = scope + inner.get("name", "")
            self.parts[name] = part
            self._flatten(inner, f"{name}::", part.old)

    def pose(self, name: str) -> Array:
        """Return the pose of a part in the world, (4, 4)."""
        if name in ("world", "__model__"):
            return np.eye(4) if name == "world" else self.drawn
        if name not in self.placed:
            if name.endswith("::__model__"):
                return self.pose(name.removesuffix("::__model__"))
            element, scope, _ = self.parts[name]
            pose = element.find("pose")
            said = None if pose is None else pose.get("relative_to") or pose.get("frame")
            if not said and element.tag in ("joint", "frame"):
                said = element.findtext("child") or element.get("attached_to")
            M = self.pose(scope + (said.strip() if said else "__model__")) @ moved(pose)
            posed = element.findtext("placement_frame") or element.get("placement_frame")
            if posed:
                self.placed[name] = M  # for a while, so that the frame is found in it
                at = np.linalg.inv(M) @ self.pose(f"{name}::{posed.strip()}")
                self.placed = {k: x for k, x in self.placed.items() if not k.startswith(name)}
                M = M @ np.linalg.inv(at)
            self.placed[name] = M
        return self.placed[name]

    def link(self, name: str) -> str:
        """Return the link that a link, a frame, a joint or a model is part of; "" for the world."""
        if name.split("::")[-1] == "world":
            return ""
        element, scope, _ = self.parts[name]
        if element.tag == "link":
            return name
        if f"{name}::__model__" in self.parts or name.endswith("__model__"):
            inner = "" if name == "__model__" else f"{name.removesuffix('::__model__')}::"
            model = self.parts[f"{inner}__model__"].element
            links = [link.get("name", "") for link in model.findall("link")]
            first = model.get("canonical_link") or links[0]
            return self.link(f"{inner}{first}")
        said = element.findtext("child") or element.get("attached_to") or "__model__"
        return self.link(scope + said.strip())

    def axis(self, name: str, tag: str) -> Array:
        """Return the direction of an axis of a joint in the world, (3,)."""
        element, scope, old = self.parts[name]
        axis = element.find(tag)
        if axis is None or axis.find("xyz") is None:
            raise Unread(f"{name} has no {tag}")
        xyz = axis.find("xyz")
        assert xyz is not None
        of_model = axis.findtext("use_parent_model_frame", str(int(old))).strip() in ("1", "true")
        base = xyz.get("expressed_in") or ("__model__" if of_model else "")
        a = self.pose(scope + base if base else name)[:3, :3] @ np.array(
            (xyz.text or "").split(), dtype=float
        )
        return np.asarray(a / np.linalg.norm(a))

    def mujoco(self, tree: Sequence[str], gravity: Array) -> Any:
        """Return the mujoco.MjModel; joints that move and are not in the `tree` close loops."""
        spec = mujoco.MjSpec()
        spec.option.gravity = self.gravity if self.world else gravity
        spec.compiler.degree = False
        bodies: dict[str, Any] = {"": spec.worldbody}
        at: dict[str, Array] = {"": np.eye(4)}
        joints = {n: p for n, p in self.parts.items() if p.element.tag == "joint"}
        ends = {n: self._ends(p) for n, p in joints.items()}
        in_tree = {
            n: e for n, e in ends.items()
            if n in tree or f"{n}_axis" in tree or joints[n].element.get("type") == "fixed"
        }  # fmt: skip
        waiting = [n for n, p in self.parts.items() if p.element.tag == "link"]
        carried = {e[1]: n for n, e in in_tree.items()}
        while waiting:
            ready = [x for x in waiting if x not in carried or in_tree[carried[x]][0] in bodies]
            if not ready:
                raise Unread("links in a circle")
            for name in ready:
                waiting.remove(name)
                how = carried.get(name, "")
                parent = in_tree[how][0] if how else ""
                M = np.linalg.inv(at[parent]) @ self.pose(name)
                at[name] = self.pose(name)
                bodies[name] = bodies[parent].add_body(name=name, **_placed(M))
                stand_in(bodies[name])
                for key, words in self._moves(how, joints) if how else ():
                    a = at[name][:3, :3].T @ words.pop("axis", np.eye(3)[2])
                    p = (np.linalg.inv(at[name]) @ self.pose(how))[:3, 3]
                    bodies[name].add_joint(name=key, axis=a, pos=p, **words)
        for name, (element, scope, _) in joints.items():
            kind, mimic = element.get("type", ""), element.find("axis/mimic")
            if mimic is not None:
                number = [float(mimic.findtext(k) or "nan") for k in ("multiplier", "offset")]
                zero = float(mimic.findtext("reference") or 0.0)
                offset = np.nan_to_num(number[1]) - number[0] * zero
                _couple(spec, name, scope + mimic.get("joint", ""), number[0], offset)
            if name in in_tree:
                continue
            elif kind == "gearbox":
                self._gear(spec, name, in_tree)
            else:
                self._close(spec, name, kind, *ends[name], bodies, at)
        made = spec.compile()
        for name in bodies:
            if name:
                self._weigh(made, name)
        mujoco.mj_setConst(made, mujoco.MjData(made))
        return made

    def _ends(self, part: Part) -> tuple[str, str]:
        words = [(part.element.findtext(tag) or "").strip() for tag in ("parent", "child")]
        parent, child = (self.link(x if x == "world" else part.scope + x) for x in words)
        return parent, child

    def _weigh(self, made: Any, name: str) -> None:
        """Give a body its mass and inertia, and what keeps gravity from it."""
        element = self.parts[name].element
        pose = element.find("inertial/pose")
        base = "" if pose is None else pose.get("relative_to", "")
        M = moved(pose)
        if base:
            M = np.linalg.inv(self.pose(name)) @ self.pose(self.parts[name].scope + base) @ M
        tensor = np.eye(3)
        for i, j in PRODUCTS:
            said = element.findtext(f"inertial/inertia/i{'xyz'[i]}{'xyz'[j]}")
            tensor[i, j] = tensor[j, i] = float(i == j) if said is None else float(said)
        weigh(made, name, float(element.findtext("inertial/mass") or 1.0), M, tensor)
        lifted = (element.findtext("gravity") or "1").strip() in ("0", "false")
        made.body_gravcomp[made.body(name).id] = lifted

    def _moves(self, name: str, joints: Mapping[str, Part]) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the names and words of MuJoCo's joints for one of the file."""
        element = joints[name].element
        kind = element.get("type", "")
        types = mujoco.mjtJoint
        if kind == "ball":
            yield name, {"type": types.mjJNT_BALL}
        elif kind in SERIES:
            for tag in ("axis", "axis2"):
                yield f"{name}_{tag}", self._word(name, tag, types.mjJNT_HINGE)
        elif kind in (*HINGES, "prismatic"):
            slides = kind == "prismatic"
            yield name, self._word(name, "axis", types.mjJNT_SLIDE if slides else types.mjJNT_HINGE)
        elif kind != "fixed":
            raise Unread(kind)

    def _word(self, name: str, tag: str, kind: Any) -> dict[str, Any]:
        axis = self.parts[name].element.find(tag)
        assert axis is not None
        said = {key: float(axis.findtext(path) or default) for key, path, default in (
            ("damping", "dynamics/damping", 0), ("frictionloss", "dynamics/friction", 0),
            ("stiffness", "dynamics/spring_stiffness", 0),
            ("springref", "dynamics/spring_reference", 0),
            ("lower", "limit/lower", -inf), ("upper", "limit/upper", inf),
        )}  # fmt: skip
        bounds = [max(said.pop("lower"), -1e16), min(said.pop("upper"), 1e16)]
        endless = self.parts[name].element.get("type") == "continuous"
        bounded = not endless and min(-bounds[0], bounds[1]) < 1e15 and bounds[0] < bounds[1]
        limited = {"limited": True, "range": bounds} if bounded else {}
        return {"type": kind, "axis": self.axis(name, tag), **said, **limited}

    def _gear(self, spec: Any, name: str, in_tree: Mapping[str, tuple[str, str]]) -> None:
        """Add theta_2 = -ratio theta_1, the angles of child and parent from the reference link."""
        part = self.parts[name]
        reference = self.link(part.scope + (part.element.findtext("gearbox_reference_body") or ""))
        hinges, signs = [], []
        for end, tag in zip(self._ends(part), ("axis", "axis2"), strict=True):
            hinge = next(n for n, e in in_tree.items() if set(e) == {reference, end})
            along = float(self.axis(name, tag) @ self.axis(hinge, "axis"))
            if abs(abs(along) - 1.0) > 1e-6:
                raise Unread("a gearbox of other axes than its hinges")
            signs.append(along * (1.0 if in_tree[hinge][0] == reference else -1.0))
            hinges.append(hinge)
        ratio = float(part.element.findtext("gearbox_ratio") or 1.0)
        _couple(spec, hinges[1], hinges[0], -ratio * signs[0] / signs[1], 0.0, name)

    def _close(
        self, spec: Any, name: str, kind: str, parent: str, child: str,
        bodies: Mapping[str, Any], at: Mapping[str, Array],
    ) -> None:  # fmt: skip
        """Add the equalities of a joint that closes a loop: a ball, or two points of a hinge."""
        if kind not in ("ball", *HINGES):
            raise Unread(f"{kind} in a loop")
        p = self.pose(name)[:3, 3]
        ends = {"": p} if kind == "ball" else {"": p, "_axis": p + self.axis(name, "axis")}
        for suffix, point in ends.items():
            made = spec.add_equality(
                name=name + suffix, type=mujoco.mjtEq.mjEQ_CONNECT, name1=parent or "world",
                name2=child, objtype=mujoco.mjtObj.mjOBJ_BODY,
            )  # fmt: skip
            made.data[:3] = (np.linalg.inv(at[parent]) @ np.r_[point, 1.0])[:3]


def _couple(
    spec: Any, follower: str, leader: str, ratio: float, offset: float, name: str = ""
) -> None:
    made = spec.add_equality(
        name=name or f"{follower}~{leader}", type=mujoco.mjtEq.mjEQ_JOINT, name1=follower,
        name2=leader, objtype=mujoco.mjtObj.mjOBJ_JOINT,
    )  # fmt: skip
    made.data[:2] = offset, ratio


def _static(model: ET.Element) -> bool:
    return (model.findtext("static") or "").strip() in ("1", "true")


def _placed(M: Array) -> dict[str, Any]:
    quat = Rotation.from_matrix(M[:3, :3]).as_quat()
    return {"pos": M[:3, 3], "quat": np.roll(quat, 1)}
