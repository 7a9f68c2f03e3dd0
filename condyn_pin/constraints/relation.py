"""Two frames related by new equations: a kind of constraint in four functions.

With r the position of c2's origin in c1, R the axes of c2 in c1, and s = (s_lin, s_ang) the
velocity of body 1 relative to body 2 at the origin of c2, in the axes of c1 (see `Loop`),

    r' = -s_lin,        R' = -s_ang x R.

A kind is its violation c(r, R), the weights W of s in its rate, and how these change:

    c' = J v = W s,        J a + gamma = W s' + W' s,        force  J^T lam:  W^T lam  at c2.

So W is the derivative of c: its first three columns -dc/dr, the others -dc by a turn of c2 about
the axes of c1. All else follows: J, gamma, wrenches, and the partial derivatives of an answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import BetweenFrames, FramedModel
from condyn_pin.constraints.rows.special import BoundRelation, differenced_bend


class FrameRelation(BetweenFrames, ABC):
    """Two frames, related by `violation` = 0.

    A dataclass that inherits from it has the fields `frame_a` and `frame_b` first.
    """

    @abstractmethod
    def violation(self, R: Array, r: Array) -> Array:
        """Return c (rows,) [m, rad], of R (3, 3) and r (3,) [m]."""

    @abstractmethod
    def weights(self, R: Array, r: Array) -> Array:
        """Return W (rows, 6), with c' = W s."""

    @abstractmethod
    def weights_rate(self, R: Array, r: Array, s: Array) -> Array:
        """Return W' (rows, 6) while the frames move by s (6,) [m/s, rad/s]."""

    def weights_bend(self, R: Array, r: Array, s: Array) -> Array:
        """Return the partials of `weights_rate` by moves of the frames, (6, rows, 6), s fixed.

        By fourth-order differences, which leave 1e-12 of it; derivatives of answers ask for it.
        """
        return differenced_bend(self.weights_rate, R, r, s)

    @property
    def of_cut(self) -> None:
        """None: the compiled core lacks equations of a user."""
        return

    @property
    def row_words(self) -> tuple[str, ...]:
        """Name of each row, behind that of the constraint."""
        return tuple(str(i + 1) for i in range(self.rows))

    @property
    def angles(self) -> tuple[bool, ...]:
        """Flag of each row: angle, or else length."""
        return (False,) * self.rows

    def bind(self, machine: FramedModel, rows: slice) -> BoundRelation:
        """Return the relation with c1 its first frame and c2 its second one."""
        one, two = machine.frame(self.frame_a), machine.frame(self.frame_b)
        return BoundRelation(self.name, rows, *one, *two, self)

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundRelation:
        """Return the relation as it is: W is the derivative of c everywhere."""
        return self.bind(machine, rows)
