"""Forces in bearings: the wrench that each joint passes from its parent to its child.

Newton and Euler of body i, and of all that it carries, in the frame of joint i:

    f_i = I_i (a_i - g) + v_i x* I_i v_i - w_i + sum over children of iX_c f_c

w_i has the constraints and the forces from outside that act on the body. Along its motions S_i a
joint transmits what drives it, S_i^T f_i; the rest is what the bearing carries. Where loops close,
the constraint itself is the bearing.

Where rows are redundant, lam may change by any N z with J^T N = 0. A component of f is determined
if no such change alters it where the loops are closed: those of a state from sensors are open, and
J^T N is not quite zero there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array, read_only, rounded
from condyn_pin._core.models import whole_data
from condyn_pin.constraints.forces import AppliedForce, Loads
from condyn_pin.dynamics.at_state import equations_of, left_out_at, moves_back
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce, Sites

_ROUNDING: Final = 1e-9  # change of a component that is determined, relative to the largest
_AXES: Final = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True, eq=False, repr=False)
class Bearing:
    """Wrench on the child of a joint by its parent, or on the second body of a loop by the first.

    Attributes
    ----------
    name : str
        Of the joint, or of the constraint that closes a loop.
    wrench : (6,) array
        Force, and moment about the origin of the joint, in the axes of the child's joint frame;
        of a loop as `Solution.forces` has it, on the other body [N, N m].
    determined : (6,) bool array
        Which components the equations determine [1]. Others depend on how redundant constraints
        share their load, and are those of the smallest forces.
    drive : (k,) array
        Part along the motions of the joint, S^T f [N m, N]: what motor, spring, damper and coupled
        joints do together, less the rotor's inertia. Empty for a loop.
    at : (3,) array
        Where the wrench acts, in the world [m].
    """

    name: str
    wrench: Array
    determined: Array
    drive: Array
    at: Array
    _rotation: Array
    _motions: Array  # S (6, k)

    @property
    def carried(self) -> Array:
        """Wrench (6,) without its part along the motions of the joint [N, N m]."""
        S = self._motions
        if not S.shape[1]:
            return self.wrench
        return np.asarray(self.wrench - S @ np.linalg.lstsq(S, self.wrench)[0])

    def in_world(self) -> Array:
        """The wrench (6,) in the axes of the world, about the same point [N, N m]."""
        return np.asarray((self.wrench.reshape(2, 3) @ self._rotation.T).ravel())

    def __repr__(self) -> str:
        free = [axis for axis, known in zip(_AXES, self.determined, strict=True) if not known]
        unknown = f"; {', '.join(free)} not determined" if free else ""
        return f"Bearing({self.name}: {rounded(self.wrench)}{unknown})"


def bearings(
    scene: Scene, q: Array, v: Array, a: Array, lam: Array, forces: Sequence[AppliedForce] = ()
) -> dict[str, Bearing]:
    """Wrenches in the joints of the tree and in the loops, by name; see `Solution.bearings`."""
    model = scene.robot.unedited
    data, equations = whole_data(model), equations_of(scene)
    load = Loads(scene.robot, model, data).at(q, forces) if forces else None
    closed, loose = _redundant(scene, q, v)

    def passed_on(q: Array, lam: Array) -> Array:
        """Wrench in each joint (njoints, 6), with forces lam."""
        wrenches = equations.wrenches_at(q, lam)
        pin.rnea(model, data, q, v, a, load.added_to(wrenches) if load else wrenches)
        return np.array([f.vector for f in data.f])

    scale = max(float(np.abs(lam).max(initial=0.0)), 1.0)
    there = passed_on(closed, lam)
    pushed = [(passed_on(closed, lam + scale * n) - there) / scale for n in loose]
    fixed = _determined(np.array(pushed).reshape(-1, model.njoints, 6))
    f = passed_on(q, lam)
    pin.computeJointJacobians(model, data, q)
    found = {}
    for i in range(1, model.njoints):
        joint, oMi = model.joints[i], data.oMi[i]
        J = pin.getJointJacobian(model, data, i, LOCAL).reshape(6, -1)
        S = np.array(J[:, joint.idx_v : joint.idx_v + joint.nv])
        found[str(model.names[i])] = Bearing(
            str(model.names[i]), read_only(f[i]), fixed[i], read_only(S.T @ f[i]),
            np.array(oMi.translation), np.array(oMi.rotation), S,
        )  # fmt: skip
    return found | _of_loops(
        Sites(scene, q, equations), lam, Sites(scene, closed, equations), loose
    )


def _redundant(scene: Scene, q: Array, v: Array) -> tuple[Array, Array]:
    """Configuration with closed loops, and combinations N^T of rows that are redundant there."""
    if not scene.rows or not left_out_at(scene, q).N.size:
        return q, np.zeros((0, scene.rows))
    closed = np.array(pin.integrate(scene.robot.unedited, q, -moves_back(scene, q, v)[0]))
    return closed, left_out_at(scene, closed).N.T


def _of_loops(sites: Sites, lam: Array, closed: Sites, loose: Array) -> dict[str, Bearing]:
    """Wrenches in the constraints between two frames of bodies, on the second body."""

    def on_second(sites: Sites, lam: Array) -> dict[str, ConstraintForce]:
        forces = sites.forces(lam).items()
        return {name: each.on_other() for name, each in forces if each.frame}

    changes = [on_second(closed, n) for n in loose]
    found = {}
    for name, force in on_second(sites, lam).items():
        if force.on == "world":
            continue
        pushed = np.array([_six(each[name]) for each in changes]).reshape(-1, 1, 6)
        found[name] = Bearing(
            name, read_only(_six(force)), _determined(pushed)[0], np.zeros(0),
            force.at, force.rotation, np.zeros((6, 0)),
        )  # fmt: skip
    return found


def _six(force: ConstraintForce) -> Array:
    return np.concatenate((force.components, np.zeros(6 - len(force.components))))


def _determined(pushed: Array) -> Array:
    """Mask (n, 6) of what changes of lam along redundant rows do not alter, by (k, n, 6)."""
    largest = np.abs(pushed).max(axis=0, initial=0.0)
    return np.asarray(largest <= _ROUNDING * max(1.0, float(largest.max(initial=0.0))))
