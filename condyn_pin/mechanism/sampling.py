"""Sampling: random states that satisfy the constraints."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count, normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.assembling import assembly_of, best_end, nominal_configuration
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import Closer
from condyn_pin.mechanism.projection import nearest
from condyn_pin.model.joints import NO_LIMITS


@one_blas_thread
def sample(
    scene: Scene,
    rng: np.random.Generator,
    *,
    spread: float = 0.2,
    speed: float = 1.0,
    tries: int = 50,
) -> tuple[Array, Array]:
    """Return a random (q, v) that satisfies the constraints.

    It is on the branch of the first posture, and within the joint limits if that posture is.

    Parameters
    ----------
    scene : Scene
    rng : numpy.random.Generator
        The source of randomness; the same generator gives the same states.
    spread : float
        Standard deviation of each joint about the nominal state, before closing [rad, m].
    speed : float
        Standard deviation of each velocity, before projection to J v = 0 [rad/s, m/s].
    tries : int
        How many random guesses are closed at most. One that cannot be closed takes as long as a
        thousand answers.

    Returns
    -------
    q : (nq,) array
        [rad, m].
    v : (nv,) array
        [rad/s, m/s].

    Raises
    ------
    InvalidArgument
        If `rng` is no generator, `spread` or `speed` is no number >= 0, or `tries` no count.
    NotAssembled
        If the loops cannot be closed at the nominal state, or from none of the random guesses.
    """
    check_generator(rng)
    for name, value in (("spread", spread), ("speed", speed)):
        if not finite(name, value, ()) >= 0:
            raise InvalidArgument(f"{name} = {value!r}: a number >= 0 is needed")
    check_count("tries", tries, least=1)
    scene.robot.check_unedited()
    model, nv, home = scene.robot.model, scene.robot.nv, nominal_configuration(scene)
    if not scene.nominal.closed:
        scene.state()  # raises what is in the way
    chains = chains_of(scene)
    limits = NO_LIMITS if chains.limits.beyond(home) else chains.limits
    closer = Closer.of(scene, limits=limits)
    for _ in range(tries):
        guess = normalised(model, "q", pin.integrate(model, home, spread * rng.normal(size=nv)))
        end, status, flipped = best_end(chains, closer, guess, chains.assembly_mode)
        if status.ok:
            v = speed * rng.normal(size=nv)
            terms = closer.equations.mass(end.q), end.J, -closer.equations.wanted[1]
            return end.q, nearest(scene, end.q, "v", v, terms, closed=True)
    found = assembly_of(scene, closer, guess, end, status, flipped)
    raise NotAssembled(
        f"spread = {spread}: none of {tries} random configurations about the nominal one could be "
        f"closed; use a smaller spread. The last one: {found.error()}",
        found,
    )


def check_generator(rng: object) -> None:
    """Refuse what is no generator of random numbers."""
    if not isinstance(rng, np.random.Generator):
        raise InvalidArgument(f"rng = {rng!r}: numpy.random.default_rng(seed) makes one")
