"""Many random states that satisfy the constraints, over an executor."""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.parallel.chunks import in_flight
from condyn_pin._core.parameters import check_count
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.sampling import check_generator, sample
from condyn_pin.simulation.batch.recipe import Recipe

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene

# States that a worker is handed at a time: they take it longer than the way there and back.
_CHUNK: Final = 64

Streams = list[np.random.Generator]


def sample_batch(
    scene: Scene,
    n: int,
    rng: np.random.Generator,
    *,
    spread: float = 0.2,
    speed: float = 1.0,
    executor: Executor | None = None,
) -> tuple[Array, Array]:
    """Return n random states that satisfy the constraints, a row each.

    Row i is ``scene.sample(rng.spawn(n)[i])``: each state has a stream of its own, so that the
    states do not depend on who draws them. A second call with the same generator gives others.

    Parameters
    ----------
    scene : Scene
    n : int
    rng : numpy.random.Generator
        The source of randomness, made from a seed.
    spread, speed
        As in `Scene.sample`.
    executor : Executor, optional
        Who does the work, as in `solve_batch`; this process by default.

    Returns
    -------
    Q : (n, nq) array
    V : (n, nv) array

    Raises
    ------
    InvalidArgument
        If an argument is none of these.
    NotAssembled
        As in `Scene.sample`, for any of the states.
    WorkersLost
        As in `solve_batch`.
    """
    check_count("n", n, least=0)
    check_generator(rng)
    try:
        streams = rng.spawn(n)
    except (TypeError, AttributeError) as error:
        raise InvalidArgument(
            f"rng = {rng!r}: it has no seed to spawn from ({error}); "
            "numpy.random.default_rng(seed) makes one that has"
        ) from error
    Q, V = np.zeros((n, scene.robot.nq)), np.zeros((n, scene.robot.nv))
    if executor is None:
        work = partial(_sample, scene, spread, speed)
    else:
        work = partial(_sample_there, Recipe.of(scene, None, None), spread, speed)
    starts = range(0, n, _CHUNK)
    chunks = in_flight(
        work, len(starts), lambda i, _: streams[starts[i] : starts[i] + _CHUNK], executor
    )
    with closing(chunks):
        for i, (q, v) in chunks:
            rows = slice(starts[i], starts[i] + len(q))
            Q[rows], V[rows] = q, v
    return Q, V


def _sample(scene: Scene, spread: float, speed: float, streams: Streams) -> tuple[Array, Array]:
    Q = np.zeros((len(streams), scene.robot.nq))
    V = np.zeros((len(streams), scene.robot.nv))
    for i, rng in enumerate(streams):
        Q[i], V[i] = sample(scene, rng, spread=spread, speed=speed)
    return Q, V


def _sample_there(
    recipe: Recipe, spread: float, speed: float, streams: Streams
) -> tuple[Array, Array]:
    return _sample(recipe.workspace().scene, spread, speed, streams)
