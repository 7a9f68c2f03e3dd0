"""Scenes, states and answers that many tests share, made once."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin._pin import HAS_LCABA
from condyn_pin.catalogue import motor_torque, standard_scenes


@functools.cache
def robot(name: str) -> cp.Robot:
    return cp.load_robot(name)


@functools.cache
def all_scenes() -> dict[str, cp.Scene]:
    """Every standard scene of every robot, and a few that are hard on purpose."""
    scenes = {}
    for name in cp.available_robots():
        scenes |= standard_scenes(robot(name))
    talos, bar = robot("talos"), robot("four_bar")
    left, right = talos.contacts
    scenes["talos foot to foot, welded"] = cp.Scene(
        talos, [left, cp.Loop("left_sole_link", "right_sole_link", "weld")]
    )
    scenes["talos hands to the world and together"] = cp.Scene(
        talos,
        [
            cp.Loop("world", "gripper_left_base_link", name="held"),
            cp.PointContact("right_sole_link", offset=(0.1, 0, 0), name="toe"),
            right,
        ],
    )
    scenes["talos foot held twice"] = cp.Scene(
        talos, [left, cp.SurfaceContact("left_sole_link", name="again"), right]
    )
    scenes["four_bar backwards"] = cp.Scene(bar, [cp.Loop("rocker_tip", "coupler_tip")])
    scenes["solo12 alone"] = cp.Scene(robot("solo12"))
    return scenes


SOLVERS = {
    name: solver for name, solver in cp.SOLVERS.items() if HAS_LCABA or solver is not cp.LCABA
}


@functools.cache
def states(label: str, count: int = 4) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Closed, moving states of a scene under motor torques."""
    scene = all_scenes()[label]
    rng = np.random.default_rng(7)
    return tuple((*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count))


@functools.cache
def truth(label: str, count: int = 4) -> tuple[cp.Solution, ...]:
    workspace = cp.Workspace(all_scenes()[label], cp.Reference())
    return tuple(workspace.solve(*state, throw=False) for state in states(label, count))


def relative(a: np.ndarray, b: np.ndarray, floor: float = 9.81) -> float:
    """Largest difference over the larger of |b| and gravity."""
    return float(np.abs(a - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), floor))


each_scene = pytest.mark.parametrize("label", list(all_scenes()))
each_solver = pytest.mark.parametrize("solver", [s() for s in SOLVERS.values()], ids=list(SOLVERS))
