"""Cables: lengths of lines over points of bodies, and how they change.

With points x_0 .. x_k on bodies or the world, d = x_{i+1} - x_i, n = |d|, u = d / n, and the slack

    c = l + sum r_j q_j - sum n            l the length; joint j pays out r_j [m/rad, 1]
    J = sum e_p . J_p + r,                 e_p = u_p - u_{p-1}, the pull on the point p at tension 1
    J' v = -sum [ u . (a_{i+1} - a_i) + (|d'|^2 - (u . d')^2) / n ]

a the classical accelerations at v' = 0. The points are pulleys without radius, over which the cable
slips without friction. Where the axes of joints stay, column i of J turns with q_j by

    K_ij = sum e_p . dJ_p,i/dq_j - sum (J_{i+1} - J_i)^T (1 - u u^T) (J_{i+1} - J_i) / n,
    dJ_p,i/dq_j = w_j x u_i    if i belongs to the joint of j or to one below it, else w_i x u_j

with w and u the angular velocity, and that of the point, of a unit of a coordinate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.joints import joints_with_turning_axes
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.rows.functions import BoundFunctions
from condyn_pin.errors import InvalidConstraint
