"""Symbolic equations: M, h, J, gamma and the KKT system of a small scene in SymPy.

With J_i(q) the Jacobian of body i in its own axes, V_i = J_i v its twist, I_i its inertia, and a
dot for d/dt along q' = T(q) v,

    M = sum_i J_i^T I_i J_i,     h = sum_i J_i^T (I_i (J_i v)' + V_i x* I_i V_i - weight_i),
    J v = 0 of the constraints,  gamma = (J v)',
    [M  -J^T] [a  ]   [tau - h]
    [J    0 ] [lam] = [-gamma ]

gamma is that of `Workspace.terms` where J v = 0. Numbers of the model stay numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import finite
from condyn_pin._core.models import axes
from condyn_pin.constraints.rows.bound import (
    Terms,
)
from condyn_pin.constraints.rows.symbolic import (
    exact_matrix,
    exact_number,
    skew_matrix,
    symbolic_rows,
)
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_not_driven, check_scene
from condyn_pin.errors import MissingExtra, UnsupportedConstraint


@dataclass(frozen=True, eq=False, repr=False)
class SymbolicScene:
    """Equations of a scene in symbols, as matrices of SymPy.

    M a + h = tau + J^T lam,    J a + gamma = 0

    Attributes
    ----------
    scene : Scene
    q, v, tau, lam : sympy.Matrix
        Symbols of configuration (nq), velocity (nv), torques (nv) and constraint forces (m);
        entries of quaternions are x y z w, and of unit norm.
    q_rate : sympy.Matrix
        Rates q' of q (nq) at the velocity v.
    M, h : sympy.Matrix
        Mass matrix (nv, nv), armature included, and Coriolis, centrifugal and gravity torques (nv).
    J, gamma : sympy.Matrix
        Constraint Jacobian (m, nv), and its rate along v times v (m).
    """

    scene: Scene
    q: Any
    v: Any
    tau: Any
    lam: Any
    q_rate: Any
    M: Any
    h: Any
    J: Any
    gamma: Any

    def kkt(self) -> tuple[Any, Any]:
        """Return K (nv + m, nv + m) and k of K (a, lam) = k, as matrices of SymPy."""
        sp = _sympy()
        m = self.J.rows
        K = sp.Matrix(sp.BlockMatrix([[self.M, -self.J.T], [self.J, sp.zeros(m)]]))
        return K, sp.Matrix.vstack(self.tau - self.h, -self.gamma)

    def terms(self, q: ArrayLike, v: ArrayLike) -> Terms:
        """Return the numbers of M, h, J and gamma at q (nq,) and v (nv,); a_ref is zero.

        Raises
        ------
        InvalidArgument
            If an argument has a wrong size or is not finite.
        """
        model = self.scene.robot.model
        at = (*normalised(model, "q", q).tolist(), *finite("v", v, model.nv).tolist())
        M, h, J, gamma = (np.array(part, dtype=float) for part in self._numbers(*at))
        rows = self.scene.rows
        return Terms(M, h.ravel(), J.reshape(rows, model.nv), gamma.ravel(), np.zeros(rows))

    @cached_property
    def _numbers(self) -> Callable[..., Sequence[Any]]:
        sp = _sympy()
        parts = (self.M, self.h, self.J, self.gamma)
        return sp.lambdify([*self.q, *self.v], parts, "numpy", cse=True)  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        return (
            f"SymbolicScene({self.scene.robot.name}: q = ({', '.join(map(str, self.q))}), "
            f"{self.J.rows} rows)"
        )


def symbolic(scene: Scene) -> SymbolicScene:
    """Derive the equations of a scene as formulas; see `Scene.symbolic`."""
    check_scene(scene)
    check_bilateral(scene)
    check_not_driven(scene, "symbolic")
    sp, robot = _sympy(), scene.robot
    robot.check_unedited()
    model = robot.unedited
    bodies = _Bodies(sp, model)
    v, nv = bodies.v, model.nv

    def rate(x: Any) -> Any:
        return x.jacobian(bodies.q) * bodies.q_rate

    M, h = sp.diag(*[exact_number(sp, x) for x in model.armature]), sp.zeros(nv, 1)
    gravity = exact_matrix(sp, model.gravity.linear)
    for i in range(1, model.njoints):
        if not model.inertias[i].mass and not np.any(model.inertias[i].inertia):
            continue
        (R, _), Ji = bodies.placements[i], bodies.jacobians[i]
        inertia = _spatial_inertia(sp, model.inertias[i])
        twist = Ji * v
        momentum = inertia * twist
        weight = inertia * sp.Matrix.vstack(R.T * gravity, sp.zeros(3, 1))
        M += Ji.T * inertia * Ji
        h += Ji.T * (inertia * rate(twist) + _force_cross(sp, twist, momentum) - weight)
    rows = [symbolic_rows(sp, bodies, bound) for bound in scene.bounds]
    J = sp.Matrix.vstack(sp.zeros(0, nv), *rows)
    tau, lam = (_vector(sp, name, size) for name, size in (("tau", nv), ("lam", scene.rows)))
    gamma = rate(J * v) if scene.rows else sp.zeros(0, 1)
    return SymbolicScene(scene, bodies.q, v, tau, lam, bodies.q_rate, M, h, J, gamma)


def _vector(sp: Any, name: str, size: int) -> Any:
    """Symbols of a vector, numbered."""
    return sp.Matrix(size, 1, sp.symbols(f"{name}_:{size}", real=True))


def _sympy() -> Any:
    try:
        import sympy
    except ImportError as error:
        raise MissingExtra(
            'sympy is missing: python -m pip install "condyn_pin[symbolic]"'
        ) from error
    return sympy


# Bodies: where they are, and how they move with v.


class _Bodies:
    """Placements (R, p) in the world and Jacobians (6, nv) in own axes of all joints' bodies."""

    def __init__(self, sp: Any, model: Any) -> None:
        self.sp, self.nv = sp, int(model.nv)
        names = list(model.names)
        self.q = sp.Matrix(sp.symbols(_symbol_names(model, "nq", ""), real=True))
        self.v = sp.Matrix(sp.symbols(_symbol_names(model, "nv", "v_"), real=True))
        self.q_rate = sp.zeros(model.nq, 1)
        self.placements = [(sp.eye(3), sp.zeros(3, 1))]
        self.jacobians = [sp.zeros(6, model.nv)]
        for i in range(1, model.njoints):
            joint = model.joints[i]
            at_q = slice(joint.idx_q, joint.idx_q + joint.nq)
            at_v = slice(joint.idx_v, joint.idx_v + joint.nv)
            q, v = self.q[at_q, :], self.v[at_v, :]
            S = exact_matrix(sp, axes(joint, pin.neutral(model)))
            R, p, q_rate = _moved(sp, joint, names[i], S, q, v)
            self.q_rate[at_q, :] = q_rate
            fixed = model.jointPlacements[i]
            R0, p0 = exact_matrix(sp, fixed.rotation), exact_matrix(sp, fixed.translation)
            within = R0 * R, p0 + R0 * p  # of the joint in its parent
            parent = int(model.parents[i])
            self.placements.append(_times(self.placements[parent], within))
            J = _turned(sp, within) * self.jacobians[parent]
            J[:, at_v] = J[:, at_v] + S
            self.jacobians.append(J)

    def frame(self, joint: int, placement: Any) -> tuple[tuple[Any, Any], Any]:
        """Return (R, p) in the world and the Jacobian in own axes of a frame on a joint."""
        sp = self.sp
        within = exact_matrix(sp, placement.rotation), exact_matrix(sp, placement.translation)
        J = _turned(sp, within) * self.jacobians[joint]
        return _times(self.placements[joint], within), J


