"""The states that a smaller scene is asked at."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from condyn_pin._core.timing import State
from condyn_pin.dynamics.scene import Scene, motor_torque
from condyn_pin.errors import InvalidArgument, NotAssembled


def sampled(scene: Scene, seed: int, count: int) -> list[State]:
    """Return random closed states, with torques of the motors."""
    rng = np.random.default_rng(seed)
    return [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]


def checked_states(scene: Scene, motion: Any) -> list[State]:
    """Return the states of a motion, or raise InvalidArgument or NotAssembled."""
    if isinstance(motion, str) or not isinstance(motion, Iterable):
        raise InvalidArgument(f"motion = {motion!r}: a list of (q, v, tau) is needed")
    check = scene.robot.arguments.check
    states = []
    for k, state in enumerate(motion):
        try:
            q, v, tau = state
        except (TypeError, ValueError) as error:
            raise InvalidArgument(f"motion[{k}]: (q, v, tau) is needed ({error})") from error
        try:
            q, v, tau = check(q, v, tau)
            scene.check(q, v).raise_if_open()
        except InvalidArgument as error:
            raise InvalidArgument(f"motion[{k}]: {error}") from error
        except NotAssembled as error:
            raise NotAssembled(f"motion[{k}]: {error}", error.assembly) from error
        states.append((q, v, tau))
    if not states:
        raise InvalidArgument("motion: it is empty; one state (q, v, tau) at least is needed")
    return states
