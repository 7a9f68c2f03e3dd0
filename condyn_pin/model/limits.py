"""Limits of joints: who has some, who is beyond them, who is pushed through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import UNLIMITED, lengths
from condyn_pin.constraints.rows.bound import ConstraintViolation


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the joints that have some, and whose coordinates are plain numbers.

    Attributes
    ----------
    joints : tuple of str
        Names, one for each limited coordinate.
    iv, iq : (k,) int array
        Where the coordinate is in v and in q.
    length : (k,) bool array
        Whether the coordinate is a length.
    lower, upper : (k,) array
        [rad, m]
    """

    joints: tuple[str, ...]
    iv: NDArray[np.int_]
    iq: NDArray[np.int_]
    length: NDArray[np.bool_]
    lower: Array
    upper: Array

    @classmethod
    def of(cls, model: Any) -> Limits:
        """Return the finite limits of a model; free-flyers, balls and the like have none here."""
        lowest, highest = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        found = []
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
            plain = lengths(joint) if joint.nq == joint.nv else ()
            for k, length in enumerate(plain):
                iv, iq = joint.idx_v + k, joint.idx_q + k
                is_limited = lowest[iq] > -UNLIMITED or highest[iq] < UNLIMITED
                if is_limited and lowest[iq] <= highest[iq]:
                    found.append((name, iv, iq, length))
        iq_of = np.array([iq for _, _, iq, _ in found], dtype=np.int_)
        return cls(
            tuple(name for name, *_ in found),
            np.array([iv for _, iv, *_ in found], dtype=np.int_),
            iq_of,
            np.array([length for *_, length in found], dtype=np.bool_),
            lowest[iq_of],
            highest[iq_of],
        )

    def clip(self, q: Array) -> None:
        """Move every limited coordinate of q inside, in place."""
        q[self.iq] = np.minimum(np.maximum(q[self.iq], self.lower), self.upper)

    def beyond(self, q: Array) -> dict[str, ConstraintViolation]:
        """Return the joints that are outside their limits, and how far; the most of a joint."""
        x = q[self.iq]
        out = np.maximum(self.lower - x, x - self.upper)
        found: dict[str, ConstraintViolation] = {}
        for i in np.flatnonzero(out > 0):
            by, most = float(out[i]), found.get(self.joints[i], ConstraintViolation(0.0, 0.0))
            found[self.joints[i]] = (
                ConstraintViolation(max(by, most.length), most.angle)
                if self.length[i]
                else ConstraintViolation(most.length, max(by, most.angle))
            )
        return found

    def pushed(self, q: Array, step: Array) -> NDArray[np.int_]:
        """Return the velocity indices at a limit that a step would push through."""
        x, dx = q[self.iq], step[self.iv]
        through = ((x <= self.lower) & (dx < 0)) | ((x >= self.upper) & (dx > 0))
        return self.iv[through]


_NONE = np.zeros(0, dtype=np.int_)
NO_LIMITS = Limits((), _NONE, _NONE, np.zeros(0, dtype=np.bool_), np.zeros(0), np.zeros(0))
