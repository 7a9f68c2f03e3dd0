"""Cables that pull, and struts that push.

at_least <= sum of the spans - sum r_j q_j <= at_most,        lam >= 0 at each
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from condyn_pin._core.arrays import text_of
from condyn_pin.constraints.constraint import Constraint, FramedModel, MjcfGeomWriter, check_lengths
from condyn_pin.constraints.contacts.contact import Contact, Mode
from condyn_pin.constraints.contacts.touches import BoundContact, BoundLine
from condyn_pin.constraints.path import Path
from condyn_pin.constraints.places import FrameLike
from condyn_pin.constraints.taut_cable import (
    Reels,
    TautCable,
    frames_through,
    line_of,
    reels_of,
    wound_to,
)
from condyn_pin.errors import (
    InvalidArgument,
    InvalidConstraint,
    InvalidModel,
    UnsupportedConstraint,
)


@dataclass(frozen=True)
class Cable(Contact):
    """A cable over frames, which pulls where it is taut; or a strut, which pushes.

    gap = at_most + sum r_j q_j - L >= 0,    tension lam >= 0,    gap lam = 0

    L = |x_1 - x_0| + |x_2 - x_1| + ... is the sum of its spans. A strut has the gap L - at_least,
    and a rod with play has both.

    Parameters
    ----------
    through : sequence of str, (joint, pin.SE3) or pin.Frame
        Frames in whose origins it begins, runs over pulleys without radius, and ends.
    at_most : float, optional
        Length of the cable [m]: it pulls there.
    at_least : float, optional
        Length of the strut [m]: it pushes there.
    reels : mapping of str to float
        By how much each joint lengthens it [m/rad, m/m]: the radius of a winch, or of a pulley that
        a tendon is wrapped on, negative if it winds up as q grows. ``Driven(HeldJoint(winch),
        along)`` drives the length in time; a torque of its motor is a tension.
    name : str, optional
        Its frames by default. With both lengths its candidates are ``name/at most`` and
        ``name/at least``.

    Raises
    ------
    InvalidArgument
        If there are fewer than two frames, no length, one that is not positive, or `at_least`
        above `at_most`.

    Notes
    -----
    It goes taut without a rebound, and slips over pulleys without friction. A span without length
    has no direction, and does not pull. The compiled core has no cables, and MuJoCo none with
    reels.
    """

    through: Sequence[FrameLike]
    at_most: float | None = None  # [m]
    at_least: float | None = None  # [m]
    reels: Reels = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "through", frames_through(self.through))
        for argument in ("at_most", "at_least"):
            value = getattr(self, argument)
            if isinstance(value, Path) or callable(value):
                raise InvalidArgument(
                    f"{argument} = {text_of(value)}: a number [m] is needed; a length that changes "
                    "in time is that of a winch: reels={'winch': radius}, and "
                    "Driven(HeldJoint('winch'), path)"
                )
            check_lengths(**{argument: value})
            object.__setattr__(self, argument, None if value is None else float(value))
        if self.at_most is None and self.at_least is None:
            raise InvalidArgument(
                "at_most, at_least: one of them is needed, the length of a cable or of a strut [m]"
            )
        if None not in self._lengths.values() and self.at_least > self.at_most:  # type: ignore[operator]
            raise InvalidArgument(
                f"at_least = {self.at_least:g}: it is above at_most = {self.at_most:g}"
            )
        object.__setattr__(self, "reels", reels_of(self.reels))
        self._set_name("-".join(self.through))

    @property
    def _lengths(self) -> dict[str, float | None]:
        return {"at most": self.at_most, "at least": self.at_least}

    @property
    def _candidates(self) -> dict[str, tuple[float, float]]:
        """Length of each candidate, and the sign of its gap."""
        given = {word: x for word, x in self._lengths.items() if x is not None}
        return {
            f"{self.name}/{word}" if len(given) == 2 else self.name: (
                length,
                1.0 if word == "at most" else -1.0,
            )
            for word, length in given.items()
        }

    def bind(self, machine: FramedModel) -> BoundContact:
        """Return a half-line for each length."""
        try:
            lines = [
                BoundLine(name, line_of(machine, self.name, self.through, x, self.reels, sign))
                for name, (x, sign) in self._candidates.items()
            ]
        except InvalidConstraint as error:
            raise InvalidArgument(str(error)) from error
        return BoundContact(self.name, lines=tuple(lines))

    def with_held(self, values: Mapping[str, float]) -> Cable:
        """Return the cable with some of its reels held."""
        most, least = (
            None if x is None else wound_to(x, self.reels, values)
            for x in (self.at_most, self.at_least)
        )
        reels = (most or least or (0.0, self.reels))[1]
        return replace(
            self,
            at_most=None if most is None else most[0],
            at_least=None if least is None else least[0],
            reels=reels,
        )

    def held(self, modes: Mapping[str, Mode] | None) -> tuple[Constraint, ...]:
        """Return `TautCable` for each length that is reached; without modes, the only one."""
        chosen = self._candidates
        if modes is None and len(chosen) == 2:
            raise UnsupportedConstraint(
                f"{self.name}: it has two lengths; modes say at which it is, "
                f"closed(modes={{'{self.name}/at most': 'stick'}})"
            )
        return tuple(
            TautCable(self.through, length, self.reels, name=name)
            for name, (length, _) in chosen.items()
            if modes is None or modes.get(name, "open") != "open"
        )

    def write_mjcf(self, to: MjcfGeomWriter) -> None:
        """Write a tendon with a limit."""
        if self.reels:
            raise InvalidModel(
                f"contact {self.name!r} has reels, and a tendon of MuJoCo has none; leave it out "
                "of contacts=[...]"
            )
        to.cable(self.name, self.through, self.at_least, self.at_most)
