"""ContactCones: the friction cones of a scene, bound once and turned in every control tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import pivots
from condyn_pin._core.models import whole_data
from condyn_pin.contact.cones import Cone, Cones, RoundCone, Tension
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites, upward
from condyn_pin.errors import InvalidArgument, unknown_name


class ContactCones:
    """The contacts of a scene that have a cone, their rows and their inequalities."""

    # touching (m_c,), held (m - m_c,): rows of the scene that belong to contacts with a cone, and
    # the others
    touching: NDArray[np.int_]
    held: NDArray[np.int_]

    def __init__(self, scene: Scene, cones: Cones) -> None:
        self._up = upward(scene)
        self._groups: list[_Group] = []
        names: list[str] = []
        lower: list[float] = []
        upper: list[float] = []
        is_touching = np.zeros(scene.rows, dtype=bool)
        rounds: list[tuple[slice, float]] = []
        column = row = 0
        for place, cone in _fitted_cones(scene, cones).items():
            contact, bound = scene.constraints[place], scene.bounds[place]
            is_touching[bound.rows] = True
            table = cone.rows()
            block = (slice(row, row + len(table.A)), slice(column, column + bound.size))
            row, column = block[0].stop, block[1].stop
            names += [f"{bound.name}: {each}" for each in table.names]
            if isinstance(cone, RoundCone) and cone.friction > tolerances.FRICTIONLESS:
                rounds.append((block[0], cone.friction))
            last = self._groups[-1] if self._groups else None
            if last is None or not last.takes(contact, cone):
                last = _Group(contact, cone)
                self._groups.append(last)
            last.add(bound, block)
            lower += last.bounds[0].tolist()
            upper += last.bounds[1].tolist()
        # of the inequalities: the contact, and what it does where the row is violated
        self.names = tuple(names)
        # lower, upper (r,): bounds of the inequalities: A lam <= 0, but A lam = 0 for independent
        # rows of cones without friction, which leaves nothing to the others
        self.lower, self.upper = np.array(lower), np.array(upper)
        # rows and friction of each cone that is round, and no pyramid
        self.rounds = tuple(rounds)
        self.touching, self.held = np.flatnonzero(is_touching), np.flatnonzero(~is_touching)
        self._shape = (row, column)
        turns = any(group.turns for group in self._groups)
        # (r, m_c) A, where no cone turns with the robot; not to be written to
        self.constant: Array | None = None if turns else self.standing

    @property
    def turning(self) -> list[TurningCone]:
        """The cones whose axes turn with the robot, as numbers."""
        return [cone for group in self._groups if group.turns for cone in group.turning(self._up)]

    @property
    def standing(self) -> Array:
        """A (r, m_c) with zeros in the rows of cones that turn."""
        A = np.zeros(self._shape)
        for group in self._groups:
            if not group.turns:
                group.fill(A, None, self._up)
        return A

    def rows(self, oMi: Any) -> Array:
        """Return A (r, m_c) of A lam <= 0, with the joints at oMi; not to be written to."""
        if self.constant is not None:
            return self.constant
        A = np.zeros(self._shape)
        for group in self._groups:
            group.fill(A, oMi, self._up)
        return A


def pyramids(scene: Scene, cones: Cones) -> ContactCones:
    """Cones of a scene for a linear program; InvalidArgument if one is round."""
    found = ContactCones(scene, cones)
    if found.rounds:
        raise InvalidArgument(
            "cones: a RoundCone is no linear inequality, and only a Controller has round ones; use "
            "FrictionCone(mu, sides=16), which loses 2 % of the friction"
        )
    return found


class TurningCone(NamedTuple):
    """A cone whose axes turn with the robot, as numbers."""

    # its rows among those of all cones, and the forces among those of all contacts
    block: tuple[slice, slice]
    bound: Any  # the contact
    cone: Cone
    edge: int  # the axis of an edge, or -1 of a point
    # (3, 3) the axes of the floor in the world by rows; of an edge the first is the vertical
    floor: Array
    # A, to_wrench: of A T lam <= 0: over forces in the axes of the floor, and what the rows
    # transmit
    A: Array
    to_wrench: Array


class _Group:
    """Contacts of one kind with one cone: their axes are turned together, if they turn at all."""

    def __init__(self, contact: Any, cone: Cone) -> None:
        self._contact, self._cone, self._key = contact, cone, _key(contact)
        self._bounds: list[Any] = []
        self._blocks: list[tuple[slice, slice]] = []

    def takes(self, contact: Any, cone: Cone) -> bool:
        return cone == self._cone and _key(contact) == self._key

    def add(self, bound: Any, block: tuple[slice, slice]) -> None:
        self._bounds.append(bound)
        self._blocks.append(block)
        self._to_wrench = np.array([bound.whole(row) for row in np.eye(bound.size)]).T
        self._fixed = self._cone.rows().A @ self._to_wrench if self._contact.has_normal else None

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the rows of one of its cones (r,)."""
        A, flat = self._cone.rows().A, self._cone.flat_rows
        lower, upper = np.full(len(A), -np.inf), np.zeros(len(A))
        if flat:
            independent, _ = pivots((A[flat] @ self._to_wrench).T, tolerances.RANK)
            upper[flat] = np.inf
            pinned = np.array(flat)[independent]
            lower[pinned] = upper[pinned] = 0.0
        return lower, upper

    @cached_property
    def _threes(self) -> Array:
        """Forces, and moments, one after the other."""
        return self._cone.rows().A.reshape(-1, 3)

    @property
    def turns(self) -> bool:
        """True if its rows turn with the robot."""
        return not self._contact.has_normal

    def turning(self, up: Array) -> Iterator[TurningCone]:
        """Yield its cones as numbers."""
        support, A = self._contact.support, self._cone.rows().A
        for block, bound in zip(self._blocks, self._bounds, strict=True):
            if support is None or support.axis is None:
                floor, edge = self._cone.turn(self._contact, np.eye(3), up), -1
            else:
                floor, edge = np.tile(self._cone.floor_normal(up), (3, 1)), support.axis
            yield TurningCone(block, bound, self._cone, edge, floor, A, self._to_wrench)

    def fill(self, A: Array, oMi: Any, up: Array) -> None:
        if self._fixed is not None:  # the axes of its force are those of the floor
            for block in self._blocks:
                A[block] = self._fixed
            return
        R = np.array([bound.ends(oMi)[0].rotation for bound in self._bounds])
        T = self._cone.turn(self._contact, R, up)
        each = (self._threes @ T).reshape(len(T), -1, len(self._to_wrench)) @ self._to_wrench
        for block, rows in zip(self._blocks, each, strict=True):
            A[block] = rows


