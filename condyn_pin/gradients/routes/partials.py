"""Partials of a step: balance of momentum, rows, ends, impacts, torques, inertias.

What the balance of momentum and the constraints leave of a step, at fixed v+ and impulses.

    df = (M (v + dt w x u - v+) + dt (tau - h) + J_b^T l_b)',    w x u as in `Manifold`
    ds = (s' - dt/2 (gamma - J_b w x u) - J_b v+)'

by where the equations are taken, by their v and by tau, in all `Columns`. J_c^T lam belongs to df
too: `row_partials` has it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import cos, sin
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import algorithms, whole_data
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.derivatives.kkt import EquationPartials
from condyn_pin.dynamics.derivatives.solution_derivatives import slope
from condyn_pin.gradients.routes.step_derivatives import ContactLaw
from condyn_pin.simulation.integrators.contact_scheme import BiasPartials
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import ClosingInterval
from condyn_pin.stepping.step_problem import StepProblem

if TYPE_CHECKING:
    from condyn_pin.gradients.routes.linear_steps import LinearizedStep


def linearised(
    steps: LinearizedStep, posed: StepProblem, v1: Array, l_b: Array
) -> EquationPartials:
    """Return the linearised equations of a step: of (v+ - v) / dt and of the mean forces."""
    a = (v1 - posed.v) / steps.dt - posed.turning
    return steps.linearisation.at(posed.at, posed.mean, a, l_b / steps.dt)


def left_of_momentum(
    steps: LinearizedStep,
    of: EquationPartials,
    posed: StepProblem,
    v1: Array,
    mean: Array | None = None,
) -> Array:
    """Right-hand side df of the differentiated balance of momentum (nv, columns).

    `mean` (nv, columns) has the derivatives of the velocity of h, if not the one before.
    """
    n, dt, columns = len(v1), steps.dt, steps.columns
    M = steps.system.equations.mass(posed.at) if of.M is None else of.M
    f = columns.empty()
    np.multiply(dt, of.rhs[:n], out=f[:, : 2 * n])
    f[:, columns.tau] = steps.unit_impulses
    f[:, columns.v] += dt * M.dot(steps.floating.turning_by(posed.mean))
    if mean is not None:
        by_mean = f[:, columns.v].copy()
        f[:, columns.v] = 0.0
        f += by_mean.dot(mean)
    f[:, columns.v] += posed.condensed.factors.mass.M  # with springs, if those are implicit
    if steps.inertias:
        a = (v1 - posed.v) / dt - posed.turning
        f[:, columns.inertias] -= dt * steps.inertias.forces(posed.at, posed.mean, a)
    if steps.system.passive.between is not None:
        f[:, columns.q] -= stiffness_partial(steps, posed, posed.at, v1 - posed.v)
    return f


def left_of_constraints(
    steps: LinearizedStep, of: EquationPartials, posed: StepProblem, v1: Array
) -> Array:
    """Return ds (rows, columns), what the constraints leave of a step whose h is that of v.

    J_b (2 v+ / dt - w x u) + gamma = 2 s' / dt,    gamma less s''; s is of time alone
    """
    n, dt, columns = len(v1), steps.dt, steps.columns
    slip = columns.empty(len(of.rhs) - n)
    if not len(slip):
        return slip
    missing = (v1 + posed.v) / dt  # to the acceleration of `of`
    s_q = -of.rhs[n:, :n] + steps.linearisation.turning(posed.at, missing)
    by_v = -of.rhs[n:, n:] - of.J @ steps.floating.turning_by(posed.v)
    slip[:, columns.q], slip[:, columns.v] = -0.5 * dt * s_q, -0.5 * dt * by_v
    return slip


def free_step_partials(steps: LinearizedStep, posed: StepProblem, v1: Array) -> Array:
    """Return v+ by all columns (nv, columns) of a step in which nothing touches.

    Its h is that of the mean of v and of v+ with h at v.
    """
    factors, dt, columns = posed.condensed.factors, steps.dt, steps.columns
    first = 2 * posed.mean - posed.v
    M, h, J_b, gamma = steps.system.equations.parts(posed.at, posed.v)
    w = steps.floating.turning(posed.v)
    L = factors.L
    p = L @ (L.T @ posed.v) + dt * (posed.tau - h + M @ w)
    slip = steps.system.equations.wanted[1] - 0.5 * dt * (gamma - J_b @ w)
    l_b = factors.solve(p, slip)[1]
    at_start = posed._replace(mean=posed.v, turning=w)
    of = linearised(steps, at_start, first, l_b)
    s = left_of_constraints(steps, of, at_start, first)
    mean = 0.5 * factors.solve(left_of_momentum(steps, of, at_start, first), s)[0]
    mean[:, columns.v] += 0.5 * np.eye(len(v1))
    l_b = posed.condensed.constraint_impulses(np.zeros(0))
    again = linearised(steps, posed, v1, l_b)
    f = left_of_momentum(steps, again, posed, v1, mean)
    applied = steps.system.applied
    if steps.scheme.at_midpoint and applied.constant is None:
        # torques at the mean velocity, in place of those at the one before
        (q0, v0), (q1, v1_) = (
            applied.slopes(posed.t, posed.at, each) for each in (posed.v, posed.mean)
        )
        f += dt * v1_.dot(mean)
        f[:, columns.q] += dt * (q1 - q0)
        f[:, columns.v] -= dt * v0
    # rows of constraints with the first h, and this v+
    if len(l_b):
        turned = steps.linearisation.turning(posed.at, 2 / dt * (v1 - first))
        s[:, columns.q] -= 0.5 * dt * turned
    return factors.solve(f, s)[0]


def stiffness_partial(steps: LinearizedStep, posed: StepProblem, q: Array, x: Array) -> Array:
    """Return U^T w U x by q (nv, nv), what springs between frames add to M x in implicit steps."""
    between = steps.system.passive.between
    assert between is not None

    def pull(step: Array) -> Array:
        U, weights = between.inertia_rows(pin.integrate(steps.system.model, q, step), posed.span)
        return np.asarray(U.T @ (weights * (U @ x)))

    return np.column_stack([slope(pull, along) for along in np.eye(len(x))])


# How the rows of contacts in a step change with its start, and how far their paths bend.
#
# Where contacts are taken where the equations of a step are, in closed form:
#
#     (J_c v+)' = (J_c v+)_q dq,    (J_c^T lam)' = (J_c^T lam)_q dq,
#     s' = J_e dq_e - J_n dq - dt ((J_n v)_q dq + J_n dv),    dq_e = d(q (+) dt v)
#
# Where they are taken at the end q_e of a path along u, whose axes T turns to those of the
# beginning, J_c = J_e T, with s = gap_e - gap - dt J_c u,
#
#     (J_c v+)' = (J_e T v+)_q dq_e + J_e T' v+,
#     (J_c^T lam)' = T^T (J_e^T lam)_q dq_e + T'^T J_e^T lam,
#     s' = J_e dq_e - J_n dq - dt ((J_c u)' + J_c du),    dq_e = d(q (+) dt u)


class RowPartials(NamedTuple):
    """At fixed v+ and impulses, by q alone, and bends by q and v; or by all columns."""

    slips: Array  # (m, columns), J_c v+
    pulls: Array  # (nv, columns), J_c^T lam
    bends: Array  # (k, columns)
    before: Array | None = None  # (m, nv), J_c v by q; not where they are taken at the end


def row_partials(
    steps: LinearizedStep, posed: StepProblem, lam: Array, v1: Array, along: Array | None
) -> RowPartials:
    """Derivatives of rows and bends; `along` (nv, columns) is that of the path of contacts."""
    if posed.path is not None:
        assert along is not None  # where a step goes along a path, one has led to it
        return _at_the_end(steps, posed, posed.path, lam, v1, along)
    return _at_the_beginning(steps, posed, lam, v1)


def _at_the_beginning(
    steps: LinearizedStep, posed: StepProblem, lam: Array, v1: Array
) -> RowPartials:
    rows = posed.chosen.rows
    all_lam = np.zeros(len(posed.J))
    all_lam[rows] = lam
    steps.turning.go(posed.at, posed.J)
    turned, pulled = steps.turning.by_q((v1, posed.v), all_lam)
    before = turned[1, rows]
    return RowPartials(turned[0, rows], pulled, _bends(steps, posed, before), before)


def _bends(steps: LinearizedStep, posed: StepProblem, before: Array) -> Array:
    """Derivatives of the bends along the velocity before the step (k, 2 nv)."""
    dt, system, chosen, v = steps.dt, steps.system, posed.chosen, posed.v
    bends, there = np.zeros((len(posed.near.bends), 2 * len(v))), posed.straight
    if there is None:
        return bends
    curved, data = chosen.curved, system.equations.data
    algorithms(data).computeJointJacobians(system.model, data, there)
    J_end = system.contacts.curved_normals(data)[chosen.of_curved]
    J_n = posed.J_n[curved]
    by_at, by_move = steps.partials.integrate(posed.at, dt * v)
    bends[curved, : len(v)] = J_end.dot(by_at) - J_n - dt * before[chosen.normals][curved]
    bends[curved, len(v) :] = dt * (J_end.dot(by_move) - J_n)
    return bends


def _at_the_end(
    steps: LinearizedStep, posed: StepProblem, path: Array, lam: Array, v1: Array, along: Array
) -> RowPartials:
    dt, chosen, columns = steps.dt, posed.chosen, steps.columns
    floating, rows, n = steps.floating, chosen.rows, len(v1)
    one, moved = np.eye(n), dt * along

    def turn(y: Array) -> Array:
        return floating.rows_before(one, path + y / dt, dt)

    T = turn(np.zeros(n))
    J_e = steps.steps.ends.there(posed.at, path).J.dot(T.T)
    by_at, by_move = steps.partials.integrate(posed.at, dt * path)
    dq_e = by_at.dot(steps.itself) + by_move.dot(moved)
    all_lam = np.zeros(len(J_e))
    all_lam[rows] = lam
    steps.turning.go(floating.integrate(posed.at, dt * path), J_e)
    turned, pulled = steps.turning.by_q((T.dot(v1), T.dot(path)), all_lam)
    J_c, pull = J_e[rows], lam.dot(J_e[rows])
    slips, slips_along = turned[0, rows].dot(dq_e), turned[1, rows].dot(dq_e)
    slips_along += J_c.dot(T.dot(along))
    pulls = T.T.dot(pulled.dot(dq_e))
    for i in np.flatnonzero(moved.any(axis=0)) if floating.floats else ():
        size = float(np.abs(moved[:, i]).max())
        dT = size * slope(turn, moved[:, i] / size)
        slips[:, i] += J_c.dot(dT.dot(v1))
        slips_along[:, i] += J_c.dot(dT.dot(path))
        pulls[:, i] += pull.dot(dT)
    normals = chosen.normals
    bends = J_c[normals].dot(dq_e) - dt * slips_along[normals]
    bends[:, columns.q] -= posed.J_n
    if posed.kept is not None:
        its = posed.kept.gaps[chosen.near]
        begun = _at_the_beginning(steps, posed, lam, v1).bends
        bends[its], bends[its, : begun.shape[1]] = 0.0, begun[its]
    return RowPartials(slips, pulls, bends)


# How the end of a step changes with its start, once v+ does: moved, and loops closed behind it.
#
# q+ = at (+) h v+, and back to c(q+) = 0 along M^-1 J_b^T;    v+ in the axes of there


# How far configurations of a difference are apart [rad, m]: right to 1e-10.
_APART: Final = 1e-5


def end_state_partials(
    steps: LinearizedStep, posed: StepProblem, v1: Array, dv1: Array
) -> tuple[Array, Array, Array, Array]:
    """Return q+ and v+ in the axes in which a step ends, and both by all columns."""
    rest, partials, columns = steps.share, steps.partials, steps.columns
    move = rest * v1
    by_at, by_move = partials.integrate(posed.at, move)
    dq = (rest * by_move).dot(dv1)
    dq[:, columns.q] += by_at
    there = steps.floating.integrate(posed.at, move)
    way = steps.steps.closings.closing_path(posed.condensed.factors, there)
    if posed.condensed.factors.rank and len(steps.placed):
        parts = [part for part in way if part.end is not part.begin] or way
        for part in parts:
            of_step = part.factors is posed.condensed.factors
            at, d_at = (posed.at, steps.itself) if of_step else (part.begin, dq)
            dq = _closed(steps, posed, part, dq, at, d_at, whole=part is parts[-1])
    turned = partials.turned(v1, rest, by_move).dot(dv1)
    return way[-1].end, steps.floating.turned(v1, rest), dq, turned


def _closed(
    steps: LinearizedStep,
    posed: StepProblem,
    part: ClosingInterval,
    dq: Array,
    at: Array,
    d_at: Array,
    *,
    whole: bool,
) -> Array:
    """Return dq behind moves x = M^-1 J_b^T y, M and J_b of `at`; M has implicit springs in it.

    c = 0 at the end of the `whole` way; a move that others follow has J_b x = -c where it begins.
    Rows without a place have J_b x = 0.
    """
    factors, system, placed = part.factors, steps.system, steps.placed
    x = np.asarray(pin.difference(system.model, part.begin, part.end))
    n, r = len(x), factors.rank
    y = factors.U[:, :r] @ ((factors.V.T @ (factors.L.T @ x)) / factors.S[:r])
    of = steps.without_gravity.at(at, np.zeros(n), x, y)
    left = of.rhs[:, :n] @ d_at
    if system.passive.between is not None:
        left[:n] -= stiffness_partial(steps, posed, at, x) @ d_at
    if steps.inertias:
        left[:n, steps.columns.inertias] -= steps.inertias.momenta(at, x)
    turned, along = factors.solve_mass(left[:n]), np.asarray(dtrtrs(factors.L.T, factors.V)[0])
    by_q, by_x = pin.dIntegrate(system.model, part.begin, x)
    J = system.equations.consistent_jacobian(at)
    opened, closed = J @ turned - left[n:], J @ along
    if whole:
        J = system.equations.jacobian(part.end)[placed]
        opened[placed], closed[placed] = J @ (by_q @ dq + by_x @ turned), J @ (by_x @ along)
    else:
        opened += _violation_by_q(system, part.begin) @ dq
    back = np.linalg.lstsq(closed, opened, rcond=tolerances.RANK)[0]
    return np.asarray(by_q @ dq + by_x @ (turned - along @ back))


def _violation_by_q(system: System, q: Array) -> Array:
    """Derivative of c by q (m, nv), by differences: not J where loops are open."""
    moves = _APART * np.eye(system.model.nv)
    ends = [
        [system.equations.violation(system.integrate(q, s * x)) for s in (1, -1)] for x in moves
    ]
    return np.array([(up - down) / (2 * _APART) for up, down in ends]).T


# How the impact with which a step begins changes with the start of the step.
#
#     lam_i by q, v, friction, restitution and inertias,    max(J_n v', 0) by the same
#
# with v' behind the impact. Inertias act by G alone: G' = -Y^T M' Y, with Y what unit impulses
# move.
#
# A law of restitution follows the path of a contact through slip, stop and slip, or phases of
# several contacts: its impulses are differenced, at states beside that of the step, to order four.
# All else is that of the step behind it (`LinearizedStep`).


# Steps of differences: of joints [rad, m], and of speeds, friction and restitution as shares. Half
# of the digits would be left by differences of order two; a path leaves twelve, of which three go.
_STEP: Final = 1e-4

# How far beside a step Newton's law has to be the same as another, to be so by more than chance
# [rad, m].
_BESIDE: Final = 1e-6


def impact_partials(steps: LinearizedStep, posed: StepProblem) -> tuple[Array, Array]:
    """Derivatives of impulses (m, columns), and of rebound velocities (k, columns)."""
    columns, strike = steps.columns, posed.strike
    assert strike is not None
    e, mu = posed.chosen.restitution, posed.chosen.friction
    m, k, n = len(posed.near.before), len(e), len(posed.v)
    speed = float(np.abs(posed.near.before).max())
    mine = strike.apart[posed.chosen.impact(posed.near).sets.blocks]

    def struck(problem: ContactProblem, restitution: Array) -> Array:
        law = steps.scheme.impacts
        assert law is not None
        found = law.strike(problem, restitution, always=True).lam * mine
        off = np.maximum(problem.velocities(found)[problem.sets.normals], 0.0) * strike.apart
        return np.concatenate((found, off))

    def beside(moved: Array) -> Array:
        at = steps.system.integrate(posed.at, moved[:n])
        return struck(steps.steps.impact_at(posed.chosen, posed.near, at, posed.v + moved[n:]), e)

    here = posed.chosen.impact(posed.near)

    def rougher(change: Array) -> Array:
        return struck(here.replaced(friction=mu + change), e)

    changes = columns.empty(len(mine) + k)
    for i, along in enumerate(np.eye(2 * n)):
        changes[:, i] = _slope(beside, along, _STEP if i < n else _STEP * speed)
    cones = [int(i) for i in np.flatnonzero(strike.apart[: len(mu)])]
    of_mu, of_e = (
        np.arange(columns.size)[columns.of_cones(name, posed.chosen.cones)]
        for name in ("friction", "restitution")
    )
    for i in cones:
        one = np.eye(k)[i]
        if mu[i]:
            changes[:, of_mu[i]] = _slope(rougher, one[: len(mu)], _STEP * mu[i])
        if e[i]:
            changes[:, of_e[i]] = _slope(lambda x: struck(here, e + x), one, _STEP * e[i])
    for i, heavier in _by_inertias(steps, posed, len(mine)):

        def weighing(share: Array, by: Array = heavier) -> Array:
            return struck(here.replaced(G=here.G + share * by), e)

        changes[:, i] = _slope(weighing, np.ones(1), _STEP * _size(here.G, heavier))
    lam = columns.empty(m)
    lam[: len(mine)] = changes[: len(mine)]
    return lam, changes[len(mine) :]


def is_open(posed: StepProblem) -> bool:
    """True if redundant contacts strike at once: their shares of the impact are not unique."""
    if posed.strike is None or np.count_nonzero(posed.strike.apart) < 2:
        return False
    problem = posed.chosen.impact(posed.near)
    struck = posed.strike.apart[problem.sets.blocks]
    G = problem.G[np.ix_(struck, struck)]
    return bool(np.linalg.matrix_rank(G, tolerances.CONTACT_RANK, hermitian=True) < len(G))


def agrees_by_chance(steps: LinearizedStep, posed: StepProblem) -> bool:
    """True if Newton's law gives the impact here, and not at the states beside it."""
    near, chosen = posed.near, posed.chosen
    e = chosen.restitution
    if steps.scheme.impacts is None or not e.any() or not chosen.friction.any():
        return False
    if not ((near.before[near.normals] < 0.0) & (e > 0.0)).any():
        return False
    law, n = steps.scheme.impacts, len(posed.v)
    here = chosen.impact(near)

    def beside() -> Iterator[ContactProblem]:
        for along in np.eye(n):
            at = steps.system.integrate(posed.at, _BESIDE * along)
            yield steps.steps.impact_at(chosen, near, at, posed.v)
        for _, by in _by_inertias(steps, posed, here.rows):
            yield here.replaced(G=here.G + _BESIDE * _size(here.G, by) * by)

    for problem in beside():
        apart = law.strike(problem, e).apart
        if (apart if posed.strike is None else apart & ~posed.strike.apart).any():
            return True
    return False


