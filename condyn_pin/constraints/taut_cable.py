"""A cable that never goes slack: length + sum r_j q_j - sum of its spans = 0."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from condyn_pin._core.arrays import text_of
from condyn_pin.constraints.constraint import (
    Constraint,
    FramedModel,
    check_lengths,
    floats,
    text,
)
from condyn_pin.constraints.coupling import one_coordinate
from condyn_pin.constraints.places import FrameLike, frame_text, place_of
from condyn_pin.constraints.rows.cables import BoundCable, Line
from condyn_pin.errors import InvalidArgument, InvalidConstraint

# Reels as users give them, and as they are held: pairs of a joint and its radius.
Reels = Mapping[str, float] | Sequence[tuple[str, float]]


@dataclass(frozen=True)
class TautCable(Constraint):
    """A cable over frames that stays taut, as one that is pretensioned or carries a load. 1 row.

    length + sum r_j q_j = |x_1 - x_0| + |x_2 - x_1| + ...

    `Cable` is one that may go slack.

    Parameters
    ----------
    through : sequence of str, (joint, pin.SE3) or pin.Frame
        Frames in whose origins it begins, runs over pulleys without radius, and ends.
    length : float
        Its length [m].
    reels : mapping of str to float
        By how much each joint lengthens it [m/rad, m/m]: the radius of a winch, or of a pulley that
        a tendon is wrapped on, negative if it winds up as q grows.
    name : str, optional
        Name of the constraint; its frames by default.

    Raises
    ------
    InvalidArgument
        If there are fewer than two frames, or the length is not positive.

    Notes
    -----
    The force is its tension [N]; one that is negative would push, which `Cable` does not. It slips
    over pulleys without friction; a span without length has no direction, and does not pull.
    ``Driven(TautCable(...), along)`` is a winch of the length ``length - s(t)``.
    """

    rows: ClassVar[int] = 1
    closes: ClassVar[bool] = True
    has_normal: ClassVar[bool] = True  # its force has no axes that turn
    only_pulls: ClassVar[bool] = True
    lengths: ClassVar[tuple[str, ...]] = ("length",)

    through: Sequence[FrameLike]
    length: float  # [m]
    reels: Reels = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "through", frames_through(self.through))
        check_lengths(length=self.length)
        object.__setattr__(self, "length", float(self.length))
        object.__setattr__(self, "reels", reels_of(self.reels))
        self._set_name("-".join(self.through))

    def bind(self, machine: FramedModel, rows: slice) -> BoundCable:
        """Return the cable on all coordinates that move its frames."""
        line = line_of(machine, self.name, self.through, self.length, self.reels)
        return BoundCable(self.name, rows, machine.model, line=line)

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundCable:
        """Return the cable as it is: J v is the rate of c everywhere."""
        return self.bind(machine, rows)

    def sides(self, machine: FramedModel) -> tuple[int, ...]:
        """Return the joints that carry its frames, and its reels."""
        carriers = [machine.frame(frame)[0] for frame in self.through]
        reels = [machine.model.getJointId(joint) for joint, _ in reels_of(self.reels)]
        return tuple(dict.fromkeys((*carriers, *reels)))

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the first frame, the last one, and no axes."""
        return self.through[0], self.through[-1], ""

    def renamed(self, new: Callable[[str], str]) -> Self:
        """Return the cable over frames and joints of other names."""
        reels = [(new(joint), r) for joint, r in reels_of(self.reels)]
        return replace(
            self, name=new(self.name), through=tuple(map(new, self.through)), reels=reels
        )

    def with_held(self, values: Mapping[str, float]) -> Self:
        """Return the cable with some of its reels held."""
        length, reels = wound_to(self.length, self.reels, values)
        return replace(self, length=length, reels=reels)

    def in_units(self, length: float, of_joint: Callable[[str], float]) -> Self:
        """Return the cable in other units."""
        if placed := [frame for frame in self.through if place_of(frame)]:
            raise InvalidArgument(
                f"{self.name}: {placed[0]!r} has lengths; Robot.with_frame names it"
            )
        reels = [(joint, length / of_joint(joint) * r) for joint, r in reels_of(self.reels)]
        return replace(self, length=length * self.length, reels=reels)


# What cables that stay taut and those that do not have in common.


def frames_through(given: Any) -> tuple[str, ...]:
    """Texts of two frames or more, or InvalidArgument."""
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) < 2:
        raise InvalidArgument(
            f"through = {text_of(given)}: a list of two frames or more is needed, in order"
        )
    return tuple(frame_text("through", frame) for frame in given)


def reels_of(given: Any) -> tuple[tuple[str, float], ...]:
    """Pairs of joints and radii, or InvalidArgument."""
    pairs = [*given.items()] if isinstance(given, Mapping) else given
    if not isinstance(pairs, Sequence) or not all(
        isinstance(pair, Sequence) and len(pair) == 2 for pair in pairs
    ):
        raise InvalidArgument(f"reels = {text_of(given)}: a radius [m] by joint is needed")
    names = [text("reels", name, "joint") for name, _ in pairs]
    radii = floats("reels", [radius for _, radius in pairs], len(pairs))
    if len(set(names)) < len(names):
        raise InvalidArgument(f"reels = {text_of(given)}: each joint once")
    return tuple(zip(names, radii, strict=True))


def wound_to(
    length: float, reels: Reels, values: Mapping[str, float]
) -> tuple[float, tuple[tuple[str, float], ...]]:
    """Length with some reels held at values, and the reels that are left."""
    pairs = reels_of(reels)
    paid = sum(r * values[joint] for joint, r in pairs if joint in values)
    return length + paid, tuple((joint, r) for joint, r in pairs if joint not in values)


def line_of(
    machine: FramedModel, name: str, through: Sequence[str], length: float, reels: Reels,
    sign: float = 1.0,
) -> Line:  # fmt: skip
    """Line over frames of a machine, or InvalidConstraint."""
    ends = [machine.frame(frame) for frame in through]
    wound = [(one_coordinate(machine, joint, name), r) for joint, r in reels_of(reels)]
    if len({joint for joint, _ in ends}) < 2 and not wound:
        raise InvalidConstraint(
            f"{name}: all of its frames are on one body, so that it constrains nothing; name "
            "frames on two bodies that move against each other"
        )
    return Line(
        tuple(joint for joint, _ in ends),
        tuple(tuple(at.translation.tolist()) for _, at in ends),
        length,
        tuple((int(joint.idx_q), int(joint.idx_v), r) for joint, r in wound),
        sign,
    )
