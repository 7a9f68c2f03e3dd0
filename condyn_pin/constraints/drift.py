"""Contract of a drift scheme.

Integrators solve J a + gamma = 0, and what they leave in J v and c(q) adds up. A scheme of one kind
changes what is asked of the rows, J a + gamma = a_ref; one of the other kind moves the state back
after a step.

1. Add one file to `simulation/drift/` with one frozen dataclass that inherits from `Drift`. Its
   fields are its parameters, each with a default and a unit. Set `title`, `cost` and `use`. The
   class registers itself under its lower-case name in `DRIFTS`.
2. A scheme of the first kind returns what it asks for from `rows`. Only `Baumgarte` can be asked
   for: Pinocchio's own methods know nothing else.
3. A scheme of the second kind returns a `Correction` from `start(system, dt)`. It runs after every
   step, takes (t, q, v) at its end, returns (q, v) and writes to neither of its arguments. What it
   remembers from step to step it keeps in its closure; after an event it is started again. It
   sets `corrects`. One that leaves gaps of configurations alone overrides `closes`.
4. `system`, a `System` of the simulation, brings what a correction needs; the equations import this
   file, which knows nothing of it.
5. A correction that cannot reach the constraints returns the best state that it found; it raises
   `NotAssembled` only where going on has no meaning. The run then ends with what it has.
6. Sources: cite the paper in the docstring.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from condyn_pin._core.arguments import enter
from condyn_pin._core.arrays import Array

if TYPE_CHECKING:
    from condyn_pin.constraints.baumgarte import Baumgarte

DRIFTS: dict[str, type[Drift]] = {}

# (t, q, v) -> (q, v)
Correction = Callable[[float, Array, Array], tuple[Array, Array]]


class Drift(ABC):
    """Drift scheme, which keeps the constraints closed; a frozen value."""

    title: ClassVar[str]
    cost: ClassVar[str]
    use: ClassVar[str]  # when to take it
    corrects: ClassVar[bool] = False  # whether it moves the state back after a step

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        name = cls.__name__.lower()
        enter(DRIFTS, name, cls, f"a drift scheme named {cls.__name__}")

    @property
    def rows(self) -> Baumgarte | None:
        """Baumgarte stabilisation of the rows; None for J a + gamma = 0."""
        return None

    @property
    def closes(self) -> bool:
        """True if the scheme closes a gap at the beginning of a motion."""
        return self.corrects

    def start(self, system: Any, dt: float) -> Correction | None:
        """Return the correction of the state after each step of size dt; None without one."""
        return None
