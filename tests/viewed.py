"""What the tests of pictures look at, made once."""

from __future__ import annotations

from functools import cache

import numpy as np

import condyn_pin as cp
from condyn_pin.viewing.drawing import ViewOptions, drawing_of


def drawing(subject, q=None, *, posture=None, t=None, speed=1.0, **look):
    """What `view` shows of a subject, without a page."""
    return drawing_of(subject, q, posture=posture, t=t, speed=speed, look=ViewOptions(**look))


def parts(subject, *args, **options):
    """The parts of a picture by path."""
    return {part.path: part for part in drawing(subject, *args, **options).parts}


@cache
def cassie() -> cp.Robot:
    return cp.load_robot("cassie")


@cache
def standing() -> cp.Scene:
    """Cassie with its loops and its feet."""
    return cp.Scene(cassie(), (*cassie().loops, *cassie().contacts))


def bent() -> np.ndarray:
    """A configuration of Cassie with one loop open."""
    q = standing().state("standing")[0].copy()
    q[cassie().model.joints[cassie().model.getJointId("left-knee-op")].idx_q] -= 0.5
    return q


@cache
def swinging() -> cp.Trajectory:
    """Half a second of a four-bar that falls."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    return cp.simulate(scene, *scene.state(), duration=0.5, dt=0.005)


@cache
def held(name: str) -> cp.control.InverseDynamics:
    """A robot that its motors hold still."""
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, (*robot.loops, *robot.contacts))
    return cp.control.gravity_compensation(scene, scene.state()[0])
