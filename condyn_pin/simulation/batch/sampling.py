"""Many random states that satisfy the constraints, over an executor."""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import closing
from functools import partial
from typing import Final

import numpy as np

from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array
from condyn_pin._core.work import in_flight
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.projection import check_generator, sample
from condyn_pin.simulation.batch.recipe import PickledRecipe, Recipe

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

    Row i is ``scene.sample(rng.spawn(n)[i])``: each state has its own random stream, so the states
    do not depend on which process draws them. A second call with the same generator gives different
    states.

    Parameters
    ----------
    scene : Scene
    n : int
        Number of states.
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
    where = scene if executor is None else Recipe(scene).pickled()
    work = partial(_sample, where, spread, speed)
    starts = range(0, n, _CHUNK)
    chunks = in_flight(
        work, len(starts), lambda i, _: streams[starts[i] : starts[i] + _CHUNK], executor
    )
    with closing(chunks):
        for i, (q, v) in chunks:
            rows = slice(starts[i], starts[i] + len(q))
            Q[rows], V[rows] = q, v
    return Q, V


def _sample(
    where: Scene | PickledRecipe, spread: float, speed: float, streams: Streams
) -> tuple[Array, Array]:
    scene = where.workspace().scene if isinstance(where, PickledRecipe) else where
    states = [sample(scene, rng, spread=spread, speed=speed) for rng in streams]
    return np.array([q for q, _ in states]), np.array([v for _, v in states])