def _by_inertias(steps: LinearizedStep, posed: StepProblem, m: int) -> Iterator[tuple[int, Array]]:
    """Columns of inertias on which G of an impact depends, with its derivatives (m, m)."""
    if not steps.inertias:
        return
    Y = posed.condensed.factors.solve(posed.J_c[:m].T, np.zeros((steps.system.equations.m, m)))[0]
    momenta = np.array([steps.inertias.momenta(posed.at, y) for y in Y.T])  # (m, nv, columns)
    for i in range(steps.inertias.size):
        by = -Y.T.dot(momenta[:, :, i].T)
        if by.any():
            yield steps.columns.inertias.start + i, 0.5 * (by + by.T)


def _size(G: Array, by: Array) -> float:
    """Change of a parameter that changes G by the size of G."""
    return float(np.abs(G).max() / np.abs(by).max())


def _slope(function: Callable[[Array], Array], along: Array, h: float) -> Array:
    """Return the derivative of a function of a step along a direction, by differences."""
    near, far = (function(x * along) - function(-x * along) for x in (h, 2.0 * h))
    return np.asarray((8.0 * near - far) / (12.0 * h))


# How what a scheme adds to the velocities of contacts changes with the start of a step.
#
#     sigma = G lam + J_c v_free + (s + gap) / dt,  + e J_n v,  + R lam, ...
#
# at fixed impulses and v_free: gaps by where the step begins, bends s by `row_partials`, R by gaps
# and by G_nn.


