"""Driven: rows that follow a path of time; rheonomic constraints.

    c(q) = s(t),        J v = s'(t),        J a + gamma = s''(t)

What follows a path may do work: the force lam moves along at s', with the power lam . s'. Drift
control acts on the difference,

    J a + gamma = s'' - 2 alpha (J v - s') - beta^2 (c - s).

This asks for rows with c' = J v wherever c is, and not at c = 0 alone: the rows of a weld are
log6, whose rate is J v only where it is closed, and those of a contact turn with its body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from condyn_pin._core.arrays import finite
from condyn_pin.constraints.constraint import Constraint, FramedModel
from condyn_pin.constraints.path import Along, check_along
from condyn_pin.constraints.rows.bound import BoundConstraint, RowPath
from condyn_pin.errors import InvalidArgument, InvalidConstraint


@dataclass(frozen=True)
class Driven(Constraint):
    """A constraint whose rows follow a path: c(q) = s(t), J v = s'(t), J a + gamma = s''(t).

    Parameters
    ----------
    constraint : Constraint
        Whose rows are driven:

        - `HeldJoint`: the joint is at its value plus s: a motor that makes it so;
        - `Coupling`: q_a = ratio q_b + offset + s;
        - `Loop`, ball or planar: the origin of `frame_a` is at s in the axes of `frame_b`;
        - `Loop`, rod: its length is `length` - s: a hydraulic cylinder;
        - `KnifeEdge`, `RollingWheel`, `RollingBall`: A v = s': the floor is a belt. Of s only the
          rate is used;
        - `OwnRows`, and a `FrameRelation` that you write.
    along : Path or callable
        The path, t -> (s, s', s'') [m, rad and per second]: `Sine`, `Polynomial`, `minimum_jerk`,
        or any function that returns the three. Only a `Path` can be written to a file.
    time : float, optional
        The time at which it is evaluated [s]; ``scene.at(t)`` sets it. A motion begins at t = 0.
    name : str, optional
        Name of the constraint; that of `constraint` by default.

    Raises
    ------
    InvalidArgument
        If the path has a wrong size, or its rates are not those of its values.
    InvalidConstraint
        If J v is not the rate of c for such a constraint.

    Notes
    -----
    The force is that of `constraint`; for a `HeldJoint` it is the torque of the motor. Its power is
    part of a trajectory's `energy`. `solve` needs to know the time, ``scene.at(t)``; without one,
    states, ranks and gaps of a scene are those at t = 0.

    References
    ----------
    Haug. Computer Aided Kinematics and Dynamics of Mechanical Systems. Allyn and Bacon, 1989,
    chapter 3 (driving constraints).
    """

    closes: ClassVar[bool] = True

    constraint: Constraint
    along: Along
    time: float | None = None  # [s]

    def __post_init__(self) -> None:
        if not isinstance(self.constraint, Constraint) or isinstance(self.constraint, Driven):
            raise InvalidArgument(
                f"constraint = {self.constraint!r}: a constraint is needed whose rows are to be "
                "driven, such as HeldJoint or Loop"
            )
        self._set_name(self.constraint.name)
        for field in ("axes", "drift"):  # those of the constraint, unless it has others now
            own = getattr(self, field)
            object.__setattr__(self, field, getattr(self.constraint, field) if own is None else own)
        check_along(self.along, self.rows, self.name)
        if self.time is not None:
            object.__setattr__(self, "time", float(finite("time", self.time, ())))

    @property
    def rows(self) -> int:
        """Number of rows of the constraint."""
        return self.constraint.rows

    def bind(self, machine: FramedModel, rows: slice) -> BoundConstraint:
        """Return the constraint bound, with driven rows."""
        bound: Any = self.constraint.bind_to_drive(machine, rows)
        return replace(bound, name=self.name, drive=RowPath(self.along, self.time))  # type: ignore[no-any-return]

    def at(self, t: float) -> Self:
        """Return the constraint at a time t [s]."""
        return replace(self, time=t)

    @property
    def is_rheonomic(self) -> bool:
        """True: time enters the rows."""
        return True

    def sides(self, machine: FramedModel) -> tuple[int, ...]:
        """Return the joints that the constraint ties."""
        return self.constraint.sides(machine)

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the body under the force, the body that exerts it, and the frame of its axes."""
        return self.constraint.acting(swapped=swapped)

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames of the constraint."""
        return self.constraint.frames

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of the constraint."""
        return self.constraint.joints

    @property
    def title(self) -> str:
        """Name of the kind, for summaries."""
        return f"{self.constraint.title}, driven"

    @property
    def called(self) -> str:
        """Name of the kind within a sentence."""
        return f"driven {self.constraint.called}"

    @property
    def on_velocity(self) -> bool:
        """True if some rows of the constraint are on the velocity alone."""
        return self.constraint.on_velocity

    def anchored_at(self, c1: Any, c2: Any) -> Self:
        """Return the driven constraint anchored at c1 and c2."""
        return replace(self, constraint=self.constraint.anchored_at(c1, c2))

    def renamed(self, new: Callable[[str], str]) -> Self:
        """Return the driven constraint between frames and joints of other names."""
        return replace(self, name=new(self.name), constraint=self.constraint.renamed(new))

    def with_held(self, values: Mapping[str, float]) -> Self:
        """Return the driven constraint with joints held."""
        return replace(self, constraint=self.constraint.with_held(values))

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Self:
        """Raise: a path is a function of time in its own units."""
        raise InvalidArgument(f"{self.name}: nothing says what unit its path has")


def not_to_drive(constraint: Constraint) -> InvalidConstraint:
    """Error for a constraint whose rows are the rate of c only where c = 0."""
    return InvalidConstraint(
        f"{constraint.name}: J v of a {constraint.called} is the rate of c only where c = 0, so "
        "that it cannot follow a path; drive a HeldJoint, a Coupling, or a Loop that is a ball, "
        "planar or a rod, the moved frame first"
    )
