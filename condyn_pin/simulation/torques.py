"""Torques: those that are applied, and the robot's own springs and damping.

tau_i = applied_i - k_i (q_i - q0_i) - d_i v_i
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.arguments import FLOAT
from condyn_pin.arrays import Array, finite
from condyn_pin.robot import Robot

Torque = Callable[[float, Array, Array], Array]  # (t, q, v) -> (nv,) [N, N m]


def applied_torque(nv: int, tau: float | ArrayLike | Torque) -> Torque:
    """Return what a user handed in as a function of (t, q, v).

    A constant is one array for all times, not to be written to. What a function returns is looked
    at: numbers of another shape would be broadcast without a word.
    """
    if not callable(tau):
        constant = np.array(finite("tau", np.full(nv, 0.0) if _is_zero(tau) else tau, nv))
        constant.flags.writeable = False
        return lambda t, q, v: constant
    shape, function = (nv,), tau

    def checked(t: float, q: Array, v: Array) -> Array:
        found = function(t, q, v)
        if type(found) is np.ndarray and found.shape == shape and found.dtype is FLOAT:
            return found
        return finite(f"tau({t:g}, q, v)", found, nv)

    return checked


def with_passive(robot: Robot, applied: Torque, *, springs: bool, damping: bool) -> Torque:
    """Return the torques applied, with those of springs and damping where there are any."""
    k, at_q, at_v, rest = spring_arrays(robot)
    d = np.array(robot.model.damping, dtype=float)
    sprung, damped = springs and bool(k.any()), damping and bool(d.any())
    if not (sprung or damped):
        return applied
    # K (nv, springs) adds up springs on one joint
    K = np.zeros((robot.nv, len(k)))
    K[at_v, range(len(k))] = k

    def torque(t: float, q: Array, v: Array) -> Array:
        tau = applied(t, q, v)
        if damped:
            tau = tau - d * v
        if sprung:
            tau = tau - K.dot(q[at_q] - rest)
        return tau

    return torque


def passive_matrices(robot: Robot, *, springs: bool, damping: bool) -> tuple[Array, Array]:
    """Return stiffness and damping (nv, nv): minus the partial derivatives by q and by v."""
    k, _, at_v, _ = spring_arrays(robot)
    K, D = np.zeros((2, robot.nv, robot.nv))
    if springs:
        np.add.at(K, (at_v, at_v), k)
    if damping:
        D[np.diag_indices(robot.nv)] = robot.model.damping
    return K, D


def spring_arrays(robot: Robot) -> tuple[Array, Any, Any, Array]:
    """Return stiffness, places in q, places in v, and references of the springs."""
    model = robot.model
    joints = [model.joints[model.getJointId(spring.joint)] for spring in robot.springs]
    return (
        np.array([spring.stiffness for spring in robot.springs]),
        np.array([joint.idx_q for joint in joints], dtype=np.int_),
        np.array([joint.idx_v for joint in joints], dtype=np.int_),
        np.array([spring.reference for spring in robot.springs]),
    )


def _is_zero(tau: object) -> bool:
    """Whether it is the number zero, which stands for no torque."""
    return isinstance(tau, (int, float)) and tau == 0