def add_bias_partials(
    added: Array, steps: LinearizedStep, posed: StepProblem, law: ContactLaw, rows: RowPartials
) -> None:
    """Add what a scheme adds to sigma by all columns (m, columns), at fixed impulses."""
    near, columns, J_c = posed.near, steps.columns, posed.J_c
    by = steps.scheme.bias_partials(near)
    if by.bends is not None:
        added[near.normals, : rows.bends.shape[1]] += by.bends[:, None] * rows.bends
    if by.gaps is not None:
        added[near.normals, columns.q] += by.gaps[:, None] * posed.J_n
    if by.before is not None:
        assert rows.before is not None  # a scheme that lets rebound closes no gaps
        added[:, columns.q] += by.before[:, None] * rows.before
        added[:, columns.v] += by.before[:, None] * J_c
    if by.restitution is not None:
        cones, approach = len(posed.chosen.friction), by.restitution
        if posed.strike is not None:
            approach = np.where(posed.strike.apart, 0.0, approach)
        added[2 : 3 * cones : 3, steps.restitution(posed)] += np.diag(approach[:cones])
    if by.solref is not None:
        added[:, columns.solref] += by.solref
    if posed.problem.R is not None:
        added += law.lam[:, None] * _softer(steps, posed, by)


def _softer(steps: LinearizedStep, posed: StepProblem, by: BiasPartials) -> Array:
    """Return R by all columns (m, columns): by gaps, and by G_nn of each contact."""
    near, columns = posed.near, steps.columns
    J_c, blocks, lines = posed.J_c, near.blocks, len(near.gaps)
    # the row that each contact, and each row of dry friction, has its stiffness of
    of_row = np.arange(len(J_c))
    if lines:
        normals = of_row[near.normals]
        of_row = np.where(blocks < lines, normals[np.minimum(blocks, lines - 1)], of_row)
    rows = np.unique(of_row)
    stiffer = columns.empty(len(J_c))
    y, l_b = posed.condensed.factors.solve(
        J_c[rows].T, np.zeros((steps.system.equations.m, len(rows)))
    )
    for i, row in enumerate(rows):
        stiffer[row, columns.q] = _compliance_by(steps, posed, y[:, i], l_b[:, i], row)
        if steps.inertias:
            lighter = steps.inertias.momenta(posed.at, y[:, i])
            stiffer[row, columns.inertias] -= y[:, i] @ lighter
    assert by.R_stiffness is not None  # of a scheme with R
    changed = by.R_stiffness[:, None] * stiffer[of_row]
    if lines and by.R_gaps is not None:
        of_gaps = np.where(blocks < lines, by.R_gaps, 0.0)
        changed[:, columns.q] += of_gaps[:, None] * posed.J_n[np.minimum(blocks, lines - 1)]
    return changed


