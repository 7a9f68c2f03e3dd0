"""Andrews' squeezing mechanism, with the names and the numbers of the literature.

Problem A03 of the IFToMM library of computational benchmark problems, and VII.7 of Hairer and
Wanner, Solving Ordinary Differential Equations II. All hinges are along z: gravity does no work.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np
from writing.mjcf import Mjcf, Solid, Z, hinge

# Pivots on the ground: K1 at the origin, K5 and K7 at A, K3 at B; the spring ends at C [m]
A, B, C = np.array([(-0.06934, -0.00227, 0), (-0.03635, 0.03273, 0), (0.014, 0.072, 0)])

# Angles at the start: they close the loops [rad]
BETA = -0.0617138900142764496358948458001
THETA = 0.0
GAMMA = 0.455279819163070380255912382449
PHI = 0.222668390165885884674473185609
DELTA = 0.487364979543842550225598953530
OMEGA = -0.222668390165885884674473185609
EPSILON = 1.23054744454982119249735015568


def andrews() -> Mjcf:
    """Write seven bodies that meet in three loops at one point E: mobility 1.

        E = R(beta) (rr, 0) + R(beta + theta) (-d, 0)
          = B + R(gamma) (0, -ss)
          = A + R(delta) (zt, 0) + R(delta + phi) (0, -e)
          = A + R(epsilon) (0, -u) + R(epsilon + omega) (zf, 0)

    A spring from (sd, -sc) on K3 to C belongs to the problem, 4530 N/m and 77.85 mm long at rest;
    plain MJCF has none, so its ends are marked as sites.
    """
    rr, d, e, ea, fa, zf = 7e-3, 28e-3, 2e-2, 1421e-5, 1421e-5, 2e-2
    zt, u, sc, sd = 4e-2, 4e-2, 18e-3, 2e-2
    R1, R2 = _about_z(BETA), _about_z(BETA + THETA)
    R3, R5, R7 = _about_z(GAMMA), _about_z(DELTA), _about_z(EPSILON)
    R4, R6 = _about_z(DELTA + PHI), _about_z(EPSILON + OMEGA)
    beta, theta = hinge("beta", Z, BETA), hinge("theta", Z, THETA)
    gamma, delta, phi = hinge("gamma", Z, GAMMA), hinge("delta", Z, DELTA), hinge("phi", Z, PHI)
    epsilon, omega = hinge("epsilon", Z, EPSILON), hinge("omega", Z, OMEGA)
    made = Mjcf("andrews")
    made.body("K1", "base", (0, 0, 0), R1, beta, _flat(0.04325, 92e-5, 0, 2.194e-6))
    made.body("K2", "K1", R1 @ (rr, 0, 0), R2, theta, _flat(0.00365, -115e-4, 0, 4.410e-7))
    made.body("K3", "base", B, R3, gamma, _flat(0.02373, -1043e-5, -1874e-5, 5.255e-6))
    made.body("K5", "base", A, R5, delta, _flat(0.07050, 2308e-5, 916e-5, 1.169e-5))
    made.body("K4", "K5", A + R5 @ (zt, 0, 0), R4, phi, _flat(0.00706, 0, ea - e, 5.667e-7))
    made.body("K7", "base", A, R7, epsilon, _flat(0.05498, -449e-5, -1228e-5, 1.912e-5))
    made.body("K6", "K7", A + R7 @ (0, -u, 0), R6, omega, _flat(0.00706, zf - fa, 0, 5.667e-7))
    E = R1 @ (rr, 0, 0) + R2 @ (-d, 0, 0)
    for name in ("K3", "K4", "K6"):
        made.connect(f"K2_{name}", "K2", name, E)
    made.site("spring_end", "K3", B + R3 @ (sd, -sc, 0))
    made.site("spring_anchor", "base", C)
    made.motors("beta")
    made.posture("start", {})
    return made


def _flat(mass: float, x: float, y: float, moment: float) -> Solid:
    """Return a body that moves in the x-y plane: only its moment about z plays a part."""
    return Solid(mass, (x, y, 0), (moment, moment, moment))


def _about_z(angle: float) -> np.ndarray:
    return np.array([[cos(angle), -sin(angle), 0], [sin(angle), cos(angle), 0], [0, 0, 1]])
