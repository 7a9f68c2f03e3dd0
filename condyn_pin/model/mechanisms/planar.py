"""Mechanisms in a plane: pendulum, chain, four-bars, five-bar, Andrews, compass walker."""

from __future__ import annotations

import math
from math import acos, cos, pi, sin
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.mechanisms.machine import (
    LICENCE,
    SOURCE,
    Machine,
    X,
    Y,
    Z,
    add_rod,
    hinge,
    in_plane,
    mechanism,
    round_rod,
    solid,
)
from condyn_pin.model.robot import Robot
from condyn_pin.model.soundness import MOST_JOINTS


@mechanism
def pendulum(*, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return a point mass on a massless rod that turns about the world's y axis.

    theta'' = -(g / length) sin(theta), with theta = 0 hanging.

    Parameters
    ----------
    length : float
        Length of the rod [m].
    mass : float
        Mass at its end [kg].

    Returns
    -------
    Robot
        One joint.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.
    """
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "pendulum"
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pivot")
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), tip)
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    return Robot(
        "pendulum",
        model,
        postures={"hanging": np.zeros(1), "horizontal": np.array([math.pi / 2])},
        actuated=("pivot",),
        source=SOURCE,
        licence=LICENCE,
    )


@mechanism
def chain(n: int = 10, *, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return an open chain of n equal rods in the world's x-z plane, hung up at one end.

    No loops. The first joint moves everything and the last one a single rod, so that

        cond(M) = 4 n^4, nearly,

    when the chain is straight, whatever length and mass: 4e4 for 10 rods, 4e8 for 100.

    Parameters
    ----------
    n : int
        Number of rods.
    length : float
        Of each rod [m].
    mass : float
        Of each rod [kg].

    Returns
    -------
    Robot
        A fixed base, n joints, no loops.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.
    """
    check_count("n", n, most=MOST_JOINTS)
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "chain"
    names = tuple(f"joint{k}" for k in range(n))
    joint, at = 0, 0.0
    for name in names:
        joint, at = add_rod(model, name, joint, at, length, mass), length
    down = np.zeros(n)
    down[0] = -math.pi / 2
    return Robot(
        "chain",
        model,
        postures={"hanging": down, "straight": np.zeros(n)},
        actuated=names,
        source=SOURCE,
        licence=LICENCE,
    )


@mechanism
def four_bar(
    *,
    ground: float = 0.7,
    crank: float = 0.3,
    coupler: float = 0.8,
    rocker: float = 0.6,
    density: float = 2.5,
) -> Robot:
    """Return a planar four-bar linkage of slender rods in the world's x-z plane.

    The tree is crank -> coupler and rocker, both on the ground; one ball loop joins coupler and
    rocker. Its 3 rows have rank 2 at every configuration, because nothing moves along y: the
    smallest mechanism on which an undamped solve gives NaN.

    Parameters
    ----------
    ground, crank, coupler, rocker : float
        Lengths of the four bars [m].
    density : float
        Mass of the rods per length [kg/m].

    Returns
    -------
    Robot
        Three joints, one ball loop, one motor: the crank.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number, or the bars cannot be closed.
    """
    check_positive(ground=ground, crank=crank, coupler=coupler, rocker=rocker, density=density)
    lengths = sorted((ground, crank, coupler, rocker))
    if lengths[3] >= sum(lengths[:3]):
        raise InvalidArgument(
            f"a bar of {lengths[3]} m cannot be closed by bars of {lengths[:3]} m: "
            "the longest must be shorter than the sum of the others"
        )
    model = pin.Model()
    model.name = "four_bar"
    first = add_rod(model, "crank", 0, 0.0, crank, density * crank)
    add_rod(model, "coupler", first, crank, coupler, density * coupler)
    add_rod(model, "rocker", 0, ground, rocker, density * rocker)
    return Robot(
        "four_bar",
        model,
        postures={"open": _open_posture(ground, crank, coupler, rocker)},
        loops=(Loop("coupler_tip", "rocker_tip", name="coupler_rocker"),),
        actuated=("crank",),
        source=SOURCE,
        licence=LICENCE,
    )


def _open_posture(ground: float, crank: float, coupler: float, rocker: float) -> Array:
    """Return angles at which the bars meet, in the middle of the crank's range."""
    # The crank's tip B is at a distance r from the rocker's pivot D; coupler and rocker reach it if
    # |coupler - rocker| < r < coupler + rocker, the crank if |ground - crank| < r < ground + crank.
    nearest = max(abs(coupler - rocker), abs(ground - crank))
    farthest = min(coupler + rocker, ground + crank)
    r = (nearest + farthest) / 2
    theta = math.acos((ground**2 + crank**2 - r**2) / (2 * ground * crank))
    B = crank * np.array([math.cos(theta), math.sin(theta)])
    D = np.array([ground, 0.0])
    along = (coupler**2 - rocker**2 + r**2) / (2 * r)
    up = math.sqrt(coupler**2 - along**2)
    e = (D - B) / r
    C = B + along * e + up * np.array([-e[1], e[0]])
    of_coupler, of_rocker = (math.atan2(*(C - end)[::-1]) for end in (B, D))
    return np.array([theta, of_coupler - theta, of_rocker])


@mechanism
def parallelogram() -> Robot:
    """Return two equal cranks with a coupler as long as the ground: mobility 1, but 2 when flat.

    Cranks of 0.3 m and 0.6 kg, a coupler of 0.5 m and 1 kg, in the world's x-z plane. Drawn, and at
    the posture ``home``, the cranks are at 60 deg.

    Returns
    -------
    Robot
        Three joints, a ball loop, one motor: the crank.

    Notes
    -----
    The row of the ball along y is redundant, always: rank 2. At the posture ``flat`` it drops to 1,
    for the bars can go on as a parallelogram or cross over. Near it the second singular value of J
    falls in proportion to the distance: a loop as badly conditioned as one likes.
    """
    ground, crank, theta = 0.5, 0.3, pi / 3  # [m], [m], [rad]
    made, R = Machine("parallelogram"), in_plane(theta)
    tip, bar = crank * R[:, 0], round_rod(crank, 0.6, 0.01)
    coupler = round_rod(ground, 1, 0.01)
    made.body("crank", "base", 0 * X, R, hinge("crank_pivot", -Y), bar)
    made.body("coupler", "crank", tip, in_plane(0), hinge("coupler_pivot", -Y), coupler)
    made.body("rocker", "base", ground * X, R, hinge("rocker_pivot", -Y), bar)
    made.connect("coupler_rocker", "coupler", "rocker", ground * X + tip)
    flat = {"crank_pivot": -theta, "coupler_pivot": theta, "rocker_pivot": -theta}
    return made.robot({"home": {}, "flat": flat}, "crank_pivot")


_HALF_GROUND, _CRANK, _DISTAL = 0.1, 0.2, 0.3  # [m]


@mechanism
def five_bar() -> Robot:
    """Return two cranks, each with a rod, joined at the tip in the world's x-z plane: mobility 2.

    With the left crank at theta, the elbows are at x = -+e and the left rod is at phi,

        e = half_ground - crank cos(theta),    cos(phi) = e / distal.

    Cranks of 0.2 m and 0.4 kg, rods of 0.3 m and 0.3 kg, pivots 0.2 m apart. Drawn, and at the
    posture ``home``, the cranks lean outwards by 30 deg; at ``upright`` they are vertical.

    Returns
    -------
    Robot
        Four joints, a ball loop, two motors.

    Notes
    -----
    All axes are parallel: the row of the ball along y is redundant, always, and the rank 2.
    ``Loop("tip_a", "tip_b", "planar", axis="y")`` is the same closure without it.
    """
    theta, phi = _angles(2 * pi / 3)
    new_theta, new_phi = _angles(pi / 2)
    made, upright = Machine("five_bar"), {}
    for side, sign in (("left", 1), ("right", -1)):
        pivot = -sign * _HALF_GROUND * X
        at_crank, at_rod = (in_plane(a if sign > 0 else pi - a) for a in (theta, phi))
        elbow = pivot + _CRANK * at_crank[:, 0]
        motor, bend = hinge(f"{side}_motor", -Y), hinge(f"{side}_elbow", -Y)
        crank, rod = round_rod(_CRANK, 0.4, 0.01), round_rod(_DISTAL, 0.3, 0.008)
        made.body(f"{side}_crank", "base", pivot, at_crank, motor, crank)
        made.body(f"{side}_rod", f"{side}_crank", elbow, at_rod, bend, rod)
        upright[f"{side}_motor"] = sign * (new_theta - theta)
        upright[f"{side}_elbow"] = sign * (new_phi - phi - new_theta + theta)
    made.connect("tip", "left_rod", "right_rod", elbow + _DISTAL * at_rod[:, 0])
    return made.robot({"home": {}, "upright": upright}, "left_motor", "right_motor")


def _angles(theta: float) -> tuple[float, float]:
    """Return the angles of the left crank and of its rod."""
    return theta, acos((_HALF_GROUND - _CRANK * cos(theta)) / _DISTAL)


@mechanism
def n_four_bar(n: int = 2, *, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return n + 1 cranks side by side, each tip joined to the next by a coupler.

    All 2 n + 1 rods are equal, and the pivots of the cranks one length apart, in the world's x-z
    plane. All cranks turn by the same angle theta, counted from x towards z, with

        ((n + 1) / 3 + n) theta'' = -((n + 1) / 2 + n) (g / length) cos(theta)

    as long as the cranks are not flat. At theta = 0 and pi each cell can also leave the
    parallelogram, the rank of J drops by n, and the mobility jumps from 1 to n + 1.

    Parameters
    ----------
    n : int
        Number of cells.
    length : float
        Of each rod [m].
    mass : float
        Of each rod [kg].

    Returns
    -------
    Robot
        2 n + 1 joints and n ball loops.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    nv = 2 n + 1, and n ball loops: 3 n rows of rank 2 n, since no joint moves along y. The
    benchmark starts at the posture ``square`` with the cranks at -1 rad/s; ``flat`` is singular.

    Source: problem A02 of the IFToMM library of computational benchmark problems.
    """
    check_count("n", n, most=MOST_JOINTS)
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "n_four_bar"
    for k in range(n + 1):
        crank = add_rod(model, f"crank{k}", 0, k * length, length, mass)
        if k < n:
            add_rod(model, f"coupler{k}", crank, length, length, mass)
    loops = (
        Loop(f"coupler{k}_tip", f"crank{k + 1}_tip", name=f"coupler{k}_crank{k + 1}")
        for k in range(n)
    )
    return Robot(
        "n_four_bar",
        model,
        postures={"square": _parallel(n, math.pi / 2), "flat": _parallel(n, 0.0)},
        loops=tuple(loops),
        actuated=("crank0",),
        source=SOURCE,
        licence=LICENCE,
    )


def _parallel(n: int, theta: float) -> Array:
    """Return the posture with all cranks at theta and all couplers level."""
    q = np.full(2 * n + 1, theta)
    q[1::2] = -theta
    return q


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


def compass_walker(
    *, slope: float = 0.05, length: float = 1.0, hip: float = 10.0, leg: float = 5.0
) -> Robot:
    """Return two legs on a hip that walk down a slope without a motor.

    q = (x, z, left, right): the hip along and off the ground, and the angles of the legs from the
    normal of the slope, positive where the foot is behind. Legs have their mass in the middle. The
    foot that swings is on the ground where

        left + right = 0,

    and where both legs are side by side: there it has to be lifted, which is not modelled.

    Parameters
    ----------
    slope : float
        Of the ground, down towards x: gravity is inclined by it [rad].
    length : float
        Of a leg [m].
    hip, leg : float
        Masses [kg].

    Returns
    -------
    Robot
        Its feet are ready-made contacts: a scene has one of them.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    References
    ----------
    Goswami, Thuilot, Espiau. A study of the passive gait of a compass-like biped robot: symmetry
    and chaos. International Journal of Robotics Research 17, 1998.
    """
    check_positive(length=length, hip=hip, leg=leg)
    incline = float(finite("slope", slope, ()))
    model = pin.Model()
    model.name = "compass_walker"
    here, joint = pin.SE3.Identity(), 0
    for name, kind in (("x", pin.JointModelPX()), ("z", pin.JointModelPZ())):
        joint = model.addJoint(joint, kind, here, name)
    model.appendBodyToJoint(joint, _lump(hip, 0.0), here)
    for name in ("left", "right"):
        on = model.addJoint(joint, pin.JointModelRY(), here, name)
        model.appendBodyToJoint(on, _lump(leg, length / 2), here)
        foot = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))
        model.addFrame(pin.Frame(f"{name}_foot", on, 0, foot, pin.FrameType.OP_FRAME))
    model.gravity.linear = 9.81 * np.array([np.sin(incline), 0.0, -np.cos(incline)])
    return Robot(
        "compass_walker",
        model,
        postures={"upright": np.array([0.0, length, 0.0, 0.0])},
        contacts=(PointContact("left_foot"), PointContact("right_foot")),
        source=SOURCE,
        licence=LICENCE,
    )


def _lump(mass: float, below: float) -> object:
    """Return a point mass below a joint."""
    return pin.Inertia(mass, np.array([0.0, 0.0, -below]), np.zeros((3, 3)))
