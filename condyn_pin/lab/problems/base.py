"""Problem: a scene, where it starts, and the motion that is right. The registry is here too.

To write one:

1. Make a frozen dataclass in a file of this folder. `name` is what users type; fields are the
   sizes that the problem is known for.
2. `scene`, `q0`, `v0` and `torque` are the problem in the product's own terms; q0 and v0 satisfy
   the constraints to rounding.
3. `observe` picks the numbers that are compared, and `answer` says what they should be, in closed
   form, or as `digits` whose source is named. It shares no code with Pinocchio.
4. `error` is the measure of the collection that the problem comes from, and `limits` are the errors
   that somebody asks for, each with who does.
5. The equations of the literature, written down once more, are a test of it: in
   `tests/classical.py`, or in a test of its own. Where there is no closed form,
   `benchmarks/problem_answers.py` computes the digits from them in extended precision.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import enter
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.lab.problems.setting import Limit, Published, Setting

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.dynamics.solvers.base import Solver
    from condyn_pin.lab.problems.result import ProblemResult
    from condyn_pin.simulation.drift import Drift
    from condyn_pin.simulation.integrators import Integrator

Torque = Callable[[float, Array, Array], Array]

PROBLEMS: dict[str, type[Problem]] = {}


class Problem(ABC):
    """A problem with a known answer; a frozen value.

    Attributes
    ----------
    name, title, source : str
    duration : float
        Length of the motion [s].
    scene : Scene
    q0, v0 : (nq,), (nv,) array
        Where it starts.
    torque : callable or None
        tau = f(t, q, v) [N, N m]; None for none at all.
    measure : str
        What `error` is, in words.
    judged : {"error", "energy"}
        What the limits are about: `error`, or the largest change of the energy [J].
    limits : tuple of Limit
        From the coarsest to the finest.
    published : tuple of Published
        CPU times of other codes.
    digits : dict of float to tuple of float
        The answer by time [s], where it is known at these times alone; else empty.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    source: ClassVar[str]
    measure: ClassVar[str]
    judged: ClassVar[Literal["error", "energy"]] = "error"
    limits: ClassVar[tuple[Limit, ...]]
    published: ClassVar[tuple[Published, ...]] = ()
    digits: ClassVar[Mapping[float, tuple[float, ...]]] = MappingProxyType({})
    conservative: ClassVar[bool] = True  # whether `energy` stays what it is

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        enter(PROBLEMS, cls.name, cls, f"a problem named {cls.name}")

    @property
    @abstractmethod
    def duration(self) -> float:
        """How long it runs [s]."""

    @property
    @abstractmethod
    def setting(self) -> Setting:
        """How it is run by default: the cheapest found by measurement that meets every limit."""

    @property
    @abstractmethod
    def scene(self) -> Scene:
        """The problem as a scene."""

    @property
    @abstractmethod
    def q0(self) -> Array:
        """Where it starts (nq,)."""

    @property
    def v0(self) -> Array:
        """How fast it starts (nv,); at rest if nothing else is said."""
        return np.zeros(self.scene.robot.nv)

    @property
    def torque(self) -> Torque | None:
        """The torques that act."""
        return None

    @abstractmethod
    def observe(self, q: Array, v: Array) -> Array:
        """Return the numbers that are compared (k,) at a state."""

    def answer(self, t: float) -> Array:
        """Return what they should be (k,); InvalidArgument where that is not known."""
        if t not in self.digits:
            known = " and ".join(f"{t:g}" for t in self.digits)
            raise InvalidArgument(f"t = {t!r}: the answer is known at {known} s")
        return np.array(self.digits[t])

    @property
    def only_at(self) -> tuple[float, ...]:
        """Times at which the answer is known [s]; empty where it is known at all times."""
        return tuple(self.digits)

    def error(self, found: Array, wanted: Array) -> float:
        """Return the largest distance [m] of `found` from `wanted`, places (samples, k) both.

        Of problems with `digits` the largest relative error, which is 10^-scd of the test set.
        """
        if self.digits:
            return float(np.abs(found / wanted - 1).max())
        return float(np.linalg.norm(found - wanted, axis=1).max())

    def energy(self, q: Array, v: Array) -> float:
        """Return what is conserved [J]: kinetic energy and every potential."""
        model, data = self._model_and_data
        kinetic = pin.computeKineticEnergy(model, data, q, v)
        return float(kinetic + pin.computePotentialEnergy(model, data, q) + self.potential(q))

    def potential(self, q: Array) -> float:
        """Return the potential of `torque` at q [J]."""
        return 0.0

    @cached_property
    def _model_and_data(self) -> tuple[Any, Any]:
        model = self.scene.robot.model
        return model, model.createData()

    @classmethod
    def sizes(cls) -> tuple[str, ...]:
        """Return the names of the sizes that can be chosen."""
        return tuple(field.name for field in fields(cls))  # type: ignore[arg-type]

    @property
    def label(self) -> str:
        """Name and sizes."""
        return ", ".join([self.name, *(f"{key} = {getattr(self, key)}" for key in self.sizes())])

    def __getstate__(self) -> dict[str, Any]:
        # all else is made again when it is needed; Pinocchio's Data cannot be copied
        return {key: getattr(self, key) for key in self.sizes()}

    def run(
        self,
        *,
        dt: float | None = None,
        integrator: Integrator | None = None,
        drift: Drift | None = None,
        solver: Solver | None = None,
        duration: float | None = None,
    ) -> ProblemResult:
        """Simulate the problem and check the motion.

        Parameters
        ----------
        dt : float, optional
            Step [s]. Without any of dt, integrator, drift and solver the problem is run as
            `setting` says; with one of them, what is left out is what `simulate` takes, and
            dt that of `setting`.
        integrator, drift, solver : optional
            As in `simulate`.
        duration : float, optional
            A part of the problem's [s]; all of it by default. It is a whole number of steps.

        Returns
        -------
        ProblemResult
            Errors, CPU time and verdict, also of a motion that ended early.

        Raises
        ------
        InvalidArgument
            If dt or the duration is not positive, or the answer is not known at the end.
        """
        from condyn_pin.lab.problems.result import run_problem

        chosen = (integrator, drift, solver)
        if dt is None and all(each is None for each in chosen):
            setting = self.setting
        else:
            setting = Setting(self.setting.dt if dt is None else dt, *chosen)
        return run_problem(self, setting, duration)


def load_problem(name: str, *, n: int | None = None) -> Problem:
    """Return a benchmark problem: ``load_problem("A02", n=40).run()``.

    Parameters
    ----------
    name : str
        A name of `PROBLEMS`.
    n : int, optional
        Its size, for a problem that has one: cells of A02.

    Returns
    -------
    Problem

    Raises
    ------
    UnknownName
        If there is no such problem.
    InvalidArgument
        If the problem has no size, or not this one.
    """
    if name not in PROBLEMS:
        raise unknown_name("problem", str(name), PROBLEMS)
    kind = PROBLEMS[name]
    if n is None:
        return kind()
    if "n" not in kind.sizes():
        sized = ", ".join(each for each in PROBLEMS if "n" in PROBLEMS[each].sizes())
        raise InvalidArgument(f"n = {n!r}: {name} has no size; {sized} has")
    return kind(**{"n": n})