def _symbol_names(model: Any, size: str, prefix: str) -> list[str]:
    found = []
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        word = prefix + "".join(c if c.isalnum() else "_" for c in name)
        count = int(getattr(joint, size))
        found += [word] if count == 1 else [f"{word}_{k}" for k in range(count)]
    return found


def _moved(sp: Any, joint: Any, name: str, S: Any, q: Any, v: Any) -> tuple[Any, Any, Any]:
    """Rotation, translation and q' of a joint at q and v, with its motion subspace S (6, nv)."""
    kind, still = joint.shortname().removeprefix("JointModel"), sp.zeros(3, 1)
    if kind in ("RX", "RY", "RZ", "RevoluteUnaligned"):
        return _about(sp, S[3:, 0], sp.cos(q[0]), sp.sin(q[0])), still, v
    if kind.startswith(("RUB", "RevoluteUnbounded")):
        c, s = q
        return _about(sp, S[3:, 0], c, s), still, sp.Matrix([-s * v[0], c * v[0]])
    if kind in ("PX", "PY", "PZ", "PrismaticUnaligned", "Translation"):
        return sp.eye(3), S[:3, :] * q, v
    if kind == "Planar":
        x, y, c, s = q
        turned = sp.Matrix([[c, -s], [s, c]]) * v[:2, :]
        R = _about(sp, sp.Matrix([0, 0, 1]), c, s)
        return R, sp.Matrix([x, y, 0]), sp.Matrix([*turned, -s * v[2], c * v[2]])
    if kind == "Spherical":
        R, rate = _by_quaternion(sp, q, v)
        return R, still, rate
    if kind == "FreeFlyer":
        R, rate = _by_quaternion(sp, q[3:, :], v[3:, :])
        return R, q[:3, :], sp.Matrix.vstack(R * v[:3, :], rate)
    raise UnsupportedConstraint(
        f"joint {name!r}: a {kind} has no formula here; hinges, sliders, planes, balls and "
        "free-flyers have"
    )


def _about(sp: Any, e: Any, c: Any, s: Any) -> Any:
    """Rotation about a unit axis, by its cosine and sine."""
    return c * sp.eye(3) + s * skew_matrix(sp, e) + (1 - c) * e * e.T


def _by_quaternion(sp: Any, q: Any, w: Any) -> tuple[Any, Any]:
    """Rotation of a unit quaternion x y z w, and its rate at an angular velocity in own axes."""
    u, real = q[:3, :], q[3]
    R = (2 * real**2 - 1) * sp.eye(3) + 2 * real * skew_matrix(sp, u) + 2 * u * u.T
    rate = sp.Matrix.vstack(real * w + u.cross(w), -sp.Matrix([u.dot(w)])) / 2
    return R, rate


# Placements (R, p), twists and inertias in symbols, linear part first.


def _times(one: tuple[Any, Any], two: tuple[Any, Any]) -> tuple[Any, Any]:
    return one[0] * two[0], one[1] + one[0] * two[1]


def _turned(sp: Any, placement: tuple[Any, Any]) -> Any:
    """Matrix (6, 6) that brings twists of a parent into a frame placed within it."""
    R, p = placement
    corner = -R.T * skew_matrix(sp, p)
    return sp.Matrix(sp.BlockMatrix([[R.T, corner], [sp.zeros(3), R.T]]))


def _spatial_inertia(sp: Any, inertia: Any) -> Any:
    return exact_matrix(sp, inertia.matrix())


def _force_cross(sp: Any, twist: Any, momentum: Any) -> Any:
    """V x* h: how fast a momentum turns with its axes."""
    v, w, p, L = twist[:3, :], twist[3:, :], momentum[:3, :], momentum[3:, :]
    return sp.Matrix.vstack(w.cross(p), v.cross(p) + w.cross(L))