def _compliance_by(
    steps: LinearizedStep, posed: StepProblem, y: Array, l_b: Array, row: int
) -> Array:
    """Return G_nn by q (nv,): 2 y . (J_n^T)' - y . (M y - J_b^T l_b)' + l_b . (J_b y)'."""
    n = len(y)
    of = steps.without_gravity.at(posed.at, np.zeros(n), y, l_b)
    turned = steps.turning.velocity_by_q(y)
    by_q = 2 * turned[posed.chosen.rows][row] + y @ of.rhs[:n, :n] - l_b @ of.rhs[n:, :n]
    if steps.system.passive.between is not None:
        by_q = by_q - y @ stiffness_partial(steps, posed, posed.at, y)
    return np.asarray(by_q)


# How what `Manifold` does to floating bodies changes with what it is given; tangent columns.
#
#     p+ = p + R x, R+ = R exp(y):    dp+ = E^T (dp - x x dtheta + dx),   dtheta+ = E^T dtheta + Jr
#     dy
#     u+ = exp(-dt w) u:              du+ = E^T du + dt u+ x Jr dw,    y = dt w
#
# with x and y the two halves of a move, E the rotation that belongs to it, and positions in the
# axes of the body.


_SKEW = np.array([[0.0, -1.0], [1.0, 0.0]])  # S x is x turned by a quarter


