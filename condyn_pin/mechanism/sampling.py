"""Sampling: random states that satisfy the constraints."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.assembly import assemble, best_end
from condyn_pin.mechanism.closing import Closer
from condyn_pin.mechanism.projection import nearest
from condyn_pin.model.limits import NO_LIMITS

_TRIES = 50


@one_blas_thread
def sample(
    scene: Scene, rng: np.random.Generator, spread: float, speed: float
) -> tuple[Array, Array]:
    """Return a random (q, v) on the constraints; see `Scene.sample`."""
    check_generator(rng)
    for name, value in (("spread", spread), ("speed", speed)):
        if not finite(name, value, ()) >= 0:
            raise InvalidArgument(f"{name} = {value!r}: a number >= 0 is needed")
    scene.robot.check_unedited()
    model, nv, home = scene.robot.model, scene.robot.nv, scene.nominal.q
    if not scene.nominal.closed:
        scene.state()  # raises what is in the way
    chains = scene.chains
    limits = NO_LIMITS if chains.limits.beyond(home) else chains.limits
    closer = Closer.of(scene, limits=limits)
    for _ in range(_TRIES):
        guess = normalised(model, "q", pin.integrate(model, home, spread * rng.normal(size=nv)))
        end, status, _ = best_end(chains, closer, guess, chains.assembly_mode)
        if status.ok:
            v = speed * rng.normal(size=nv)
            terms = closer.equations.mass(end.q), end.J, np.zeros(scene.rows)
            return end.q, nearest(scene, end.q, "v", v, terms, closed=True)
    found = assemble(
        scene,
        guess,
        within_limits=limits is chains.limits,
        branch=chains.assembly_mode,
        throw=False,
    )
    raise NotAssembled(
        f"spread = {spread}: none of {_TRIES} random configurations about the nominal one could be "
        f"closed; use a smaller spread. The last one: {found.error()}",
        found,
    )


def check_generator(rng: object) -> None:
    """Refuse what is no generator of random numbers."""
    if not isinstance(rng, np.random.Generator):
        raise InvalidArgument(f"rng = {rng!r}: numpy.random.default_rng(seed) makes one")
