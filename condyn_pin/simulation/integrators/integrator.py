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
8. An implicit method that uses the slopes of torques (`AppliedTorques.slopes`) sets
   `uses_torque_jacobian`.
9. An explicit method needs a small dt where the damping of joints is stiff, and a run that
   breaks down refuses; one that does not overrides `damps_implicitly`.
10. A scheme whose contacts open and slide inherits from `ContactScheme`, whose file says how; the
    `effects` of its stepper are the work, the events and the notes of the last step. One that finds
    the times at which contacts open and slide sets `locates_events`.
11. Rows that are driven are at their paths by `system.acceleration(t, ...)`, and for anything else
    that is asked of `system.equations` by `system.at(t)`: c and J v are differences to them.
12. Sources: cite the paper in the docstring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, Literal, NamedTuple

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import register
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import whole_data
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.errors import InvalidArgument, SolveFailed, StepFailed
from condyn_pin.simulation.events import ContactEvent
from condyn_pin.simulation.records import ContactWork, Note, Row
from condyn_pin.simulation.system import Step, System

INTEGRATORS: dict[str, type[Integrator]] = {}


class Order(NamedTuple):
    """Powers of dt in the errors at a fixed time."""

    q: int
    v: int
    lam: int


class StepEffects(NamedTuple):
    """Effects of a step with contacts, besides its state."""

    work: ContactWork  # work of contacts since the start of the run, this step included [J]
    events: tuple[ContactEvent, ...] = ()  # events located in the step
    # Sentences on the step, each with its time [s]. A step that failed has those so far.
    notes: tuple[tuple[float, Note], ...] = ()


@dataclass(frozen=True)
class Stepper:
    """An integrator at work on one system with one dt.

    The last three are of steps with contacts; `work` is that of contacts since the start.
    """

    step: Step
    lam: Callable[[], Array] | None = None  # where a belongs to the end of the step
    system: System | None = None  # whose solve a step begins with, if not that it was started with
    # (work before the step) -> effects of the last step
    effects: Callable[[ContactWork], StepEffects] | None = None
    touch: Callable[[ContactWork], Array] | None = None  # (work) -> contact record of the last step
    # (t, q, v, work) -> sample of a state
    sample: Callable[[float, Array, Array, ContactWork], Row] | None = None


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
        register(INTEGRATORS, name, cls, f"an integrator named {cls.__name__}")

    @property
    @abstractmethod
    def order(self) -> Order:
        """Of q, v and lam, with the parameters that it has."""

    @property
    def between_events(self) -> Integrator:
        """Integrator of the smooth motion between events: itself, unless it locates events."""
        return self

    @property
    def damps_implicitly(self) -> bool:
        """True if the damping of the robot's joints does not limit dt."""
        return self.keeps_constraints or self.is_adaptive

    @property
    def uses_torque_jacobian(self) -> bool:
        """True if steps use the derivatives of a torque function by the state."""
        return False

    def check(self, candidates: Candidates) -> None:
        """Refuse `candidates` that it does not take as they are, by name."""
        return None

    @abstractmethod
    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""


# Iterations of implicit steps: to the last digit, or an error that says what would do.
#
#     r = M a + h - tau - J^T lam,    c(q)
#
# are what Newton's method takes to zero.
#
# References
# ----------
# Hairer, Wanner. Solving Ordinary Differential Equations II. Springer, 1996, chapter VII.


# What is left with which an iteration may end once it stops to shrink, and below which nothing can
# be told from rounding: as shares of the numbers that a configuration is made of.
_SMALL = 1e-11
_ROUNDING = 1e-15

_MOST = 60

# What is added to the zero block, relative to the largest eigenvalue of J M^-1 J^T: redundant rows
# make the matrix singular without, and the iteration makes up for it.
_DAMPING = 1e-9


def fixed_point_iteration(
    iteration: Callable[[], float], title: str, t: float, dt: float, size: float
) -> None:
    """Iterate until what is left no longer halves in two iterations: some take turns."""
    # `iteration` improves on what it has, and returns what was left before [m, rad]; `size` is that
    # of the numbers that are iterated on (`System.size`). StepFailed if it stops to converge too
    # early.
    small, rounding = _SMALL * size, _ROUNDING * size
    two_before = before = float("inf")
    count, why = 0, ""
    while count < _MOST:
        count += 1
        try:
            left = iteration()
        except SolveFailed:  # it has led to a state that no machine can have
            left = float("nan")
        except InvalidArgument as error:  # such as one that is not finite
            left, why = float("nan"), f" ({error})"
        if left <= rounding or (before < small and not left < two_before / 2):
            return
        two_before, before = before, left
        if not isfinite(left):
            break
    else:
        if before < small:
            return
    left_over = (
        f"{before:.1e} are left (m, rad)" if isfinite(before) else f"its numbers are lost{why}"
    )
    raise StepFailed(
        f"{title} at t = {t:g} s: after {count} iterations {left_over}; take a smaller dt than "
        f"{dt:g} s"
    )


class Residual(NamedTuple):
    """The residuals at one state, of which `velocity` says how fast c changes."""

    r: Array  # (nv,) [N, N m]
    c: Array  # (m,) [m, rad]
    J: Array  # (m, nv)
    velocity: Array  # (m,), J v - s' [m/s, rad/s]


class Partials(NamedTuple):
    """Their partial derivatives."""

    M: Array  # (nv, nv)
    J: Array  # (m, nv)
    r_q: Array  # (nv, nv)
    r_v: Array  # (nv, nv)


class Residuals:
    """The residuals of one system; `damping` belongs into the zero block of [[M, -J^T], [J, 0]]."""

    def __init__(self, system: System) -> None:
        self._system, self._model = system, system.model
        self._data = whole_data(system.model)
        self._kept: Callable[[Array], Array]
        self.damping = _DAMPING * system.scene.nominal.delassus_norm

    def begin(self, q: Array) -> None:
        """Begin a step at q: which rows it keeps (`System.kept_rows`)."""
        self._kept = self._system.kept_rows(q)

    def at(self, t: float, q: Array, v: Array, a: Array, lam: Array) -> Residual:
        """Return the residuals."""
        system, kept = self._system, self._kept
        system.at(t)
        c, J = map(kept, system.equations.position_level(q))
        bodies = pin.rnea(self._model, self._data, q, v, a)
        r = bodies - system.torque(t, q, v) - J.T.dot(lam)
        return Residual(r, c, J, J.dot(v) - kept(system.equations.wanted[1]))

    def partials(self, t: float, q: Array, v: Array, a: Array, lam: Array) -> Partials:
        """Return the partial derivatives, V' being constant where a = V' - w x u (`Manifold`).

        Torques applied count as constant without slopes.
        """
        system, n = self._system, len(v)
        of = system.workspace.linearisation.at(q, v, a, lam)
        r_q = of.r_q + system.passive.stiffness_matrix(q)
        r_v = system.passive.damping_matrix(q) - of.rhs[:n, n:]
        if system.applied.slopes_are_known:
            by_q, by_v = system.applied.slopes(t, q, v)
            r_q, r_v = r_q - by_q, r_v - by_v
        M = system.mass(q)
        if system.manifold.floats:
            r_v = r_v - M @ system.manifold.turning_by(v)
        return Partials(M, self._kept(of.J), r_q, r_v)
