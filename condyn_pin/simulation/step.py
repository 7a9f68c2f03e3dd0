"""The verbs step and contact_problem: one step of a scene whose contacts open, stick and slide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.threads import Kept
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import SolveFailed
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.proved_steps import ProvedSteps
from condyn_pin.simulation.step_solution import StepSolution

_DEFAULT: Final = StewartTrinkle()


def step(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike = 0.0,
    *,
    dt: float,
    integrator: ContactScheme = _DEFAULT,
    forces: Sequence[AppliedForce] = (),
    throw: bool = True,
) -> StepSolution:
    """Return the state after one step in which contacts open, stick and slide, with its errors.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,
    J_b v+ = -dt gamma / 2,    sigma = G lam + g

    Parameters
    ----------
    scene : Scene
        Its constraints never let go; its `contacts` may. With driven constraints ``scene.at(t)``
        says when the step begins, and J_b v+ = s' - dt (gamma - s'') / 2.
    q, v : (nq,), (nv,) array_like
        A state; loops are taken as closed.
    tau : 0 or (nv,) array_like, optional
        Torques applied [N, N m]. Springs and damping of the robot act at the end of the step.
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default.
    forces : sequence of AppliedForce, optional
        Forces from outside, constant; none by default.
    throw : bool
        Raise if the status is not ok. With False the same StepSolution comes back, whatever its
        status.

    Returns
    -------
    StepSolution

    Raises
    ------
    InvalidArgument
        If an argument cannot be used, or the scheme cannot let a contact of the scene rebound.
    UnsupportedConstraint
        If constraints are driven and the scene does not say at which time it is.
    NotAssembled
        If the path of a driven constraint leads to where the loops cannot follow.
    StepFailed
        If it presses bodies into each other.
    SolveFailed
        If the contact problem has no answer that is good enough, or rounding is as large as what
        its impulses do; its `solution` is the step.

    Notes
    -----
    In the equation, v+ of a floating body is in its axes at the beginning of the step; the velocity
    returned is in its axes at the end, as in Pinocchio.

    Driven rows end a step of `StewartTrinkle` at s' in its middle, t + dt/2, and one of `Moreau` at
    s'(t + dt): a step that begins with s'(t) shows the force of the motor by `Moreau` alone.

    Cost: that of a step in `simulate`, three quarters of which is the contact solver, and as much
    again for the verification.
    """
    steps = _steps(scene, dt, integrator)
    solution = steps.step(*_state(scene, q, v), tau, forces)
    if throw and not solution.status.ok:
        text = solution.status.text(type(integrator.contact).__name__)
        said = "; ".join((text, *solution.notices))
        raise SolveFailed(
            f"a step of {dt:g} s by {integrator!r}: {said} "
            f"(natural residual {solution.contact.natural:.1e})",
            solution,
        )
    return solution


def contact_problem(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike = 0.0,
    *,
    dt: float,
    integrator: ContactScheme = _DEFAULT,
    forces: Sequence[AppliedForce] = (),
) -> ContactProblem:
    """Return the contact problem that a step poses: for `solve_contact`, with any solver.

    sigma = G lam + g,    G = J_c M^-1 J_c^T along the constraints

    Parameters
    ----------
    scene : Scene
    q, v : (nq,), (nv,) array_like
        Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear first.
    tau : 0 or (nv,) array_like, optional
        Torques applied [N, N m].
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default.
    forces : sequence of AppliedForce, optional
        Forces from outside, constant; none by default.

    Returns
    -------
    ContactProblem
        In the rows of the contacts that take part: those that are near, and those that the step
        would close.

    Raises
    ------
    InvalidArgument
        As `step` does.
    """
    steps = _steps(scene, dt, integrator)
    return steps.pose(*_state(scene, q, v), tau, forces).problem


# A loop over `step` with one scene, or with some in turn, makes ProvedSteps for each.
_kept = Kept[ProvedSteps]()


def _steps(scene: Scene, dt: float, integrator: ContactScheme) -> ProvedSteps:
    check_scene(scene)
    scene.robot.check_unedited()
    return _kept.of(scene, (dt, integrator), lambda: ProvedSteps(scene, dt, integrator))


def _state(scene: Scene, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    robot = scene.robot
    return robot.arguments.configuration("q", q), np.array(finite("v", v, robot.nv))