def _key(contact: Any) -> Any:
    return type(contact), contact.support, contact.has_normal


def _fitted_cones(scene: Scene, cones: Cones) -> dict[int, Cone]:
    """Return the cones of the contacts that have one, and of cables, by place in the scene."""
    if isinstance(cones, Mapping):
        for name in cones:
            if name not in scene.names:
                raise unknown_name("constraint", name, scene.names)
        chosen = dict(cones)
    else:
        chosen = {each.name: cones for each in scene.constraints if each.presses}
    for name, cone in chosen.items():
        if not isinstance(cone, Cone):
            raise InvalidArgument(
                f"cones: {name} has {cone!r}: a FrictionCone or a WrenchCone is needed"
            )
    chosen |= {each.name: Tension() for each in scene.constraints if each.only_pulls}
    placed = enumerate(scene.constraints)
    return {i: chosen[each.name].fitted(each) for i, each in placed if each.name in chosen}


# Which wrenches contacts can give: the contact wrench cone.
#
#     { G lam :  A lam <= 0 },        G the grasp map, A the cones
#
# with wrenches about the origin of the world, in its axes, force first.


def grasp(at: Sites, cones: ContactCones) -> Array:
    """Return G (6, m_c) of contacts with cones: G lam is their wrench about the world's origin."""
    scene, forces = at.scene, at.forces(np.zeros(at.scene.rows))
    columns = []
    for bound in scene.bounds:
        if bound.rows.start not in cones.touching:
            continue
        force = forces[bound.name].own
        whole = np.array([bound.whole(row) for row in np.eye(bound.size)])
        f = force.rotation @ whole[:, :3].T
        moment = force.rotation @ whole[:, 3:].T if whole.shape[1] == 6 else 0.0
        columns.append(np.vstack((f, np.cross(force.at, f, axisb=0, axisc=0) + moment)))
    if not columns:
        raise InvalidArgument("cones: empty; contacts without one exert nothing that is known")
    return np.hstack(columns)


def placements(at: Sites) -> Any:
    """Return the placements of the joints in the world."""
    model = at.scene.robot.unedited
    data = whole_data(model)
    pin.forwardKinematics(model, data, at.q)
    return data.oMi


def wrench_margin(at: Sites, cones: Cones, f: Array, n: Array) -> float:
    """Return max t with A lam + t <= 0 over all lam of this wrench [N]."""
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    bound = pyramids(at.scene, cones)
    A, G = bound.rows(placements(at)), grasp(at, bound)
    size = max(float(np.linalg.norm(f)), np.finfo(float).tiny)  # forces over this
    found = linprog(
        np.concatenate((np.zeros(G.shape[1]), [-1.0])),
        np.hstack((A, np.ones((len(A), 1)))),
        np.zeros(len(A)),
        np.hstack((G, np.zeros((6, 1)))),
        np.concatenate((f, n)) / size,
        bounds=(None, None),
        method="highs",
    )
    return size * float(found.x[-1]) if found.status == 0 else -np.inf
