"""Read a robot from an MJCF file: MuJoCo compiles it, and its arrays become a Pinocchio tree.

MuJoCo places the inertia of body b in its principal axes c, with bRc from `body_iquat`:

    I = bRc · diag(body_inertia) · bRcᵀ      about `body_ipos`

`DrawnTree` says how joints move a body from where it is drawn. The configuration in which the file
draws the model is ``qpos0``: zero, but for joints with a `ref`. Quaternions are w x y z in MuJoCo
and x y z w here. The format: https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.polynomial import Polynomial

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin, set_dry_friction
from condyn_pin._core.arrays import Array
from condyn_pin._core.names import listed
from condyn_pin.constraints.base import WORLD, Constraint
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.held_joint import HeldJoint
from condyn_pin.constraints.loop import Loop, LoopKind
from condyn_pin.errors import InvalidModel
from condyn_pin.io.description import Description
from condyn_pin.io.mjcf_file import body_names, compiled, disabled, joint_names, require_mujoco
from condyn_pin.io.mjcf_transmissions import Transmissions, coefficients_of, driven
from condyn_pin.io.mjcf_unused import unmodelled, unused
from condyn_pin.io.xml import place
from condyn_pin.model.spring import Spring, SpringDamper
from condyn_pin.model.tree import DrawnJoint, DrawnTree

KINDS: Final = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint
DRAWN: Final = "qpos0"
_UNNAMED: Final = "MuJoCo Model"  # what MuJoCo calls it
_ROUNDING: Final = 1e-12  # of coefficients that cancel
_ONE: Final = np.array([1.0, 0.0, 0.0, 0.0])  # no turn, w x y z


def read_mjcf(path: str | PathLike[str]) -> Description:
    """Read an MJCF file into a Pinocchio model and its loops, the same with every Pinocchio.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    Description
        The model, its loops, couplings and held joints, motors, springs, the keyframes as postures
        (the last one is ``qpos0``, in which the file draws the model), and what is not modelled
        or not used.

    Raises
    ------
    InvalidModel
        The file cannot be read, or what it says cannot be made a model.
    MissingExtra
        MuJoCo is not installed.

    Notes
    -----
    A body, a site and a joint are frames of their names; where several share a name it is the
    body's, then the site's. A <connect> or <weld> without sites makes the frames ``NAME_a`` and
    ``NAME_b``. Loops are rigid here, whatever their solref and solimp.
    """
    with place(path):
        return _Reader(*compiled(path, "mujoco")).read()


class _Reader:
    """A compiled model that is being read."""

    def __init__(self, mj: Any, lost: Sequence[str]) -> None:
        self.mujoco, self.mj = require_mujoco("an MJCF is read by MuJoCo"), mj
        self.bodies, self.joints = body_names(mj), joint_names(mj)
        self.sites = [mj.site(s).name for s in range(mj.nsite)]
        for name in (*self.bodies[1:], *self.joints, *self.sites):
            if name in WORLD:
                raise InvalidModel(f"the name {name!r} is the world's; rename it")
        self.tree = DrawnTree(mj.names.split(b"\0", 1)[0].decode(), self.bodies)
        self.had = Transmissions(mj)
        self.unused, self.unmodelled = list(lost), list[str]()

    def read(self) -> Description:
        mj, tree = self.mj, self.tree
        tree.model.gravity.linear = mj.opt.gravity * (not disabled(mj, "GRAVITY"))
        for k in range(1, mj.nbody):
            self._add_body(k)
        for s, site in enumerate(self.sites):
            self._add_site(s, site)
        set_dry_friction(tree.model, self.had.friction)
        loops = tuple(self._equalities())
        motors = [self.joints[j] for j in driven(mj) if j is not None]
        scalar = {name for name, joint in tree.joints.items() if joint.scalar}
        springs = [Spring(self.joints[j], k, rest) for j, k, rest in self.had.springs]
        name = tree.model.name
        return Description(
            tree.model,
            loops=loops,
            actuated=tuple(dict.fromkeys(motors)),
            springs=tuple(spring for spring in springs if spring.joint in scalar),
            spring_dampers=tuple(
                SpringDamper(self._site_frame(a), self._site_frame(b), *values)
                for (a, b), *values in self.had.straight
            ),
            postures=self._postures(),
            unused=(*self.unused, *unused(mj, self.had)),
            unmodelled=(*self.unmodelled, *unmodelled(mj, self.had)),
            name="" if name == _UNNAMED else name,
        )

    def _add_body(self, k: int) -> None:
        mj = self.mj
        first, count = int(mj.body_jntadr[k]), int(mj.body_jntnum[k])
        R = _pose(mj.body_ipos[k], mj.body_iquat[k]).rotation
        about_centre = R @ np.diag(mj.body_inertia[k]) @ R.T
        inertia = pin.Inertia(float(mj.body_mass[k]), mj.body_ipos[k], about_centre)
        self.tree.add_body(
            self.bodies[k],
            self.bodies[mj.body_parentid[k]],
            _pose(mj.body_pos[k], mj.body_quat[k]),
            [self._joint(j) for j in range(first, first + count)],
            inertia if inertia.mass > 0 else None,
        )

    def _joint(self, j: int) -> DrawnJoint:
        mj, kind = self.mj, KINDS[int(self.mj.jnt_type[j])]
        scalar, dof = kind in ("slide", "hinge"), int(mj.jnt_dofadr[j])
        lower, upper = self.had.limits[j] if scalar else (-inf, inf)
        return DrawnJoint(
            self.joints[j],
            kind,
            axis=mj.jnt_axis[j].copy(),
            point=mj.jnt_pos[j].copy(),
            reference=float(mj.qpos0[mj.jnt_qposadr[j]]) if scalar else 0.0,
            lower=float(lower),
            upper=float(upper),
            # that of a free joint is along the axes of the world, which no Pinocchio joint has
            armature=0.0 if kind == "free" else float(self.had.armature[dof]),
            damping=float(self.had.damping[dof]),
        )

    def _add_site(self, s: int, site: str) -> None:
        if not site:
            return
        mj, name = self.mj, self._site_frame(s)
        if name != site:
            self.unused.append(f"the name of site {site!r}: a body has it; {name!r} here")
        body = self.bodies[mj.site_bodyid[s]]
        self.tree.mark(name, body, _pose(mj.site_pos[s], mj.site_quat[s]))

    def _site_frame(self, s: int) -> str:
        """Return the frame of a site, "" for one without a name."""
        site = self.sites[s]
        return f"{site}_site" if site in self.bodies else site

    def _equalities(self) -> Iterator[Constraint]:
        mj, off = self.mj, disabled(self.mj, "EQUALITY", "CONSTRAINT")
        for k in range(mj.neq):
            kind = self.mujoco.mjtEq(mj.eq_type[k]).name.removeprefix("mjEQ_").lower()
            name = mj.equality(k).name or f"{kind}{k}"
            if off or not mj.eq_active0[k]:
                self.unused.append(f"equality {name!r} is not active")
            elif kind in ("connect", "weld"):
                yield self._loop(k, kind, name)
            elif kind in ("joint", "tendon"):
                yield from self._row(k, kind, name)
            else:
                self.unmodelled.append(f"equality {name!r}, of the kind {kind}")

    def _row(self, k: int, kind: str, name: str) -> Iterator[Constraint]:
        """Yield an equality l1 - ref1 = p(l2 - ref2) of coordinates or fixed tendons.

        Each is a weighted sum of coordinates, l = w . q, or nothing.
        """
        mj, c = self.mj, self.mj.eq_data[k, :5].tolist()
        ends = [int(end[k]) for end in (mj.eq_obj1id, mj.eq_obj2id)]
        if ends[1] < 0:
            c[1:] = [0.0] * 4
        (w, ref1), (other, ref2) = (self._length(kind, end) for end in ends)
        if w is None or other is None:
            self.unmodelled.append(f"equality {name!r}, of tendons that are not fixed ones")
        elif any(c[2:]):
            yield from self._curve(name, c, (w, ref1), (other, ref2))
        else:
            for j, weight in other.items():
                w[j] = w.get(j, 0.0) - c[1] * weight
            least = _ROUNDING * max(map(abs, w.values()), default=0.0)
            tied = {self.joints[j]: x for j, x in w.items() if abs(x) > least}
            offset = float(ref1 + c[0] - c[1] * ref2)
            if len(tied) > 2:
                yield Coupling(tied, offset=offset, name=name)
            elif len(tied) == 2:
                (one, x), (two, y) = tied.items()
                yield Coupling(one, two, -y / x, offset / x, name=name)
            elif tied:
                ((joint, x),) = tied.items()
                yield HeldJoint(joint, offset / x, name=name)
            elif abs(offset) > _ROUNDING:
                self.unmodelled.append(f"equality {name!r}, which nothing can meet")

    def _curve(
        self,
        name: str,
        c: Sequence[float],
        first: tuple[Mapping[int, float], float],
        second: tuple[Mapping[int, float], float],
    ) -> Iterator[Coupling]:
        """Yield w1 q1 = ref1 + p(w2 q2 - ref2), of one joint on either side."""
        (w1, ref1), (w2, ref2) = first, second
        if not (len(w1) == len(w2) == 1 and w1.keys() != w2.keys()):
            who = listed([self.joints[j] for j in {**w1, **w2}])
            self.unmodelled.append(f"equality {name!r} couples {who} by a polynomial, polycoef {c}")
            return
        ((one, x),), ((two, y),) = w1.items(), w2.items()
        curve = (Polynomial(c)(Polynomial((-ref2, y))) + ref1) / x
        offset, ratio, *higher = map(float, curve.trim().coef)
        yield Coupling(self.joints[one], self.joints[two], ratio, offset, higher, name=name)

    def _length(self, kind: str, k: int) -> tuple[dict[int, float] | None, float]:
        """Return by joint how a coordinate or a tendon follows it, and how long it is drawn."""
        if k < 0:
            return {}, 0.0
        if kind == "joint":
            return {k: 1.0}, float(self.mj.qpos0[self.mj.jnt_qposadr[k]])
        return coefficients_of(self.mj, k), float(self.mj.tendon_length0[k])

    def _loop(self, k: int, tag: str, name: str) -> Loop:
        mj, data = self.mj, self.mj.eq_data[k]
        ids = int(mj.eq_obj1id[k]), int(mj.eq_obj2id[k])
        # without torquescale a weld leaves the turns free
        kind: LoopKind = "weld" if tag == "weld" and data[10] != 0 else "ball"
        if int(mj.eq_objtype[k]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            frames = [self._site_frame(s) for s in ids]
        else:
            # in a weld the anchor on body 2 comes first
            at = (data[:3], data[3:6]) if tag == "connect" else (data[3:6], data[:3])
            turns = (data[6:10] if kind == "weld" else _ONE), _ONE
            frames = [f"{name}_a", f"{name}_b"]
            for frame, body, p, wxyz in zip(frames, ids, at, turns, strict=True):
                self.tree.mark(frame, self.bodies[body], _pose(p, wxyz))
        return Loop(frames[0], frames[1], kind, name=name)

    def _postures(self) -> dict[str, Array]:
        """Return the keyframes, and last the configuration that is drawn."""
        mj, drawn = self.mj, self.tree.configuration()
        found = {}
        for k in range(mj.nkey):
            q = mj.key_qpos[k].copy()
            for joint in self.tree.model.joints[1:]:
                if joint.nq > joint.nv:
                    end = joint.idx_q + joint.nq
                    wxyz = q[end - 4 : end]
                    norm = np.linalg.norm(wxyz)
                    # zero is no rotation: MuJoCo reads it as 1 0 0 0, and files count on that
                    q[end - 4 : end] = np.roll(wxyz, -1) / norm if norm > 0 else np.eye(4)[3]
            found[mj.key(k).name or f"key{k}"] = q
        other = found.pop(DRAWN, drawn)  # the name is taken
        if np.abs(other - drawn).max(initial=0.0) > tolerances.DRAWN:
            self.unused.append(
                f"keyframe {DRAWN!r}: the pose in which the file draws the model has this name; "
                "rename it"
            )
        return found | {DRAWN: drawn}


def _pose(translation: Array, wxyz: Array) -> Any:
    w, x, y, z = np.array(wxyz) / np.linalg.norm(wxyz)
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(translation))
