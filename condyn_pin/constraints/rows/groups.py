"""Groups of constraints of one scene, each evaluated at once.

A group writes its rows of c, J v and J a + gamma into the vectors of all rows, and its forces in
the axes and at the origins of c1 and c2, stacked: lam itself, and behind it the force of each rod,
and then force and moment of each cut joint, of all that rolls and of each relation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.forces import frame_jacobian
from condyn_pin.constraints.rows.bound import (
    FRAME,
    POINT,
    BoundBetweenFrames,
    BoundConstraint,
    PinocchioConstraint,
    TwoFrameConstraint,
)
from condyn_pin.constraints.rows.frames import (
    Balls,
    CutJoints,
    Ends,
    FrameJacobian,
    JointWrenches,
    PointEnds,
    Rods,
    Weld,
    WorldContacts,
    rows_of,
)
from condyn_pin.constraints.rows.functions import BoundFunctions, Functions
from condyn_pin.constraints.rows.special import (
    BoundCoupling,
    BoundRelation,
    BoundRolling,
    Couplings,
    Relations,
    Rolling,
)


class GroupedConstraints(NamedTuple):
    """Constraints of one scene, sorted into groups, each in the order of the scene."""

    held: list[BoundBetweenFrames]  # on the world, in the axes of the body
    balls: list[BoundBetweenFrames]
    welds: list[BoundBetweenFrames]
    cut: list[BoundBetweenFrames]  # with other rows than Pinocchio's
    rods: list[BoundBetweenFrames]
    rolled: list[BoundRolling]
    related: list[BoundRelation]
    coupled: list[BoundCoupling]
    of_functions: list[BoundFunctions]


def sorted_by_rows(bounds: Sequence[BoundConstraint]) -> GroupedConstraints:
    """Constraints sorted by the method that evaluates their rows."""
    pairs = [b for b in bounds if isinstance(b, BoundBetweenFrames)]
    loops = [b for b in pairs if not b.is_held]
    return GroupedConstraints(
        held=[b for b in pairs if b.is_held],
        balls=[b for b in loops if b.selection == POINT],
        welds=[b for b in loops if b.selection == FRAME],
        cut=[b for b in loops if not (b.is_plain or b.is_rod)],
        rods=[b for b in loops if b.is_rod],
        rolled=[b for b in bounds if isinstance(b, BoundRolling)],
        related=[b for b in bounds if isinstance(b, BoundRelation)],
        coupled=[b for b in bounds if isinstance(b, BoundCoupling)],
        of_functions=[b for b in bounds if isinstance(b, BoundFunctions)],
    )


class Group(Protocol):
    """Constraints between frames that are evaluated together, after forward kinematics."""

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows into the three vectors of all rows."""

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces in the axes of c1 and of c2 into their places, right after `evaluate`.

        Of rows that Pinocchio has f1 is lam already, and f2 has the places of all rows.
        """


class Loops(Group, Protocol):
    """Group that evaluates c without velocities."""

    def violation(self, c: Array) -> None:
        """Write c alone: placements in `data` are enough."""


class OtherRows(Group, Protocol):
    """Group with rows that Pinocchio does not have."""

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write these rows into J (m, nv), right after `evaluate`."""


