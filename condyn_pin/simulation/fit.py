"""Where a scene takes up a state: its loops have to be closed, and its contacts apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.at_state import (
    constraint_velocities,
    equations_of,
    gaps,
    gaps_at,
    to_close,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import NotAssembled
from condyn_pin.mechanism.rank import Check
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.integrators.contact_scheme import PUSHES, ContactScheme
from condyn_pin.simulation.measures import gauge_of


def check_fit(scene: Scene, q: Array, v: Array, *, allowed: float = 0.0, what: str = "") -> None:
    """Raise NotAssembled, said after `what`, if a loop or an anchored contact is open or opening.

    A |J v| of `allowed` [m/s, rad/s] is added to what is tolerated.
    """
    equations = equations_of(scene)
    c, J = equations.position_level(q)
    velocity, left = J @ v - equations.wanted[1], equations.left_out(J, c)
    velocity = left.kept(velocity) if left else velocity
    _raise(scene, to_close(scene, q, c), velocity, v, what, allowed)


def velocity_of_steps(scene: Scene, q: Array, v: Array, integrator: Integrator, dt: float) -> float:
    """Return the |J v| [m/s, rad/s] of states that an integrator goes through.

    Schemes with contacts make v+ tangent in the middle of the step: J v is dt gamma / 2 at its end.
    Four times that is allowed.
    """
    if not (scene.rows and isinstance(integrator, ContactScheme)):
        return 0.0
    equations = gauge_of(scene).equations
    equations.at(None)
    _, _, _, gamma = equations.parts(q, v)
    return 2 * dt * float(np.abs(gamma).max())


def check_penetration(scene: Scene, q: Array, integrator: Integrator) -> None:
    """Raise NotAssembled if a contact penetrates at q, unless it does at rest too."""
    pushes = isinstance(integrator, ContactScheme) and integrator.closes_gaps
    steps = "the steps" if pushes else "steps of StewartTrinkle()"
    cure = (
        "mechanism.put_down(scene, q) puts a floating robot onto the floor; with close_start=False "
        f"{steps} push it out, at {PUSHES:g} m/s at most"
    )
    _raise_if_deep(scene, q, integrator, tolerances.NEARLY_CLOSED, "", f" at the start: {cure}")


def check_deeper(
    scene: Scene, before: Scene, q: Array, integrator: Integrator, *, what: str
) -> None:
    """Raise NotAssembled if a contact penetrates at q that a scene brings, by what no step left."""
    left = max(0.0, -float(gaps_at(before, q)[1].min(initial=0.0)))
    fresh = tuple(each for each in scene.contacts if each not in before.contacts)
    scene = replace(scene, constraints=(), contacts=fresh)
    cure = ": move what it touches, or let the event come before"
    _raise_if_deep(scene, q, integrator, max(tolerances.NEARLY_APART, left), what, cure)


def _raise_if_deep(
    scene: Scene, q: Array, integrator: Integrator, limit: float, what: str, cure: str
) -> None:
    if not scene.contacts or (isinstance(integrator, ContactScheme) and integrator.gives_way):
        return
    candidates, gaps = gaps_at(scene, q)
    if gaps.min(initial=0.0) < -limit:
        k = int(gaps.argmin())
        unit = "m" if candidates.is_length[k] else "rad"
        raise NotAssembled(f"{what}{candidates.names[k]} penetrates by {-gaps[k]:.3g} {unit}{cure}")


def check_velocity(scene: Scene, q: Array, v: Array, *, what: str = "") -> None:
    """Raise NotAssembled unless J v = 0, however open the loops are, driven or not."""
    _raise(scene, np.zeros(scene.rows), equations_of(scene).consistent_jacobian(q) @ v, v, what)


def _raise(
    scene: Scene, c: Array, velocity: Array, v: Array, what: str, allowed: float = 0.0
) -> None:
    speed = max(1.0, float(np.abs(v).max(initial=0.0)))
    fit = Check(gaps(scene, c), constraint_velocities(scene, velocity), speed, {})
    limit = tolerances.NEARLY_CLOSED
    try:
        fit.raise_if_open(violation=limit, constraint_velocity=limit + allowed / speed)
    except NotAssembled as error:
        raise NotAssembled(f"{what}{error}") from None
