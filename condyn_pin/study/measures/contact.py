"""Contact solvers: the impulses of one step, against Newton's to rounding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import ClassVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import step_size
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solution import ContactSolution, attempt_contact, solve_contact, verified
from condyn_pin.contact.solvers import CONTACT_SOLVERS, ContactSolver
from condyn_pin.contact.solvers.contact_solver import SolverResult
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle
from condyn_pin.stepping.single_step import contact_problem
from condyn_pin.study.measures.measure import Answer, Measure, or_inf
from condyn_pin.study.tables import Methods

_FRICTION = 0.7  # of rubber on a dry floor

_NEWTON = SemismoothNewton()

# Natural residual of what may be compared with: a hundred times below the finest that is asked for.
_EXACT = 1e-13


@dataclass(frozen=True, eq=False)
class ContactBench:
    """A contact solver, and the problems of a scene that were posed to it."""

    scene: Scene
    solver: ContactSolver
    problems: dict[bytes, ContactProblem] = field(default_factory=dict)


@dataclass(frozen=True)
class ContactMeasure(Measure):
    """The error of the impulses of one step, by the velocities: |J^T (lam - lam*)| in M^-1.

    e^2 = d^T G d / max(lam*^T G lam*, m g^2 dt^2),    d = lam - lam*

    lam* is the nearer of two answers of `SemismoothNewton`, from no impulses and from lam: where
    several redundant contacts slide, Coulomb's law has many answers, and an exact one is not wrong
    for being another.

    In a row of this measure `constraint_error` is the natural residual, without a unit,
    `dynamics_error` the energy of the wrong velocities d^T G d / 2 [J], and `iterations` those of
    all methods that had a part. The name of a robot stands for it with its loops on its feet.

    Parameters
    ----------
    dt : float
        Of the step [s].
    integrator : ContactScheme
        What poses the problem.

    Raises
    ------
    InvalidArgument
        If dt is not positive, or the integrator is no scheme with contacts.
    """

    name: ClassVar[str] = "contact"
    asks: ClassVar[type] = ContactSolver
    methods: ClassVar[Methods] = CONTACT_SOLVERS

    dt: float = 1e-3  # [s]
    integrator: ContactScheme = StewartTrinkle()  # noqa: RUF009  a value

    def __post_init__(self) -> None:
        step_size(self.dt)
        if not isinstance(self.integrator, ContactScheme):
            raise InvalidArgument(
                f"integrator = {self.integrator!r}: a scheme with contacts is needed, such as "
                "StewartTrinkle()"
            )

    def scenes_of(self, robot: Robot) -> Mapping[str, Scene]:
        """Return the robot with its loops on its feet, with a friction of 0.7."""
        return feet_on_the_floor(robot)

    def open(self, scene: Scene, method: ContactSolver) -> ContactBench:
        """Return a contact solver with the scene, its problems not built yet."""
        if not scene.contacts:
            raise InvalidArgument("the scene has no contacts that may open: Scene(contacts=...)")
        if self.integrator.law not in method.laws:
            raise InvalidArgument(
                f"{self.integrator.title} poses the {self.integrator.law}, and {method.title} "
                f"solves {' and '.join(method.laws)}"
            )
        return ContactBench(scene, method)

    def truth(self, scene: Scene, state: State) -> Array:
        """Return the impulses of Newton's method, to rounding (m,) [N s]."""
        return solve_contact(self._problem(scene, state), _NEWTON, throw=False).lam

    def answer(
        self, workspace: ContactBench, state: State, truth: Array, accuracy: float
    ) -> Answer:
        """Return the answer of a contact solver at a state."""
        problem, solver = self._posed(workspace, state), workspace.solver
        found, natural = attempt_contact(problem, solver, None, _goal(solver))
        solution = verified(problem, found, natural, accuracy, solve_time=0.0)
        robot = workspace.scene.robot
        gravity = float(np.linalg.norm(robot.model.gravity.linear))
        least = robot.mass * (gravity * self.dt) ** 2
        lost, error = inf, inf
        if np.isfinite(solution.lam).all():
            polished = _NEWTON.attempt(problem, solution.lam).lam
            exact = natural_residual(problem, polished) <= _EXACT
            others = (truth, polished) if exact else (truth,)
            distances = (_distance(problem, solution.lam, other, least) for other in others)
            lost, error = min(distances, key=lambda pair: pair[1])
        return Answer(
            error=error,
            status=solution.status.word,
            dynamics_error=lost,
            constraint_error=or_inf(natural),
            iterations=solution.iterations,
        )

    def calls(self, workspace: ContactBench) -> Mapping[str, Call]:
        """Return the solve as in a time step, and the one with all seven residuals."""
        solver, goal = workspace.solver, _goal(workspace.solver)

        def once(q: Array, v: Array, tau: Array) -> tuple[SolverResult, float]:
            return attempt_contact(self._posed(workspace, (q, v, tau)), solver, None, goal)

        def solve(q: Array, v: Array, tau: Array) -> ContactSolution:
            problem = self._posed(workspace, (q, v, tau))
            return solve_contact(problem, solver, accuracy=goal, throw=False)

        return {"once": once, "solve": solve}

    def _posed(self, bench: ContactBench, state: State) -> ContactProblem:
        """Contact problem of a step from a state, built once."""
        key = b"".join(x.tobytes() for x in state)
        if key not in bench.problems:
            bench.problems[key] = self._problem(bench.scene, state)
        return bench.problems[key]

    def _problem(self, scene: Scene, state: State) -> ContactProblem:
        return contact_problem(scene, *state, dt=self.dt, integrator=self.integrator)


def feet_on_the_floor(robot: Robot) -> Mapping[str, Scene]:
    """Return a robot with its loops on its feet, by label, with a friction of 0.7."""
    feet = robot.frictional_contacts(_FRICTION)
    if not feet:
        raise InvalidArgument(
            f"{robot.name} has no feet: hand in a Scene with contacts in place of its name"
        )
    return {f"{robot.name} on its feet": Scene(robot, robot.loops, feet)}


def _goal(solver: ContactSolver) -> float:
    """Required accuracy of the contact solve: the solver's own tolerance, if it is larger."""
    return max(getattr(solver, "tolerance", 0.0), tolerances.CONTACT_SOLVED)


def _distance(
    problem: ContactProblem, lam: Array, other: Array, least: float
) -> tuple[float, float]:
    """Energy of the velocity difference J^T (lam - other) [J], and its relative size."""
    d = lam - other
    wrong = max(float(d @ problem.G @ d), 0.0)
    size = max(float(other @ problem.G @ other), least)
    return wrong / 2, (wrong / size) ** 0.5 if size else inf if wrong else 0.0
