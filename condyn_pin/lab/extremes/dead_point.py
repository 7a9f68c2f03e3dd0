"""A four-bar near the end of its rocker's swing."""

import math

import numpy as np

from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme, powers
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.four_bar import four_bar

_GROUND, _CRANK, _COUPLER, _ROCKER = 0.7, 0.6, 0.3, 0.6


@extreme(*powers(-1, -9, -1), 0.0)
def dead_point(severity: float, rng: Rng) -> Case:
    """Angle by which coupler and rocker are not in line [rad].

    There the linkage turns back: the crank stands still whatever the speed of the others. The rank
    does not drop, but accelerations of the crank are of second order.
    """
    linkage = four_bar(ground=_GROUND, crank=_CRANK, coupler=_COUPLER, rocker=_ROCKER)
    # the triangle of the two pivots and the crank's tip, with coupler and rocker as its third side
    reach = math.sqrt(_COUPLER**2 + _ROCKER**2 + 2 * _COUPLER * _ROCKER * math.cos(severity))
    theta = math.acos((_GROUND**2 + _CRANK**2 - reach**2) / (2 * _GROUND * _CRANK))
    B = _CRANK * np.array([math.cos(theta), math.sin(theta)])
    along = math.atan2(-B[1], _GROUND - B[0])
    # in line, B looks at the rocker's pivot; bent, it looks past it
    past = math.atan2(_ROCKER * math.sin(severity), _COUPLER + _ROCKER * math.cos(severity))
    coupler = along + past
    C = B + _COUPLER * np.array([math.cos(coupler), math.sin(coupler)])
    rocker = math.atan2(C[1], C[0] - _GROUND)
    q = np.array([theta, coupler - theta, rocker])
    scene = closed(linkage)
    v = project_velocity(scene, q, rng.normal(size=3))
    return Case(scene, q, v, rng.normal(size=3))
