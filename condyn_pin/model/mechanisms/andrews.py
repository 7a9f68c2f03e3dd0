"""Andrews' squeezing mechanism: the standard hard case of multibody codes."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.model.mechanisms.machine import Machine, Z, hinge, solid
from condyn_pin.model.mechanisms.registry import mechanism
from condyn_pin.model.robot import Robot

# Pivots on the ground: K1 at the origin, K5 and K7 at A, K3 at B; the spring ends at C [m]
_A, _B, _C = np.array([(-0.06934, -0.00227, 0), (-0.03635, 0.03273, 0), (0.014, 0.072, 0)])

# Angles at the start: they close the loops [rad]
_BETA = -0.0617138900142764496358948458001
_THETA = 0.0
_GAMMA = 0.455279819163070380255912382449
_PHI = 0.222668390165885884674473185609
_DELTA = 0.487364979543842550225598953530
_OMEGA = -0.222668390165885884674473185609
_EPSILON = 1.23054744454982119249735015568


@mechanism
def andrews() -> Robot:
    """Return seven bodies that meet in three loops at one point E: mobility 1.

        E = R(beta) (rr, 0) + R(beta + theta) (-d, 0)
          = B + R(gamma) (0, -ss)
          = A + R(delta) (zt, 0) + R(delta + phi) (0, -e)
          = A + R(epsilon) (0, -u) + R(epsilon + omega) (zf, 0)

    A crank of 7 mm drives it. All hinges are along z, and so is gravity, which does no work. Joints
    are called by the coordinates of the literature and count as they do; in the tree they come in
    the order beta, theta, gamma, delta, phi, epsilon, omega. Its posture ``start``, as drawn, has
    the initial values of the literature: E is closed to 1e-17 m.

    Returns
    -------
    Robot
        Seven joints, three ball loops, one motor: beta.

    Notes
    -----
    The spring of the problem, 4530 N/m and 77.85 mm long at rest, is left to the caller: it acts
    between the frames ``spring_end`` on K3 and ``spring_anchor``. With its torque on gamma and
    0.033 N m on beta the answer at ``start`` is that of the literature: 14222.4 rad/s^2 for beta,
    98.57 and -6.12 N at E. Each loop is a ball of 3 rows; that along z is redundant and exactly
    zero. ``Loop(..., "planar", axis="z")`` has none.

    Source: problem A03 of the IFToMM library of computational benchmark problems, and VII.7 of
    Hairer, Wanner. Solving Ordinary Differential Equations II. Springer, 1996.
    """
    rr, d, e, ea, fa, zf = 7e-3, 28e-3, 2e-2, 1421e-5, 1421e-5, 2e-2
    zt, u, sc, sd = 4e-2, 4e-2, 18e-3, 2e-2
    R1, R2 = _about_z(_BETA), _about_z(_BETA + _THETA)
    R3, R5, R7 = _about_z(_GAMMA), _about_z(_DELTA), _about_z(_EPSILON)
    R4, R6 = _about_z(_DELTA + _PHI), _about_z(_EPSILON + _OMEGA)
    beta, theta, gamma = (
        hinge("beta", Z, _BETA),
        hinge("theta", Z, _THETA),
        hinge("gamma", Z, _GAMMA),
    )
    delta, phi = hinge("delta", Z, _DELTA), hinge("phi", Z, _PHI)
    epsilon, omega = hinge("epsilon", Z, _EPSILON), hinge("omega", Z, _OMEGA)
    made = Machine("andrews")
    made.body("K1", "base", (0, 0, 0), R1, beta, _flat(0.04325, 92e-5, 0, 2.194e-6))
    made.body("K2", "K1", R1 @ (rr, 0, 0), R2, theta, _flat(0.00365, -115e-4, 0, 4.410e-7))
    made.body("K3", "base", _B, R3, gamma, _flat(0.02373, -1043e-5, -1874e-5, 5.255e-6))
    made.body("K5", "base", _A, R5, delta, _flat(0.07050, 2308e-5, 916e-5, 1.169e-5))
    made.body("K4", "K5", _A + R5 @ (zt, 0, 0), R4, phi, _flat(0.00706, 0, ea - e, 5.667e-7))
    made.body("K7", "base", _A, R7, epsilon, _flat(0.05498, -449e-5, -1228e-5, 1.912e-5))
    made.body("K6", "K7", _A + R7 @ (0, -u, 0), R6, omega, _flat(0.00706, zf - fa, 0, 5.667e-7))
    made.mark("spring_anchor", "base", _C)
    made.mark("spring_end", "K3", _B + R3 @ (sd, -sc, 0))
    E = R1 @ (rr, 0, 0) + R2 @ (-d, 0, 0)
    for name in ("K3", "K4", "K6"):
        made.connect(f"K2_{name}", "K2", name, E)
    return made.robot({"start": {}}, "beta")


def _flat(mass: float, x: float, y: float, moment: float) -> Any:
    """Return a body that moves in the x-y plane: only its moment about z plays a part."""
    return solid(mass, (x, y, 0), (moment, moment, moment))


def _about_z(angle: float) -> Array:
    return np.array([[cos(angle), -sin(angle), 0], [sin(angle), cos(angle), 0], [0, 0, 1]])
