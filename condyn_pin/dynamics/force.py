"""ConstraintForce: a force that knows on whom it acts, by whom, where, and in which axes.

Of the pair of forces that a constraint is, the one on the first-named body counts; the other body
feels the opposite. Both do the generalised force J^T lam together, over the rows of the constraint.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, AsArray, read_only
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


@dataclass(frozen=True, eq=False)
class Sites:
    """Where the constraints of a scene are at one configuration; found when first asked for."""

    scene: Scene
    q: Array
    equations: Equations | None = None

    @cached_property
    def placements(self) -> list[Any]:
        """The frames c1 and c2 of each constraint in the world; None for a coupling."""
        return self._equations().placements(self.q)

    @cached_property
    def jacobian(self) -> Array:
        """The constraint Jacobian J (m, nv)."""
        return self._equations().jacobian(self.q)

    def _equations(self) -> Equations:
        return self.equations or Equations(self.scene.robot.unedited, self.scene.bounds)

    def forces(self, lam: Array) -> dict[str, ConstraintForce]:
        """Return the forces lam (m,) by name, each on the first-named body."""
        bounds = enumerate(self.scene.bounds)
        return {bound.name: _force(self, i, lam[bound.rows]) for i, bound in bounds}


@dataclass(frozen=True, eq=False, repr=False)
class ConstraintForce(AsArray):
    """The force of one constraint on one of its two bodies; it works as the array of its numbers.

    Attributes
    ----------
    name : str
        Of the constraint.
    components : (3,), (6,) or (1,) array
        Force [N], or force and moment [N, N m] for kinds that transmit moments, in the axes of
        `frame`; what a kind does not transmit is zero. One number for a coupling: the force along
        the joint's coordinate [N m or N]. Impulses have [N s, N m s] in their place.
    on, by : str
        The frame on whose body it acts, and the one whose body exerts it, as the constraint names
        them; "world" is the ground. For a coupling, joints.
    frame : str
        Whose axes the components are in; empty for a coupling. For a `PlanarContact` it is the
        plane, z along its normal; for what rolls, the directions of its rows.
    lam : (rows,) array
        The rows of the constraint, which both forces of the pair belong to.
    """

    name: str
    components: Array
    on: str
    by: str
    frame: str
    lam: Array
    _sites: Sites
    _index: int
    _first: bool  # whether it acts on the first-named body

    @property
    def at(self) -> Array:
        """The point of the world (3,) at which it acts [m]."""
        bound = self._sites.scene.bounds[self._index]
        return bound.acts_at(*self._ends, on_first=self._first)

    @property
    def scene(self) -> Scene:
        """The scene that it is a force of."""
        return self._sites.scene

    @property
    def constraint(self) -> Constraint:
        """The constraint that exerts it."""
        return self._sites.scene.constraints[self._index]

    @property
    def rotation(self) -> Array:
        """The axes of its components in the world (3, 3), column by column."""
        return np.array(self._ends[0].rotation)  # c1's axes

    def in_world(self) -> Array:
        """Return it in the axes of the world, still at `at`: (3,) or (6,)."""
        R = self.rotation
        return np.asarray((self.components.reshape(-1, 3) @ R.T).ravel())

    def on_other(self) -> ConstraintForce:
        """Return the opposite force: on the other body, in the same axes."""
        b = self._sites.scene.bounds[self._index]
        scale = b.reaction(on_first=self._first)
        return ConstraintForce(
            self.name, read_only(-scale * self.components), self.by, self.on, self.frame, self.lam,
            self._sites, self._index, not self._first,
        )  # fmt: skip

    def generalized(self) -> Array:
        """Return the generalised force (nv,) of the pair, J^T lam over its rows [N, N m]."""
        rows = self._sites.scene.bounds[self._index].rows
        return np.asarray(self._sites.jacobian[rows].T @ self.lam)

    @property
    def _ends(self) -> tuple[Any, Any]:
        ends: tuple[Any, Any] | None = self._sites.placements[self._index]
        if ends is None:
            raise InvalidArgument(f"{self.name}: a coupling acts along joints, at no point")
        return ends

    def __repr__(self) -> str:
        numbers = np.array2string(self.components, precision=4, suppress_small=True)
        axes = f", axes of {self.frame}" if self.frame else ""
        return f"ConstraintForce({self.name}: {numbers} on {self.on} by {self.by}{axes})"


def pulling(forces: dict[str, ConstraintForce], sites: Sites, unit: str = "N") -> tuple[str, ...]:
    """Sentences on contacts with the world that pull, as no ground does.

    The normal is the z axis of a `SurfaceContact` and that of the plane of a `PlanarContact` and
    of what rolls. A point or a line has none: the vertical stands for it, if there is gravity.
    Where rows are redundant, forces N z may be added, J^T N = 0: a normal force counts that no z
    changes, and else the least pull that some z leaves.
    """
    up = upward(sites.scene)
    largest = max((float(np.abs(f.components).max()) for f in forces.values()), default=0.0)
    least = -tolerances.SOLVED * largest
    pressing = [each for each in sites.scene.constraints if each.presses]
    normals = {
        each.name: float(force[2] if each.has_normal else force.in_world()[:3] @ up)
        for each in pressing
        for force in (forces[each.name],)
    }
    pulls = [each for each in pressing if normals[each.name] < least]
    if not pulls:
        return ()
    shared = shared_normals(sites, normals)
    said = [
        pull_text(each, f"{-normals[each.name]:.4g} {unit}")
        for each in pulls
        if each.name not in shared.names
    ]
    if len(said) < len(pulls) and shared.most < least:
        said.append(shared_text(shared, f"{-shared.most:.4g} {unit}"))
    return tuple(said)


class SharedNormals(NamedTuple):
    """Normal forces that redundant rows share among contacts.

    Attributes
    ----------
    names : tuple of str
        Contacts whose normal force is not determined: forces N z without effect change it.
    most : float
        The least of them, where z makes that as large as can be, 0 at most [N].
    """

    names: tuple[str, ...]
    most: float  # [N]


def shared_normals(sites: Sites, normals: dict[str, float]) -> SharedNormals:
    """Contacts whose normal forces [N] redundant rows leave open, and how little they must pull."""
    scene = sites.scene
    if not scene.nominal.dependent:
        return SharedNormals((), 0.0)
    N = scene.nominal.redundancy.at(sites._equations(), sites.q).N
    rates = np.array([_normal_row(sites, name) @ N for name in normals])
    changed = np.abs(rates).max(axis=1, initial=0.0) > tolerances.RANK
    if not changed.any():
        return SharedNormals((), 0.0)
    # imported here: scipy takes as long to import as Pinocchio
    from scipy.optimize import linprog

    # max s,  s <= n_i + rates_i z,  s <= 0
    rates, at = rates[changed], np.array(list(normals.values()))[changed]
    scale, free = float(np.abs(at).max()), [(None, None)] * N.shape[1]
    rows = np.column_stack((-rates, np.ones(len(at))))
    cost = np.append(np.zeros(N.shape[1]), -1.0)
    best = linprog(cost, rows, at / (scale or 1.0), bounds=[*free, (None, 0.0)])
    most = -float(best.fun) * scale if best.status == 0 else float(at.min())
    return SharedNormals(tuple(np.array(list(normals))[changed].tolist()), most)


def shared_text(shared: SharedNormals, pull: str) -> str:
    """Sentence on contacts that cannot all press, however they share the load."""
    return (
        f"{', '.join(shared.names)}: one of them pulls with {pull} or more, however they share "
        "the load; the ground would let go"
    )


def _normal_row(sites: Sites, name: str) -> Array:
    """How the normal force of a contact changes with lam (m,)."""
    up, i = upward(sites.scene), sites.scene.names.index(name)
    constraint, rows = sites.scene.constraints[i], sites.scene.bounds[i].rows
    found = np.zeros(sites.scene.rows)
    for row, unit in zip(range(rows.start, rows.stop), np.eye(rows.stop - rows.start), strict=True):
        force = _force(sites, i, unit)
        found[row] = force[2] if constraint.has_normal else force.in_world()[:3] @ up
    return found


def upward(scene: Scene) -> Array:
    """Return the direction against gravity (3,); zero where there is none."""
    up = -np.array(scene.robot.model.gravity.linear)
    return np.asarray(up / max(float(np.linalg.norm(up)), np.finfo(float).tiny))


def pull_text(constraint: Constraint, pull: str) -> str:
    """Return the sentence on a contact that pulls, with how much."""
    words = "" if constraint.has_normal else " (the vertical is its normal)"
    return f"{constraint.name}: the contact pulls with {pull}{words}; the ground would let go"


def _force(sites: Sites, i: int, lam: Array) -> ConstraintForce:
    """Return the force of one constraint on its first-named body."""
    constraint, bound = sites.scene.constraints[i], sites.scene.bounds[i]
    components = bound.force(lam, lambda: sites.placements[i])
    on, by, frame = constraint.acting(swapped=bound.sign < 0)
    return ConstraintForce(
        bound.name, read_only(components), on, by, frame, read_only(lam.copy()), sites, i, True
    )