class Groups:
    """All groups of one scene, and the memory that they share with its `Equations`.

    They hold views of `data`. `evaluators` write the rows of all between frames, and `violations` c
    alone; there are none if a group needs velocities for that. `on_coordinates` are couplings and
    `functions`, whose forces are no wrenches. `motion` (2, m + 1) is where J v and J a + gamma are,
    a zero behind each.
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[BoundConstraint], motion: Array
    ) -> None:
        held, balls, welds, cut, rods, rolled, related, coupled, own = sorted_by_rows(bounds)
        self._model, self._data, self._m = model, data, motion.shape[1] - 1
        self.plain = PinocchioRows(model, data, bounds)
        self.functions = Functions(own, model.nv) if own else None
        self.on_coordinates: list[Couplings | Functions] = [Couplings(coupled, model.nv)] * bool(
            coupled
        )
        self.on_coordinates += [self.functions] if self.functions else []
        contacts = [WorldContacts(data, held, motion)] if held else []
        self.ball_ends = PointEnds(data, balls) if balls else None
        loops: list[Loops] = [Balls(self.ball_ends, balls)] if self.ball_ends else []
        loops += [Weld(data, b) for b in welds]
        others: list[tuple[OtherRows, Sequence[TwoFrameConstraint], tuple[int, ...]]] = []
        kinds: list[tuple[Any, Sequence[TwoFrameConstraint], tuple[int, ...]]] = [
            (Rods, rods, POINT), (CutJoints, cut, FRAME), (Rolling, rolled, FRAME),
            (Relations, related, FRAME),
        ]  # fmt: skip
        for kind, chosen, components in kinds:
            if chosen:
                others.append((kind(Ends(data, chosen), chosen), chosen, components))
        # contacts come first: they write zeros into all other rows
        self._unlike_pinocchio = [*contacts, *(group for group, _, _ in others)]
        groups: list[Group] = [*contacts, *loops, *(group for group, _, _ in others)]
        self.evaluators = [group.evaluate for group in groups]
        self.violations = [group.violation for group in loops] if groups == loops else []
        self._place(loops, [*held, *balls, *welds], others)

    def _place(
        self,
        loops: Sequence[Group],
        plain: Sequence[BoundBetweenFrames],
        others: Sequence[tuple[OtherRows, Sequence[TwoFrameConstraint], tuple[int, ...]]],
    ) -> None:
        """Assign every force its place among the stacked ones."""
        size = self._m
        places: list[tuple[TwoFrameConstraint, slice, tuple[int, ...]]]
        places = [(b, b.rows, b.selection) for b in plain]
        slices = [(group, slice(0, size)) for group in loops]
        for group, bounds, components in others:
            start = size
            for b in bounds:
                places.append((b, slice(size, size + len(components)), components))
                size += len(components)
            slices.append((group, slice(start, size)))
        self._wrenches = JointWrenches(self._model, places, size)
        self._forces = np.zeros(2 * size)
        f1, f2 = self._forces[:size], self._forces[size:]
        self._lam = f1[: self._m]
        self._stacks = [(group.stack, f1[at], f2[at]) for group, at in slices]

    @property
    def on_joints(self) -> Any:
        """Wrench on each joint, from the last `wrenches`."""
        return self._wrenches.all

    def wrenches(self, lam: Array) -> Any:
        """Wrenches of lam on each joint, with the signs of joint 1, after `evaluate`."""
        self._lam[:] = lam
        for stack, f1, f2 in self._stacks:
            stack(lam, f1, f2)
        return self._wrenches.of(self._forces)

    def jacobian(self) -> Array:
        """Jacobian J (m, nv) without signs, right after `evaluate` and Jacobians of joints."""
        if self.plain.are_all:
            return self.plain.jacobian()
        model, data = self._model, self._data
        J = np.zeros((self._m, model.nv))
        J[self.plain.rows] = self.plain.jacobian()
        nothing = np.zeros((6, model.nv))

        def of_frame(joint: int, placement: Any) -> Array:
            return frame_jacobian(model, data, joint, placement, LOCAL) if joint else nothing

        for group in self._unlike_pinocchio:
            group.jacobian(J, of_frame)
        for on_coordinates in self.on_coordinates:
            on_coordinates.jacobian(J)
        return J


# Rows that Pinocchio has itself, of points and of frames: J in one call, and gamma alone.
#
# With the accelerations a1, a2 of the two ends at a = 0,
#
#     point:  gamma = R1^T (a1 - a2)    classical, in the axes of the world
#     frame:  gamma = a1                spatial, in its own axes; the other end is the world
#
# `Equations.motion` finds the same with c and J v beside it, and where two bodies are welded.


# bound once: these are called for every row
_classical = pin.getFrameClassicalAcceleration
_spatial = pin.getFrameAcceleration
_WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class PinocchioRows:
    """Jacobian and gamma of the points and frames of a scene; other rows are not written to.

    `data` holds Jacobians of joints for `jacobian`, and forward kinematics with a = 0 for `gamma`.

    rows: which rows of J these are
    are_all, have_gamma: whether there are no others, and whether `gamma` is that of all rows
    """

    def __init__(self, model: Any, data: Any, bounds: Sequence[BoundConstraint]) -> None:
        plain = [b for b in bounds if isinstance(b, BoundBetweenFrames) and b.is_plain]
        self.rows, self.are_all = rows_of(plain), len(plain) == len(bounds)
        # a single column would come as a vector
        self._shape = sum(b.size for b in plain), model.nv
        models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for b in plain:
            made = PinocchioConstraint.of(b, b.size).to_pinocchio(model)
            models.append(made)
            datas.append(made.createData())
        self._jacobian = _pin.constraints_jacobian(model, data, models, datas)
        self.have_gamma = self.are_all and all(b.joint2 == 0 or b.selection == POINT for b in plain)
        gammas = plain if self.have_gamma else []
        self._gammas = [(b.rows, _gamma_of(model, data, b)) for b in gammas]

    def jacobian(self) -> Array:
        """Rows of J of these constraints."""
        if not self._shape[0]:
            return np.zeros(self._shape)
        return self._jacobian().reshape(self._shape)

    def gamma(self, out: Array) -> None:
        """Write gamma of these constraints into `out` (m,)."""
        for rows, gamma in self._gammas:
            out[rows] = gamma()


def _gamma_of(model: Any, data: Any, b: BoundBetweenFrames) -> Callable[[], Array]:
    """Function that returns gamma of one constraint."""
    joint1, placement1, joint2, placement2 = b.joint1, b.placement1, b.joint2, b.placement2
    if joint2 == 0 and b.selection == POINT:
        return lambda: _classical(model, data, joint1, placement1, LOCAL).linear
    if joint2 == 0:
        return lambda: _spatial(model, data, joint1, placement1, LOCAL).vector
    oMi1 = data.oMi[joint1]

    def gamma() -> Array:
        one = _classical(model, data, joint1, placement1, _WORLD_AXES)
        two = _classical(model, data, joint2, placement2, _WORLD_AXES)
        return (one - two).linear.dot((oMi1 * placement1).rotation)  # type: ignore[no-any-return]

    return gamma
