"""Many closed configurations of one mechanism, from the angles of its motors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arguments import checked
from condyn_pin._core.arrays import Array, finite_rows
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.joints import indices
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.mechanism.assembling import best_end, nominal_configuration
from condyn_pin.mechanism.closed_chains import ClosedChains, chains_of
from condyn_pin.mechanism.closing import Closer
from condyn_pin.model.joints import NO_LIMITS

# Steps on the way from the nominal configuration to one that is not found at once.
_STEPS = 8


@one_blas_thread
def assemble_batch(
    scene: Scene,
    angles: ArrayLike,
    *,
    joints: Sequence[str] | None = None,
    within_limits: bool = True,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return closed configurations with the motors at given angles, and which of them are closed.

    Each starts from the nominal configuration, and if that fails approaches its angles in small
    steps, so that no row depends on another. All are on the branch of the first posture.

    Parameters
    ----------
    scene : Scene
    angles : (n, k) array_like
        Of the motors, one row per robot [rad, m].
    joints : sequence of str, optional
        The joints that the columns are of; those with motors by default.
    within_limits : bool
        Whether angles beyond the limits of their joints, and configurations beyond those of other
        joints, count as not closed.

    Returns
    -------
    Q : (n, nq) array
        A row that is not closed is where its gap was smallest.
    closed : (n,) bool array
        Which of them are open by 1e-10 [m, rad] at most.

    Raises
    ------
    InvalidArgument
        If a size does not fit, a number is not finite, or a joint has several coordinates.
    NotAssembled
        If the loops cannot be closed at the nominal configuration.

    Notes
    -----
    Takes as long as a call of `Scene.assemble` a row, without its report.
    """
    check_scene(scene)
    scene.robot.check_unedited()
    robot = scene.robot
    named = robot.actuated if joints is None else joints
    names = checked("joints", named, robot.joints, "joint")
    iq, iv = indices(robot.model, names)
    if not names or not len(names) == len(iq) == len(iv):
        raise InvalidArgument(
            f"joints = {list(names)}: joints with one coordinate are needed, one at least"
        )
    goals = finite_rows("angles", angles, len(names))
    if goals.ndim != 2:
        raise InvalidArgument(f"angles has shape {goals.shape}: a row for each robot is needed")
    if not scene.nominal.closed:
        scene.state()  # raises what is in the way
    return _Many(scene, iq, iv, within_limits=within_limits).all(goals)


class _Many:
    """Closes the loops of a scene again and again, with some joints held."""

    def __init__(
        self,
        scene: Scene,
        iq: NDArray[np.int_],
        iv: NDArray[np.int_],
        *,
        within_limits: bool,
    ) -> None:
        self._home, self._iq = nominal_configuration(scene), iq
        self._chains: ClosedChains = chains_of(scene)
        self._limits = self._chains.limits if within_limits else NO_LIMITS
        moving = np.ones(scene.robot.nv, dtype=bool)
        moving[iv] = False
        self._closer = Closer.of(scene, moving, self._limits)

    def all(self, goals: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return what `assemble_batch` does."""
        Q = np.zeros((len(goals), len(self._home)))
        closed = np.zeros(len(goals), dtype=bool)
        for i, goal in enumerate(goals):
            Q[i], closed[i] = self._one(goal)
        return Q, closed

    def _one(self, goal: Array) -> tuple[Array, bool]:
        best, closed = self._closed_at(self._home, goal)
        if closed or not np.array_equal(best[self._iq], goal):  # beyond the limits of a motor
            return best, closed
        q, start = self._home, self._home[self._iq]
        for share in np.arange(1, _STEPS + 1) / _STEPS:
            q, closed = self._closed_at(q, (1 - share) * start + share * goal)
            if not closed:
                return best, False
        return q, True

    def _closed_at(self, start: Array, goal: Array) -> tuple[Array, bool]:
        """Return the configuration near a start with the motors at a goal, and if it is closed."""
        guess = start.copy()
        guess[self._iq] = goal
        end, status, _ = best_end(self._chains, self._closer, guess, self._chains.assembly_mode)
        there = np.array_equal(end.q[self._iq], goal)  # not where a limit wants them
        return end.q, status.ok and there and not self._limits.beyond(end.q)