class FloatingPartials:
    """The partials of the `Manifold` of one model."""

    def __init__(self, model: Any) -> None:
        self._model, self._one = model, np.eye(model.nv)
        joints = [(j.shortname(), j.idx_v) for j in list(model.joints)[1:]]
        self._bodies = [i for name, i in joints if name == "JointModelFreeFlyer"]
        self._planar = [i for name, i in joints if name == "JointModelPlanar"]

    def integrate(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the end of a move by its start, and by the move (nv, nv) each."""
        by_q, by_move = pin.dIntegrate(self._model, q, dq)
        for i in self._bodies:
            lin, ang = slice(i, i + 3), slice(i + 3, i + 6)
            by_move[lin, lin] = turn = by_q[lin, lin]
            by_q[lin, ang], by_move[lin, ang] = turn.dot(pin.skew(dq[lin]).T), 0.0
        for i in self._planar:
            x, angle = dq[i : i + 2], float(dq[i + 2])
            turn = _turn(angle).T
            by_q[i : i + 2, i : i + 3] = np.column_stack([turn, turn @ _SKEW @ x])
            by_move[i : i + 2, i : i + 3] = np.column_stack([turn, np.zeros(2)])
        return by_q, by_move

    def turned(self, v: Array, dt: float, by_move: Array) -> Array:
        """Return v in the axes after dt by v (nv, nv); `by_move` is that of `integrate` by dt v."""
        by_v = self._one.copy()
        for i in self._bodies:
            lin, ang = slice(i, i + 3), slice(i + 3, i + 6)
            turn = by_move[lin, lin]
            by_v[lin, lin] = turn
            by_v[lin, ang] = pin.skew(dt * turn.dot(v[lin])).dot(by_move[ang, ang])
        for i in self._planar:
            turn = by_move[i : i + 2, i : i + 2]
            by_v[i : i + 2, i : i + 2] = turn
            by_v[i : i + 2, i + 2] = -dt * _SKEW @ turn @ v[i : i + 2]
        return by_v


def _turn(angle: float) -> Array:
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s], [s, c]])


# How the dynamics change with what bodies weigh: M a + h = Y(q, v, a) pi, the regressor form.
#
# Ten numbers a joint, as ``pin.Inertia.toDynamicParameters``: the mass, mass times centre of mass,
# and the inertia about the joint's origin xx xy yy xz yz zz.


class InertiaPartials:
    """The regressors of one model, in memory of their own."""

    def __init__(self, model: Any) -> None:
        self._model, self._still = model, without_gravity(model)
        self._data = whole_data(model)
        self.size = 10 * (model.njoints - 1)

    def forces(self, q: Array, v: Array, a: Array) -> Array:
        """Return M a + h by the inertias (nv, size)."""
        return self._rows(pin.computeJointTorqueRegressor(self._model, self._data, q, v, a))

    def momenta(self, q: Array, x: Array) -> Array:
        """Return M x by the inertias (nv, size)."""
        v = np.zeros(len(x))
        return self._rows(pin.computeJointTorqueRegressor(self._still, self._data, q, v, x))

    def _rows(self, regressor: Array) -> Array:
        return np.array(regressor).reshape(-1, self.size)  # a single row comes as a vector

    def mass(self) -> Array:
        """Return the mass of the robot by the inertias (size,)."""
        return np.tile(np.eye(10)[0], self.size // 10)


# How the torques of a step change with its start: applied ones, springs and damping.
#
# tau = tau_a - (D + dt K) v - K (q - q_0) + J_f^T f


def torque_partials(
    system: System, t: float, q: Array, v: Array, ahead: float
) -> tuple[Array, Array]:
    """Return the torques by q and by v (nv, nv), springs and damping as they act `ahead` [s]."""
    passive, n = system.passive, len(v)
    by_q = np.diag(-passive.stiffness)
    by_v = np.diag(-passive.d - ahead * passive.stiffness)
    if system.applied.constant is None:
        of_q, of_v = system.applied.slopes(t, q, v)
        by_q, by_v = by_q + of_q, by_v + of_v
    between = passive.between
    if between is not None:

        def pull(step: Array) -> Array:
            return between.torque(pin.integrate(system.model, q, step), v, ahead)

        by_q = by_q + np.column_stack([slope(pull, along) for along in np.eye(n)])
        by_v = by_v - between.damping(q) - ahead * between.stiffness(q)
    return by_q, by_v
