"""ClosedChains: which joints the loops determine, and on which side of dead points they stand.

Of the joints, as many depend on the others as there are independent rows: r of them, with J_D the
columns that belong to them. They are chosen once for a scene, those without motor or spring first.
Motors held, the loops determine them wherever J_D has rank r. Where it has not is a dead point; on
its two sides

    sign det(Q^T J_D),     Q an orthonormal basis of the rows that J_D can move, at the reference,

differs. So the sign tells the two ways to assemble a four-bar for one angle of its crank. It is
taken for every cluster of loops that share dependent joints, if what J_D can move is the same at
configurations nearby: so it is in planar loops and where no row is redundant. Redundant rows in
space, such as those of Bricard's linkage, turn with the configuration; their loops have no side.
Two configurations of different sign are on different branches; of the same sign, they are on the
same one unless an even number of dead points lies between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.linalg import MinimumNorm, above_tolerance, factorise, pivots, redundant_rows
from condyn_pin._core.models import Indices, indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import BoundConstraint, Terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import by_digits
from condyn_pin.dynamics.nominal import described_posture, look_at_digits, scene_without_time
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidModel
from condyn_pin.mechanism.closing import LoopCloser
from condyn_pin.model.joints import NO_LIMITS, Limits
from condyn_pin.model.robot import Robot
from condyn_pin.model.soundness import singular_mass

_NEARBY = 0.1  # where to look for a configuration that is not singular by accident [rad, m]
_LOOKS = 2


@dataclass(frozen=True, eq=False)
class ClosedChains:
    """The closed chains of a scene: those of its rows that have a position error."""

    rows: Indices
    limits: Limits
    actuated: Indices  # velocity indices of the motors
    dependent: Indices  # of the joints without motor that the loops determine
    clusters: tuple[Cluster, ...]  # none if there is no motor, or no closed configuration
    assembly_mode: Mapping[str, int]  # the branch of the first posture
    rank: int  # of all rows, at configurations that are not singular by accident
    redundant: tuple[str, ...]  # rows that can go there without changing the motion
    isolated: tuple[str, ...]  # loops that close at the first posture and nowhere near it

    def branch(self, J: Array) -> dict[str, int]:
        """Return the side of every cluster that has sides, from the Jacobian (m, nv)."""
        return {cluster.name: cluster.side(J) for cluster in self.clusters if cluster.sided}

    def weakest(self, J: Array) -> str:
        """Return the cluster that is nearest to a dead point."""
        S = {cluster.name: cluster.singular_values(J) for cluster in self.clusters}
        return min(S, key=lambda name: float(S[name][-1] / S[name][0]))

    def smallest(self, J: Array) -> float:
        """Return the smallest singular value of the dependent joints, or of all without motors."""
        if self.clusters:
            return min(float(c.singular_values(J)[-1]) for c in self.clusters)
        S = np.linalg.svd(J[self.rows], compute_uv=False)
        kept = S[above_tolerance(S)]
        return float(kept[-1]) if kept.size else 0.0


def chains_of(scene: Scene) -> ClosedChains:
    """Return the closed chains of a scene; they are found once."""
    timeless = scene_without_time(scene)
    known = vars(timeless)
    if "_chains" not in known:
        known["_chains"] = read_only(_chains(timeless))
    found: ClosedChains = known["_chains"]
    return found


@one_blas_thread
def _chains(scene: Scene) -> ClosedChains:
    """Find the closed chains of a scene, near its first posture."""
    robot = scene.robot
    robot.check_unedited()
    limits = Limits.of(robot.model)
    _look_for_digits(scene, limits)
    closer = LoopCloser.of(scene, limits=limits)
    equations, rows = closer.equations, closer.rows
    _, actuated = indices(robot.model, robot.actuated)
    passive = passive_joints(robot, actuated)
    closed, tries = _closed_near(closer, described_posture(scene))
    found: list[tuple[MinimumNorm, Array, Indices]] = []
    jacobians = []
    for q in tries:
        terms, rounded = equations.terms(q, np.zeros(robot.nv)), by_digits(scene)
        left = rounded.left_out_by_digits(terms.J) if rounded else None
        terms = terms if left is None else terms.kept(left)
        jacobians.append(terms.J)
        try:
            factors = factors_at(equations, q, terms)
        except InvalidModel:  # M is singular there, and need not be at the others
            if q is tries[-1] and not found:
                raise
            continue
        found.append((factors, terms.J, independent_columns(terms.J[rows], passive)))
    # the first of those with the largest ranks: the first posture, unless that is singular
    factors, J, dependent = max(found, key=lambda each: (each[0].rank, len(each[2])))
    groups: tuple[Cluster, ...] = ()
    if closed and actuated.size:
        columns = independent_columns(J[rows], (*passive, actuated))
        groups = tuple(clusters(scene, J, jacobians, rows, columns))
    moved = [np.abs(pin.difference(robot.model, tries[0], q)) for q in tries[1:]]
    return ClosedChains(
        rows=rows,
        limits=limits,
        actuated=actuated,
        dependent=dependent,
        clusters=groups,
        assembly_mode={each.name: each.side(jacobians[0]) for each in groups if each.sided},
        rank=factors.rank,
        redundant=redundant_rows(factors.U[:, factors.rank :], scene.row_names),
        isolated=isolated(scene, np.max(moved, axis=0), jacobians, rows) if moved else (),
    )


def _look_for_digits(scene: Scene, limits: Limits) -> None:
    """Find out what digits of its file make up in a scene, where its loops are nearly closed."""
    if not scene.robot.precision or by_digits(scene):
        return
    closer, guess = LoopCloser.of(scene), described_posture(scene)
    for end in closer.ends(guess):
        if end.size <= tolerances.CLOSED:
            look_at_digits(scene, closer.equations, end.q, end.J)
            break
        if end.size <= tolerances.LEAST_PRECISE:
            look_at_digits(scene, closer.equations, end.q)
            break


def _closed_near(closer: LoopCloser, guess: Array) -> tuple[bool, list[Array]]:
    """Return True if the guess can be closed, and closed configurations at it and near it."""
    model = closer.equations.model
    for within in (closer, replace(closer, limits=NO_LIMITS)):
        ends = within.ends(guess) if not within.limits.beyond(guess) else ()
        first = next((end for end in ends if end.size <= tolerances.CLOSED), None)
        if first is not None:
            break
    else:
        return False, [guess]
    found, rng = [first.q], np.random.default_rng(0)
    for _ in range(_LOOKS):
        near = np.array(pin.integrate(model, first.q, _NEARBY * rng.normal(size=model.nv)))
        end = within.close(near)
        if end.size <= tolerances.CLOSED:
            found.append(end.q)
    return True, found


def factors_at(
    equations: Equations, q: Array, terms: Terms, share: float = tolerances.RANK
) -> MinimumNorm:
    """Return M and J factorised, without the singular values that are zeros but for rounding."""
    factors = factorise(terms.M, terms.J, share, why=singular_mass(equations.model, q))
    return factors.above_rounding(equations.cancellation(q))


def passive_joints(robot: Robot, motors: Indices) -> tuple[Indices, Indices]:
    """Return the velocity indices without motor: those without spring, and those with one."""
    _, sprung = indices(robot.model, [spring.joint for spring in robot.springs])
    passive = np.setdiff1d(np.arange(robot.nv), motors)
    return np.setdiff1d(passive, sprung), np.intersect1d(passive, sprung)


def independent_columns(J: Array, classes: Sequence[Indices]) -> Indices:
    """Return as many independent columns of J as there are, those of the first classes first."""
    left = J.copy()
    least = tolerances.DEAD_POINT * np.linalg.norm(J)
    chosen: list[int] = []
    for columns in classes:
        found, Q = pivots(left[:, columns], float(least))
        chosen.extend(columns[found].tolist())
        left -= Q @ (Q.T @ left)
    return np.array(sorted(chosen), dtype=np.int_)


# Clusters: loops that share dependent joints, and on which side of their dead points they are.


@dataclass(frozen=True, eq=False)
class Cluster:
    """Loops that share dependent joints."""

    name: str  # names of the loops
    rows: Indices
    columns: Indices  # velocity indices of the joints that depend on them
    basis: Array  # Q (rows, columns)
    sign: float  # of det(Q^T J_D) at the reference
    sided: bool  # whether Q spans what J_D can move nearby too: if not, the sign says nothing

    @cached_property
    def block(self) -> tuple[Indices, ...]:
        """Indices of J_D in J."""
        return np.ix_(self.rows, self.columns)

    def singular_values(self, J: Array) -> Array:
        """Return the singular values of J_D."""
        return np.asarray(np.linalg.svd(J[self.block], compute_uv=False), dtype=np.float64)

    def side(self, J: Array) -> int:
        """Return +1 on the side of the reference, -1 across a dead point, 0 in one."""
        S = self.singular_values(J)
        if S[-1] <= tolerances.DEAD_POINT * S[0]:
            return 0
        return int(self.sign * np.linalg.slogdet(self.basis.T @ J[self.block])[0])


def clusters(
    scene: Scene, J: Array, nearby: Sequence[Array], rows: Indices, columns: Indices
) -> Iterator[Cluster]:
    """Group the loops that share dependent joints: the blocks of J_D, at a reference and nearby."""
    for name, own, moved in _groups(scene, J, rows, columns):
        block = np.ix_(own, moved)
        Q = np.linalg.qr(J[block])[0]
        sign = float(np.linalg.slogdet(Q.T @ J[block])[0])
        norm, least, all_J_D = np.linalg.norm, tolerances.DEAD_POINT, [J[block] for J in nearby]
        sided = all(norm(J_D - Q @ (Q.T @ J_D)) <= least * norm(J_D) for J_D in all_J_D)
        yield Cluster(name, own, moved, Q, sign, sided)


def _groups(
    scene: Scene, J: Array, rows: Indices, columns: Indices
) -> Iterator[tuple[str, Indices, Indices]]:
    """Yield the names of loops that share joints, their rows, and the velocity indices of these."""
    groups: list[tuple[list[BoundConstraint], set[int]]] = []
    scale = np.abs(J[rows]).max(initial=0.0)
    for bound in scene.bounds:
        if not bound.positioned:
            continue
        size = np.abs(J[bound.positioned][:, columns]).max(axis=0, initial=0.0)
        loops, touched = [bound], set(columns[size > tolerances.DEAD_POINT * scale].tolist())
        apart = [group for group in groups if not group[1] & touched]
        for group in groups:
            if group[1] & touched:
                loops, touched = loops + group[0], touched | group[1]
        groups = [*apart, (loops, touched)]
    for loops, touched in groups:
        if touched:
            loops.sort(key=lambda bound: bound.rows.start)
            own = np.array([row for bound in loops for row in bound.positioned], dtype=np.int_)
            name = " + ".join(bound.name for bound in loops)
            yield name, own, np.array(sorted(touched), dtype=np.int_)


def isolated(
    scene: Scene, moved: Array, jacobians: Sequence[Array], rows: Indices
) -> tuple[str, ...]:
    """Return the loops that close at one configuration only."""
    # Whatever was closed nearby came back to it, no joint further than `moved` (nv,), and J is
    # nearly singular there: to first order there is a motion, and to second order there is none.

    def nearly_singular(J: Array) -> bool:
        S = np.linalg.svd(J, compute_uv=False)
        more_than_rounding = tolerances.REFERENCE_RANK * S[0] < S
        return bool((more_than_rounding & (tolerances.ISOLATED * S[0] > S)).any())

    groups = _groups(scene, jacobians[0], rows, np.arange(len(moved)))
    return tuple(
        name
        for name, own, touched in groups
        if moved[touched].max() < tolerances.ISOLATED
        and any(nearly_singular(J[own]) for J in jacobians)
    )
