"""What the tests of pictures look at."""

from __future__ import annotations

import pytest

import condyn_pin as cp
from condyn_pin.viewing.verbs import drawing_of as drawing


def parts(subject, *args, **options):
    """The parts of a picture by path."""
    return {part.path: part for part in drawing(subject, *args, **options).parts}


@pytest.fixture(scope="module")
def standing():
    """Cassie with its loops and its feet; closed (q, v), and a configuration with a loop open."""
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, (*cassie.loops, *cassie.contacts))
    q, v = scene.state("standing")
    bent = q.copy()
    bent[cassie.model.joints[cassie.model.getJointId("left-knee-op")].idx_q] -= 0.5
    return scene, q, v, bent


@pytest.fixture(scope="module")
def swinging():
    """Half a second of a four-bar that falls."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    return cp.simulate(scene, *scene.state(), duration=0.5, dt=0.005)
