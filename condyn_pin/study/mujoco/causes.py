"""Why two engines differ: what their models say of each joint and each body, side by side.

Joints are looked at from the root outwards. Where a joint stands elsewhere, all that it carries
does too: of that, only what does not depend on the place is compared, so that the first cause is
not followed by its consequences.

What a joint carries is, in MuJoCo, its body and all that is fixed to it:

    m = sum m_b,    m c = sum m_b c_b,    I = sum (R_b diag(I_b) R_b' + m_b (|d|^2 1 - d d')),
    d = c_b - c.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.io.mjcf import Transmissions
from condyn_pin.io.mjcf_file import body_names, disabled
from condyn_pin.io.mjcf_write import scalar_axis
from condyn_pin.study.mujoco.pairs import Pair, axes, holder

if TYPE_CHECKING:
    from condyn_pin.study.mujoco.mujoco_bridge import MujocoBridge


def causes(bridge: MujocoBridge, data: Any, q: Array, tolerance: float) -> tuple[str, ...]:
    """Return where the models differ, a sentence each, the root first.

    `data` is where MuJoCo has placed the bodies at q; the tolerance is relative.
    """
    return tuple(_Causes(bridge, data, q, tolerance).all())


class _Causes:
    """Both models at one configuration."""

    def __init__(self, bridge: MujocoBridge, data: Any, q: Array, tolerance: float) -> None:
        self.robot, self.model, self.mj = bridge.robot, bridge.robot.model, bridge.model
        self.pairs, self.data, self.tolerance = bridge.pairs, data, tolerance
        self.bodies, self.had = body_names(self.mj), Transmissions(self.mj)
        self.placed = whole_data(self.model)
        pin.forwardKinematics(self.model, self.placed, q)
        among = {pair.there: pair.here for pair in self.pairs}
        self.holders = [holder(self.mj, body, among) for body in range(self.mj.nbody)]
        # lengths are compared with the largest one in the robot [m], of a lone body with its own
        placements = (M.translation for M in tuple(self.model.jointPlacements)[1:])
        bodies = tuple(self.model.inertias)
        own = (np.sqrt(np.abs(Y.inertia).max() / Y.mass) for Y in bodies if Y.mass)
        lengths = (*placements, *(Y.lever for Y in bodies), *own)
        self.length = max(float(np.abs(x).max()) for x in lengths)

    def all(self) -> Iterator[str]:
        ours = self.model.gravity.linear
        theirs = self.mj.opt.gravity * (not disabled(self.mj, "GRAVITY"))
        if self._differ(ours, theirs):
            yield f"gravity: {_text(ours)} m/s^2 here, {_text(theirs)} in MuJoCo"
        displaced: set[int] = set()
        for pair in self.pairs:
            yield from self._joint(pair)
            elsewhere = self.model.parents[pair.here] in displaced
            moved = "" if elsewhere else self._place(pair) or self._zero(pair)
            carried = self._carried(pair, placed=not (elsewhere or moved))
            if moved:
                yield f"joint {pair.name}: {moved}; places of what it carries were not compared"
            if elsewhere or moved:
                displaced.add(pair.here)
            body = self.bodies[self.mj.jnt_bodyid[pair.there]]
            yield from (f"body {body} (joint {pair.name}): {said}" for said in carried)

    def _differ(self, ours: Any, theirs: Any, scale: float | None = None) -> bool:
        """Whether numbers differ by more than the tolerance of a scale, by default the largest."""
        if scale is None:
            scale = max(float(np.abs(ours).max()), float(np.abs(theirs).max()))
        return float(np.abs(np.subtract(ours, theirs)).max()) > self.tolerance * scale

    def _joint(self, pair: Pair) -> Iterator[str]:
        """Say what of a joint differs that does not depend on where it stands."""
        turns = pair.kind != "slide"
        springs = [(s.stiffness, s.reference) for s in self.robot.springs if s.joint == pair.name]
        k, rest = _together(springs)
        k_there, at = _together([(s, r) for j, s, r in self.had.springs if j == pair.there])
        for name, unit, ours, theirs in (
            (
                "armature", "kg m^2" if turns else "kg",
                self.model.armature[pair.v], self.had.armature[pair.dof],
            ),
            (
                "damping", "N m s/rad" if turns else "N s/m",
                self.model.damping[pair.v], self.had.damping[pair.dof],
            ),
            ("stiffness", "N m/rad" if turns else "N/m", k, k_there),
        ):  # fmt: skip
            if self._differ(ours, theirs):
                here, there = _text(_one(ours)), _text(_one(theirs))
                yield f"joint {pair.name}: {name} {here} {unit} here, {there} in MuJoCo"
        if k and k_there and abs(rest - at) > self.tolerance:
            text = f"{rest:.9g} {'rad' if turns else 'm'} here, {at:.9g} in MuJoCo"
            yield f"joint {pair.name}: its spring rests at {text}"

    def _place(self, pair: Pair) -> str:
        """Say how the place of a joint differs from MuJoCo's; nothing if it does not."""
        if pair.kind == "free":
            return ""
        s, s_there = axes(self.model, self.placed, self.data, pair)
        if self._differ(s, s_there, 1.0):
            return f"its axis is {_text(s.T)} here, {_text(s_there.T)} in MuJoCo, in the world"
        p, p_there = self.placed.oMi[pair.here].translation, self.data.xanchor[pair.there]
        apart = p_there - p
        if pair.kind == "hinge":  # any point of the axis will do
            apart = apart - s * (s @ apart)
        if pair.kind == "slide" or not self._differ(apart, 0.0, self.length):
            return ""
        d = np.linalg.norm(apart)
        return (
            f"it stands at {_text(p)} m here, at {_text(p_there)} in MuJoCo, in the world, {d:.3g} "
            "m off"
        )

    def _zero(self, pair: Pair) -> str:
        """Say if another zero of a hinge or a slide explains another centre of mass."""
        m, c, _ = self._inertia(pair)
        ours, oMi = self.model.inertias[pair.here], self.placed.oMi[pair.here]
        if pair.kind not in ("hinge", "slide") or not (m and ours.mass):
            return ""
        s = scalar_axis(self.model, pair.here)[1]
        here, there = ours.lever, oMi.actInv(c)
        if pair.kind == "slide":
            shift, unit = float(s @ (there - here)), "m"
            explained = here + shift * s
        else:
            shift = float(
                np.arctan2(s @ np.cross(here, there), np.cross(s, here) @ np.cross(s, there))
            )
            explained, unit = pin.exp3(shift * s) @ here, "rad"
        if self._differ(explained, there, self.length) or not self._differ(
            here, there, self.length
        ):
            return ""
        return (
            f"the same coordinate puts it {shift:.6g} {unit} further in MuJoCo: another zero (ref?)"
        )

    def _carried(self, pair: Pair, *, placed: bool) -> Iterator[str]:
        """Say how mass, its centre and the inertia about it differ, in the axes of the joint."""
        ours = self.model.inertias[pair.here]
        m, c, inertia = self._inertia(pair)
        if self._differ(ours.mass, m):
            yield f"mass {ours.mass:.9g} kg here, {m:.9g} in MuJoCo"
        if not (placed and ours.mass and m):
            return
        oMi = self.placed.oMi[pair.here]
        lever = oMi.actInv(c)
        if self._differ(ours.lever, lever, self.length):
            d = np.linalg.norm(ours.lever - lever)
            yield (
                f"centre of mass {_text(ours.lever)} m here, {_text(lever)} in MuJoCo, {d:.3g} m "
                "off"
            )
        about = oMi.rotation.T @ inertia @ oMi.rotation
        if self._differ(ours.inertia, about):
            moments, there = np.linalg.eigvalsh(ours.inertia), np.linalg.eigvalsh(about)
            if self._differ(moments, there):
                yield f"principal moments {_text(moments)} kg m^2 here, {_text(there)} in MuJoCo"
            else:
                yield f"principal moments {_text(moments)} kg m^2 in both, about other axes"

    def _inertia(self, pair: Pair) -> tuple[float, Array, Array]:
        """Return mass, centre and inertia about it of what MuJoCo's joint carries, in the world."""
        carried = [b for b in range(self.mj.nbody) if self.holders[b] == pair.there]
        masses, centres = self.mj.body_mass[carried], self.data.xipos[carried]
        m = float(masses.sum())
        c = masses @ centres / m if m else np.zeros(3)
        inertia = np.zeros((3, 3))
        for body, mass, centre in zip(carried, masses, centres, strict=True):
            R, d = self.data.ximat[body].reshape(3, 3), centre - c
            inertia += R @ np.diag(self.mj.body_inertia[body]) @ R.T
            inertia += mass * (d @ d * np.eye(3) - np.outer(d, d))
        return m, c, inertia


def _together(springs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return stiffness and rest of springs, as one."""
    k = sum(stiffness for stiffness, _ in springs)
    return k, sum(stiffness * rest for stiffness, rest in springs) / k if k else 0.0


def _one(values: Any) -> Array:
    """Return a number that stands for equal ones, else all of them."""
    array = np.atleast_1d(np.asarray(values, dtype=float))
    return array[:1] if np.ptp(array) == 0.0 else array


def _text(values: Any) -> str:
    numbers = ", ".join(f"{x:.7g}" for x in np.ravel(values))
    return numbers if np.size(values) == 1 else f"({numbers})"
