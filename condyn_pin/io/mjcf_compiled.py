"""MJCF that MuJoCo itself compiles, read from the arrays of its model.

MuJoCo places the inertia of body b in its principal axes c, with bRc from `body_iquat`:

    I = bRc · diag(body_inertia) · bRcᵀ      about `body_ipos`
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, MissingExtra
from condyn_pin.io.mjcf_equality import read_polynomial
from condyn_pin.io.mjcf_include import insert_includes, parse
from condyn_pin.io.mjcf_size import check_size
from condyn_pin.io.mjcf_types import Body, Closure, Description, End, Gear, Joint

KINDS = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint


def read_compiled(path: str | PathLike[str], reason: str) -> Description:
    """Return what a file says once MuJoCo has compiled it.

    Parameters
    ----------
    path : str or path
    reason : str
        What in the file needs this.

    Raises
    ------
    MissingExtra
        If MuJoCo is not installed; the text has the reason.
    InvalidModel
        If MuJoCo refuses the file.
    """
    mujoco = require_mujoco(f"{reason}, and only MuJoCo reads that")
    try:
        return _Compiled(mujoco, compiled(path)).description()
    except InvalidModel as error:
        error.args = (f"{reason}, so MuJoCo has to read it: {error}",)
        raise


def require_mujoco(reason: str) -> Any:
    """Return the module of MuJoCo, or raise MissingExtra with what it is needed for."""
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtra(f"{reason}: python -m pip install 'condyn_pin[mjcf]'") from error
    return mujoco


def compiled(path: str | PathLike[str]) -> Any:
    """Return the mujoco.MjModel of a file; without MuJoCo's own file of warnings.

    Raises
    ------
    MissingExtra
        If MuJoCo is not installed.
    InvalidModel
        If MuJoCo refuses the file, or a number in it is NaN.
    """
    mujoco, path = require_mujoco("only MuJoCo compiles an MJCF"), Path(path)
    if path.suffix == ".xml" and path.is_file():
        root = parse(path)
        insert_includes(root, path.parent)
        check_size(root, path.parent)
    warnings: list[str] = []
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)  # by itself it writes a file MUJOCO_LOG.TXT
    try:
        mj = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        raise InvalidModel(f"MuJoCo refuses: {' '.join(str(error).split())}") from error
    finally:
        mujoco.set_mju_user_warning(handler)
    if any("NaN" in warning for warning in warnings):
        raise InvalidModel("a number in it is NaN; finite numbers are needed")
    return mj


def body_names(mj: Any) -> list[str]:
    """Return the names of the bodies of a mujoco.MjModel, ``bodyK`` for those without."""
    return [mj.body(k).name or f"body{k}" for k in range(mj.nbody)]


def joint_names(mj: Any) -> list[str]:
    """Return the names of its joints, ``BODY_jointK`` for those without."""
    bodies = body_names(mj)
    names = []
    for k in range(mj.njnt):
        body = int(mj.jnt_bodyid[k])
        number = k - int(mj.body_jntadr[body])
        names.append(mj.joint(k).name or f"{bodies[body]}_joint{number or ''}")
    return names


class _Compiled:
    """A compiled model that is being read."""

    def __init__(self, mujoco: Any, mj: Any) -> None:
        self.mujoco, self.mj = mujoco, mj
        self.unused: list[str] = []
        self.bodies, self.joints = body_names(mj), joint_names(mj)

    def description(self) -> Description:
        mj = self.mj
        bodies = tuple(self._body(k) for k in range(mj.nbody))
        equalities = tuple(self._equalities())
        actuated = tuple(self._actuated())
        self.unused += self._unused()
        return Description(
            name=str(mj.names.split(b"\0", 1)[0].decode()),
            gravity=mj.opt.gravity * (not self._disabled("GRAVITY")),
            bodies=bodies,
            equalities=equalities,
            actuated=actuated,
            keyframes={mj.key(k).name or f"key{k}": mj.key_qpos[k].copy() for k in range(mj.nkey)},
            unused=tuple(self.unused),
        )

    def _disabled(self, what: str) -> bool:
        return bool(self.mj.opt.disableflags & getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{what}"))

    def _body(self, k: int) -> Body:
        mj = self.mj
        first, count = int(mj.body_jntadr[k]), int(mj.body_jntnum[k])
        R = _pose(mj.body_ipos[k], mj.body_iquat[k]).rotation
        inertia = pin.Inertia(
            float(mj.body_mass[k]), mj.body_ipos[k], R @ np.diag(mj.body_inertia[k]) @ R.T
        )
        sites = np.flatnonzero(mj.site_bodyid == k)
        return Body(
            name=self.bodies[k],
            parent=int(mj.body_parentid[k]),
            pose=_pose(mj.body_pos[k], mj.body_quat[k]),
            inertia=inertia if k and inertia.mass > 0 else None,
            joints=tuple(self._joint(j) for j in range(first, first + count)),
            sites={
                mj.site(s).name: _pose(mj.site_pos[s], mj.site_quat[s])
                for s in map(int, sites)
                if mj.site(s).name
            },
        )

    def _joint(self, j: int) -> Joint:
        mj = self.mj
        kind = KINDS[int(mj.jnt_type[j])]
        scalar = kind in ("slide", "hinge")
        at, dof = int(mj.jnt_qposadr[j]), int(mj.jnt_dofadr[j])
        lower, upper = mj.jnt_range[j] if scalar and mj.jnt_limited[j] else (-inf, inf)
        armature = float(mj.dof_armature[dof])
        if kind == "free" and armature:
            self.unused.append(f"armature of the free joint {self.joints[j]!r}")
            armature = 0.0
        return Joint(
            name=self.joints[j],
            kind=kind,
            point=np.zeros(3) if kind == "free" else mj.jnt_pos[j].copy(),
            axis=mj.jnt_axis[j].copy(),
            reference=float(mj.qpos0[at]) if scalar else 0.0,
            lower=float(lower),
            upper=float(upper),
            armature=armature,
            damping=0.0 if self._disabled("DAMPER") else float(mj.dof_damping[dof]),
            stiffness=0.0 if self._disabled("SPRING") else float(mj.jnt_stiffness[j]),
            rest=float(mj.qpos_spring[at]) if scalar else 0.0,
        )

    def _equalities(self) -> Iterator[Closure | Gear]:
        mj, types = self.mj, self.mujoco.mjtEq
        tags = {types.mjEQ_CONNECT: "connect", types.mjEQ_WELD: "weld", types.mjEQ_JOINT: "joint"}
        for k in range(mj.neq):
            tag = tags.get(self.mujoco.mjtEq(mj.eq_type[k]))
            name = mj.equality(k).name or f"{tag or 'equality'}{k}"
            if tag is None:
                self.unused.append(f"equality {name!r}, of another kind than connect, weld, joint")
            elif not mj.eq_active0[k] or self._disabled("EQUALITY"):
                self.unused.append(f"equality {name!r} is not active")
            elif tag == "joint":
                a, b = int(mj.eq_obj1id[k]), int(mj.eq_obj2id[k])
                joints = self.joints[a], self.joints[b] if b >= 0 else ""
                gear = read_polynomial(name, *joints, mj.eq_data[k, :5])
                if isinstance(gear, str):
                    self.unused.append(gear)
                else:
                    yield gear
            else:
                yield self._closure(k, tag, name)

    def _closure(self, k: int, tag: str, name: str) -> Closure:
        mj, data = self.mj, self.mj.eq_data[k]
        ids = int(mj.eq_obj1id[k]), int(mj.eq_obj2id[k])
        held = tag == "weld" and data[10] != 0  # else torquescale takes the turns off
        kind = "weld" if held else "ball"
        if int(mj.eq_objtype[k]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            first, second = (
                End(
                    self.bodies[mj.site_bodyid[s]],
                    _pose(mj.site_pos[s], mj.site_quat[s]),
                    mj.site(s).name,
                )
                for s in ids
            )
        elif tag == "connect":
            one, two = data[:3], data[3:6]
            first, second = (
                End(self.bodies[b], pin.SE3(np.eye(3), p))
                for b, p in zip(ids, (one, two), strict=True)
            )
        else:  # the anchor on body 2 comes first
            first = End(self.bodies[ids[0]], _pose(data[3:6], data[6:10]))
            second = End(self.bodies[ids[1]], pin.SE3(np.eye(3), data[:3]))
        return Closure(name, kind, (first, second))

    def _actuated(self) -> Iterator[str]:
        trn = self.mujoco.mjtTrn
        kinds = int(trn.mjTRN_JOINT), int(trn.mjTRN_JOINTINPARENT)
        for k in range(self.mj.nu):
            if int(self.mj.actuator_trntype[k]) in kinds:
                yield self.joints[self.mj.actuator_trnid[k, 0]]

    def _unused(self) -> Iterator[str]:
        """Say what the compiled model has beside bodies, joints, sites and equalities."""
        mj = self.mj
        counts = {
            "geoms, as bodies that touch": mj.ngeom,
            "actuators, but for their joints": mj.nu,
            "tendons": mj.ntendon,
            "flexible bodies": mj.nflex,
            "sensors": mj.nsensor,
            "joints with dry friction": np.count_nonzero(mj.dof_frictionloss),
            "bodies with gravity compensation": np.count_nonzero(mj.body_gravcomp),
            "mocap bodies, which stand still": mj.nmocap,
        }
        listed = [f"{n} {what}" for what, n in counts.items() if n]
        if listed:
            yield f"parts of the compiled model that are not read: {', '.join(listed)}"
        for poly in ("jnt_stiffnesspoly", "dof_dampingpoly"):
            if np.any(getattr(mj, poly, 0)):
                yield f"{poly}: springs and dampers are linear here"
        if mj.opt.density or mj.opt.viscosity or mj.opt.wind.any():
            yield "the medium around the bodies (density, viscosity, wind)"


def _pose(translation: Array, wxyz: Array) -> Any:
    w, x, y, z = np.array(wxyz) / np.linalg.norm(wxyz)
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(translation))
