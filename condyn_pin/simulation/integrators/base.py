"""The contract of an integrator, and how to write one.

1. Add one file to this folder with a frozen dataclass that inherits from `Integrator`. Its fields
   are its parameters, each with a default, and in the docstring the reason of the default.
2. Set `title`, `order` (of q, v and lam, as theory has it; a property where a parameter changes
   it), `symplectic` if it is, `solves_per_step` (solves of the equations, or factorisations of
   their size; a typical number where it varies) and `use`. The class registers itself under its
   lower-case name in `INTEGRATORS`; tests and the command line find it there, and
   `tests/test_orders.py` measures its orders with every value of its parameters entered there.
3. Write `start(system, dt)`. It returns a `Stepper`: two callables closed over what they need.
   `step(t, q, v)` returns (q, v, a): the state at t + dt, and the acceleration of the step. None
   of the arrays is written to later, and neither are the arguments. Where `a_at` is the end of the
   step, a is the one there, and `lam()` returns the forces (m,) that belong to it; else a sample
   has those of the solve at its start, which the caller asks for before the step.
4. A stepper may remember what it found, such as a multiplier to start the next iteration from. But
   a drift scheme may have moved the state since: it starts from the state it is handed. After an
   event another stepper is started; one step of another size is a stepper that is used once.
5. A step goes in the coordinates y and V of `system.manifold`, never by addition to q: `place`
   leads to (q, v), `rates` to y' and V', and `straight` to V' where the step begins; `system.slope`
   has them beside the acceleration. Bodies that float go straight there, whatever they spin.
6. An integrator that satisfies c(q) = 0 or J v = 0 itself sets `keeps_constraints`; then nothing
   else is asked of the rows (`system.workspace.drift` is None), and no drift scheme is the default.
   One that holds c(q) = 0 alone sets `needs_positions`: wheels and knives have none.
7. Iterations that do not converge raise `StepFailed`, which names what would do, such as a smaller
   dt. Numbers that are not finite need no care: the next solve finds them.
8. An implicit method that asks for the slopes of torques (`Applied.slopes`) sets `takes_jacobian`.
9. An explicit method asks for a small dt where the damping of joints is stiff, and a run that
   breaks down says so; one that does not overrides `takes_stiff_damping`.
10. A scheme whose contacts open and slide inherits from `ContactScheme`, whose file says how; one
    that finds the times at which they do leaves these in `System.located`: `locates_events`.
11. Rows that are driven are at their paths by `system.acceleration(t, ...)`, and for anything else
    that is asked of `system.equations` by `system.at(t)`: c and J v are differences to them.
12. Sources: cite the paper in the docstring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

from condyn_pin._core.arguments import enter
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.simulation.recorder import Row
from condyn_pin.simulation.system import Step, System

INTEGRATORS: dict[str, type[Integrator]] = {}


class Order(NamedTuple):
    """Powers of dt in the errors at a fixed time."""

    q: int
    v: int
    lam: int


@dataclass(frozen=True)
class Stepper:
    """An integrator at work on one system with one dt."""

    step: Step
    lam: Callable[[], Array] | None = None  # where a belongs to the end of the step
    system: System | None = None  # whose solve a step begins with, if not that it was started with
    touch: Callable[[], Array] | None = None  # of contacts that open and slide, beside lam
    sample: Callable[[float, Array, Array], Row] | None = None  # a state, if not by a solve


class Integrator(ABC):
    """A time-stepping method; a frozen value."""

    title: ClassVar[str]
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float]
    use: ClassVar[str]  # when to take it
    a_at: ClassVar[Literal["start", "end"]] = "start"  # which end of the step a and lam belong to
    keeps_constraints: ClassVar[bool] = False
    is_adaptive: ClassVar[bool] = False  # whether it takes smaller steps where it must
    needs_positions: ClassVar[bool] = False  # whether it holds c(q) = 0 only, no bare J v = 0
    takes_contacts: ClassVar[bool] = False  # whether contacts may open and slide in its steps
    locates_events: ClassVar[bool] = False  # whether its steps find the times at which they do

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # a private one is a part of something else
        if getattr(cls.start, "__isabstractmethod__", False) or cls.__name__.startswith("_"):
            return
        name = cls.__name__.lower()
        enter(INTEGRATORS, name, cls, f"an integrator named {cls.__name__}")

    @property
    @abstractmethod
    def order(self) -> Order:
        """Of q, v and lam, with the parameters that it has."""

    @property
    def between_events(self) -> Integrator:
        """What moves where nothing happens: itself, unless it finds events and leaves the rest."""
        return self

    @property
    def takes_stiff_damping(self) -> bool:
        """Whether the damping of the robot's joints does not limit dt."""
        return self.keeps_constraints or self.is_adaptive

    @property
    def takes_jacobian(self) -> bool:
        """Whether it asks how the torques of a function change with the state."""
        return False

    def check(self, candidates: Candidates) -> None:
        """Refuse `candidates` that it does not take as they are, by name."""
        return None

    @abstractmethod
    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
