"""Sampling: random states that satisfy the constraints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array, finite
from condyn_pin.blas_threads import one_blas_thread
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.states.assembly import assemble
from condyn_pin.states.projection import project_velocity

if TYPE_CHECKING:
    from condyn_pin.scene import Scene

_TRIES = 50


@one_blas_thread
def sample(
    scene: Scene, rng: np.random.Generator, spread: float, speed: float
) -> tuple[Array, Array]:
    """Return a random (q, v) on the constraints; see `Scene.sample`."""
    if not isinstance(rng, np.random.Generator):
        raise InvalidArgument(f"rng = {rng!r}: numpy.random.default_rng(seed) makes one")
    for name, value in (("spread", spread), ("speed", speed)):
        if not finite(name, value, ()) >= 0:
            raise InvalidArgument(f"{name} = {value!r}: a number >= 0 is needed")
    scene.robot.check_unedited()
    model, nv, home = scene.robot.model, scene.robot.nv, scene.audit.q
    if not scene.audit.closed:
        scene.state()  # raises what is in the way
    inside = not scene.chains.limits.beyond(home)
    for _ in range(_TRIES):
        guess = np.array(pin.integrate(model, home, spread * rng.normal(size=nv)))
        found = assemble(scene, guess, within_limits=inside, branch=scene.chains.home, throw=False)
        if found.status.ok:
            v = project_velocity(scene, found.q, speed * rng.normal(size=nv), "mass")
            return found.q, v
    raise NotAssembled(
        f"spread = {spread}: none of {_TRIES} random configurations about the nominal one could be "
        f"closed; use a smaller spread. The last one: {found.error()}",
        found,
    )
