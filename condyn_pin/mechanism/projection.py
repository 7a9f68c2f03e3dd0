"""Projection onto the constraints, completion, following, sampling.

Projection of velocities and accelerations to the constraints, nearest in a metric W.

    min |v' - v|_W   with  J v' = 0,            min |a' - a|_W   with  J a' + gamma = 0,

W being the mass matrix, as in Gauss's principle, or the identity. With W = L L^T and the singular
values of J L^-T = U S V^T, both are

    x' = x - L^-T V S^+ U^T (J x + gamma),

taken twice: what rounding leaves of the first, most where bodies are light, the second takes away.

As many singular values count as rows are kept at the state (`condyn_pin.constraints.rows.
redundancy`): where loops are open by a gap, redundant rows look independent by as much, and what
such combinations miss is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count, check_type, count_text, normalised
from condyn_pin._core.arrays import Array, check_overflow, finite, rounded
from condyn_pin._core.linalg import factorise, rank_of
from condyn_pin._core.models import indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import beyond_text, largest_violation
from condyn_pin.dynamics.at_state import (
    constraint_velocities,
    equations_of,
    kept_rows,
    left_out_at,
    rounding,
)
from condyn_pin.dynamics.scene import Scene, check_time
from condyn_pin.errors import BranchChanged, InvalidArgument, NotAssembled, UnsupportedConstraint
from condyn_pin.mechanism.assembling import (
    assemble_from,
    assembly_of,
    best_end,
    check_held,
    limited,
    nominal_configuration,
)
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import Assembly, AssemblyStatus, LoopCloser
from condyn_pin.mechanism.rank import check
from condyn_pin.model.joints import NO_LIMITS
from condyn_pin.model.soundness import singular_mass

Metric = Literal["mass", "euclidean"]

_PASSES = 2


@one_blas_thread
def project_velocity(scene: Scene, q: ArrayLike, v: ArrayLike, *, metric: Metric = "mass") -> Array:
    """Return the velocity nearest to v with J v = 0, or J v = s' where rows are driven.

    min over x of |x - v|_W    with  J x = s'

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        A closed configuration [rad, m].
    v : (nv,) array_like
        Velocity [rad/s, m/s].
    metric : {"mass", "euclidean"}
        What near means: kinetic energy of the difference, or its squares in rad/s and m/s.

    Returns
    -------
    v : (nv,) array
        The nearest velocity that the constraints allow [rad/s, m/s].

    Raises
    ------
    NotAssembled
        If a loop is open by more than 1e-4 m or rad, or by less but no velocity satisfies its
        rows there; the text names it.
    """
    v_ = finite("v", v, scene.robot.nv)
    q_, closed = _checked_configuration(scene, q, metric)
    equations = equations_of(scene)
    W = equations.mass(q_) if metric == "mass" else np.eye(len(v_))
    J, rate = kept_rows(scene, equations.jacobian(q_), -equations.wanted[1])
    return nearest(scene, q_, "v", v_, (W, J, rate), closed)


@one_blas_thread
def project_acceleration(
    scene: Scene, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, metric: Metric = "mass"
) -> Array:
    """Return the acceleration nearest to a with J a + gamma(q, v) = 0.

    min over x of |x - a|_W    with  J x + gamma = s''

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        A closed configuration [rad, m].
    v : (nv,) array_like
        A velocity with J v = 0 [rad/s, m/s].
    a : (nv,) array_like
        Acceleration [rad/s^2, m/s^2].
    metric : {"mass", "euclidean"}
        With "mass", and a the unconstrained acceleration, this is Gauss's principle.

    Returns
    -------
    a : (nv,) array
        The nearest acceleration that the constraints allow [rad/s^2, m/s^2].

    Raises
    ------
    NotAssembled
        As `project_velocity`; also if v does not fit and no acceleration satisfies its rows.
    """
    nv = scene.robot.nv
    v_, a_ = finite("v", v, nv), finite("a", a, nv)
    q_, closed = _checked_configuration(scene, q, metric)
    with np.errstate(all="ignore"):  # what overflows is refused
        terms = equations_of(scene).terms(q_, v_)
        check_overflow("v", v_, terms.gamma)
    W = terms.M if metric == "mass" else np.eye(nv)
    J, gamma = kept_rows(scene, terms.J, terms.gamma)
    return nearest(scene, q_, "a", a_, (W, J, gamma), closed)


def _checked_configuration(scene: Scene, q: ArrayLike, metric: Metric) -> tuple[Array, bool]:
    """Return q, and whether it is closed, if it is nearly; raises what is wrong otherwise."""
    if metric not in get_args(Metric):
        raise InvalidArgument(
            f"metric = {metric!r}: one of {', '.join(get_args(Metric))} is needed"
        )
    state = check(scene, q, None)
    state.raise_if_open(violation=tolerances.NEARLY_CLOSED)
    return normalised(scene.robot.model, "q", q), state.closed


def nearest(
    scene: Scene,
    q: Array,
    name: Literal["v", "a"],
    x: Array,
    terms: tuple[Array, Array, Array],
    closed: bool,
) -> Array:
    """Return the velocity or acceleration nearest to x with J x' + gamma = 0, for W, J and gamma.

    Refuse numbers that overflow, and rows that contradict each other.
    """
    W, J, gamma = terms
    nothing, why = np.zeros(len(x)), singular_mass(scene.robot.model, q)
    if not len(J):
        return x + factorise(W, J, 0.0, why=why).solve(nothing, gamma)[0]
    with np.errstate(all="ignore"):  # what overflows is refused
        kept = left_out_at(scene, q)
        factors = factorise(W, kept.kept(J), 0.0, why=why).at_most(kept.rank)
        found = x
        for _ in range(_PASSES):
            found = found - factors.solve(nothing, J @ found + gamma)[0]
        left = J @ found + gamma if closed else kept.kept(J @ found + gamma)
        check_overflow(name, x, found, left)
    _check_rows(scene, q, left, (x, found, gamma), "/s" if name == "v" else "/s^2")
    return found


def _check_rows(scene: Scene, q: Array, left: Array, sizes: Sequence[Array], per: str) -> None:
    """Refuse a projection that leaves the constraints, because their rows contradict each other."""
    least = tolerances.CONSISTENT * max(1.0, *(float(np.abs(x).max(initial=0.0)) for x in sizes))
    if np.linalg.norm(left) <= least:
        return
    excused, off = rounding(scene, q, sizes[1]), constraint_velocities(scene, left)
    beyond = {name: by for name, by in off.items() if by.size > max(least, excused[name])}
    if beyond:
        name, by = largest_violation(beyond)
        raise NotAssembled(
            f"{name} is left with {by.text(per)}: its rows cannot all be satisfied at this q "
            f"({check(scene, q, None)}); Scene.assemble closes loops, and "
            "Scene.rank names redundant rows"
        )


# Completion: the state of the passive joints from those of the motors.
#
# With the columns of J split into motors A, dependent joints D and the rest,
#
#     J_D dq_D + J_A dq_A = 0,     G = dq/dq_A = ( I on A,  -J_D^+ J_A on D,  0 on the rest ).
#
# Where rows are driven, c(q) = s(t), the motors leave J_D v_D = s'(t) - J_A v_A:
#
#     v = G v_A + ( 0 on A,  J_D^+ s' on D,  0 on the rest ).
#
# The rest is what neither motors nor loops determine, such as a floating base, springs, or the spin
# of a rod: it stays where it is. `ContinuationSolver` moves the motors.


@dataclass(frozen=True, eq=False)
class CompleteState:
    """The whole state that belongs to given motor positions and speeds.

    v = G v_actuated + J_D^+ s'

    Attributes
    ----------
    q : (nq,) array
        Configuration [rad, m].
    v : (nv,) array
        G times the velocities of the motors, and what driven rows add: J_D^+ s'.
    G : (nv, n_actuated) array
        dq/dq_actuated, in tangent columns [1, m, 1/m].
    undetermined : int
        Directions in which the robot can still move with the motors held. Of these, q and v are
        those of `near`, at rest.
    conflicting : int
        Conditions among the motors themselves: more than zero if there are more motors than degrees
        of freedom. Then G holds only for motor motions that are compatible with each other.
    residual : float
        max abs(c(q)) [m, rad].
    assembly : Assembly
        The last closing, with branch and smallest singular value.
    """

    q: Array
    v: Array
    G: Array
    undetermined: int
    conflicting: int
    residual: float  # [m, rad]
    assembly: Assembly

    def __str__(self) -> str:
        lines = [str(self.assembly)]
        free = count_text(self.undetermined, "direction")
        lines.append(f"{free} that neither motors nor loops determine")
        if self.conflicting:
            lines.append(f"{count_text(self.conflicting, 'condition')} among the motors themselves")
        lines += [
            f"{label} = {rounded(x, decimals=6)}" for label, x in (("q", self.q), ("v", self.v))
        ]
        return "\n".join(lines)


@one_blas_thread
def complete_state(
    scene: Scene,
    q_actuated: ArrayLike,
    v_actuated: ArrayLike | None = None,
    *,
    near: ArrayLike | None = None,
    within_limits: bool = True,
) -> CompleteState:
    """Return the whole state from the motor positions and speeds that encoders measure.

    c(q) = 0,    v = G v_actuated,    q and v of the motors as given

    Parameters
    ----------
    scene : Scene
        With driven constraints ``scene.at(t)``: c(q) = s(t) and J v = s'(t).
    q_actuated : (k,) array_like
        Positions of the actuated joints, in the order of ``robot.actuated`` [rad, m].
    v_actuated : (k,) array_like, optional
        Their velocities [rad/s, m/s]; at rest by default, but for motors that are driven.
    near : (nq,) array_like, optional
        Where everything starts that the motors do not determine, and stays if the loops do not
        either: a floating base, springs, the spin of a rod. The nominal state by default. The
        motors are followed from there, in a straight line of their coordinates and in strides
        of 0.1 rad or less, so that its branch is kept [rad, m].
    within_limits : bool
        Refuse motors outside their limits, and those that take another joint out of its.

    Returns
    -------
    CompleteState

    Raises
    ------
    InvalidArgument
        If a motor is outside its limits, or the robot has none; or if driven rows move a motor at
        another velocity.
    NotAssembled
        If the loops cannot be closed with the motors there, or only beyond joint limits; also where
        driven rows have a motor elsewhere.
    UnsupportedConstraint
        If constraints are driven and the scene does not say at which time it is, or have no place.
    BranchChanged
        If a dead point lies on the way, whether or not the loops close beyond it.
    """
    robot, model, chains = scene.robot, scene.robot.model, chains_of(scene)
    check_time(scene)
    if belts := [b.name for b in scene.bounds if b.drive and not b.positioned]:
        raise UnsupportedConstraint(
            f"{', '.join(belts)}: rows on the velocity alone say nothing of where anything is; "
            "project_velocity makes a velocity fit to them"
        )
    robot.check_unedited()
    A = chains.actuated
    if not A.size:
        raise InvalidArgument(
            f"{robot.name} has no actuated joints: load_robot(..., actuated=[...]) or "
            "robot.with_motors(...) names some"
        )
    v_A = None if v_actuated is None else finite("v_actuated", v_actuated, A.size)
    start = nominal_configuration(scene) if near is None else normalised(model, "near", near)
    follower = ContinuationSolver(scene)
    target = with_motors(follower, start, q_actuated)
    if within_limits:
        check_held("q_actuated", chains.limits, target, A)
    assembly = drive(scene, follower, start, target)
    if within_limits:
        moved = limited(chains.limits, chains.dependent)
        if out := {j: by for j, by in assembly.beyond_limits.items() if j in moved}:
            raise NotAssembled(
                f"with the motors there, {beyond_text(out)}; move them elsewhere, or pass "
                "within_limits=False",
                replace(assembly, status=AssemblyStatus.BEYOND_LIMITS),
            )
    J = follower.jacobian(assembly.q)
    G = follower.G(J)
    passive = np.delete(J, A, axis=1)
    known = _rank(passive)
    return CompleteState(
        q=assembly.q,
        v=_velocity(scene, follower, assembly.q, G, v_A),
        G=G,
        undetermined=passive.shape[1] - known,
        conflicting=_rank(J) - known,
        residual=max((gap.size for gap in assembly.violation.values()), default=0.0),
        assembly=assembly,
    )


def _velocity(
    scene: Scene, follower: ContinuationSolver, q: Array, G: Array, v_A: Array | None
) -> Array:
    """Return v (nv,) of the motors' v_A, or of the least that driven rows leave to them."""
    if not scene.is_driven:
        return np.zeros(len(G)) if v_A is None else G @ v_A
    J, rates = follower.jacobian(q), follower.rates
    v = np.zeros(len(G))
    v[follower.dependent] = follower.inverse(J) @ rates
    missing, fast = rates - J @ v, float(np.abs(rates).max())
    if v_A is None:
        v_A = np.zeros(G.shape[1])
        if np.abs(missing).max() > tolerances.FORCES * fast:  # motors are moved too
            v_A = np.linalg.pinv(J @ G, rcond=tolerances.DEAD_POINT) @ missing
    v = v + G @ v_A
    off = np.abs(J @ v - rates)
    if off.max() > tolerances.FORCES * max(fast, np.abs(v).max()):
        row = scene.row_names[follower.closer.rows[int(off.argmax())]]
        raise InvalidArgument(
            f"v_actuated: {row} would leave its path by {off.max():.3g} m/s or rad/s: it moves the "
            "motors too; leave v_actuated out, or give velocities that fit"
        )
    return v


def _rank(J: Array) -> int:
    return rank_of(np.linalg.svd(J, compute_uv=False), tolerances.DEAD_POINT)


# Following: closed configurations along a motion of the motors, never across a dead point.
#
# The motors go from where they are to their target, in strides. In each, the dependent joints are
# predicted and then corrected,
#
#     q (+) G dq_A,     and from there J_D dq_D = -c(q) until the loops are closed.
#
# A stride from q0 is kept if at the predicted and at the corrected configuration
#
#     |J_D(q0)^+ J_D(q) - 1| <= 1/2     (largest singular value).
#
# Then J_D stays regular in it, and the motors lead to one configuration only. Towards a dead point
# J_D(q0)^+ grows and the strides shrink to nothing: it is reached from one side, and not crossed,
# whatever the sign of det(Q^T J_D) is beyond.
#
# References
# ----------
# Deuflhard. Newton Methods for Nonlinear Problems. Springer, 2011, section 5.1.


_LONGEST = 0.1  # stride of a motor [rad, m]
_SHORTEST = 1e-5  # the same: a gap of CLOSED hides a dead point that is nearer [rad, m]
_CHANGE = 0.5  # of J_D in a stride, relative
_CORRECTIONS = 10
_FARTHEST = 100.0  # that a motor is followed [rad, m]


class ContinuationSolver:
    """Continuation in the motor positions of one scene, the dependent joints following.

    `actuated` and `dependent` are velocity indices; `motors` are configuration indices.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, model, chains = scene, scene.robot.model, chains_of(scene)
        self.actuated, self.dependent = chains.actuated, chains.dependent
        self.motors, _ = indices(model, scene.robot.actuated)
        moving = np.zeros(model.nv, dtype=bool)
        moving[self.dependent] = True
        self.closer = LoopCloser.of(scene, moving)

    @property
    def rates(self) -> Array:
        """The rates s' of the rows of J: zero but where they are driven."""
        rates: Array = self.closer.equations.wanted[1][self.closer.rows]
        return rates

    def jacobian(self, q: Array) -> Array:
        """Return the rows of J that have a position, without what digits of a file make up."""
        (J,) = kept_rows(self._scene, self.closer.equations.jacobian(q))
        return J[self.closer.rows]

    def inverse(self, J: Array) -> Array:
        """Return J_D^+."""
        J_D = J[:, self.dependent]
        if not J_D.size:
            return np.zeros(J_D.shape[::-1])
        return np.asarray(np.linalg.pinv(J_D, rcond=tolerances.DEAD_POINT), dtype=np.float64)

    def G(self, J: Array) -> Array:
        """Return dq/dq_A (nv, n_actuated) in tangent columns."""
        A = self.actuated
        G = np.zeros((J.shape[1], A.size))
        G[A, np.arange(A.size)] = 1.0
        G[self.dependent] = -self.inverse(J) @ J[:, A]
        return G

    def follow(self, start: Array, target: Array) -> tuple[Array, float]:
        """Move the motors of a closed configuration towards a target, which has them elsewhere."""
        # Return the last configuration reached, closed, and the share of the way: less than 1 if
        # the strides shrank to nothing.
        model = self.closer.equations.model
        whole = np.array(pin.difference(model, start, target))[self.actuated]
        length = max(float(np.abs(whole).max()), _SHORTEST)
        q, share, stride = start, 0.0, _LONGEST / length
        while share < 1.0 and stride * length >= _SHORTEST:
            aim = 1.0 if share + stride >= 1.0 else share + stride
            there = np.array(pin.interpolate(model, start, target, aim)) if aim < 1.0 else target
            end = self._stride(q, (aim - share) * whole, there)
            if end is None:
                stride = (aim - share) / 2
            else:
                q, share, stride = end, aim, min(1.5 * stride, _LONGEST / length)
        return q, share

    def _stride(self, q: Array, dq_A: Array, there: Array) -> Array | None:
        """Return the end of a stride, or None if it is too long."""
        J = self.jacobian(q)
        inverse = self.inverse(J)
        dq = np.zeros(J.shape[1])
        dq[self.actuated] = dq_A
        dq[self.dependent] = -inverse @ (J[:, self.actuated] @ dq_A)
        predicted = np.array(pin.integrate(self.closer.equations.model, q, dq))
        predicted[self.motors] = there[self.motors]
        if self._change(inverse, predicted) > _CHANGE:
            return None
        end = self.closer.close(predicted, most=_CORRECTIONS)
        if end.size > tolerances.CLOSED or self._change(inverse, end.q) > _CHANGE:
            return None
        return end.q

    def _change(self, inverse: Array, q: Array) -> float:
        """Return |J_D(q0)^+ J_D(q) - 1|; 1 or more if J_D(q0) is singular."""
        change = inverse @ self.jacobian(q)[:, self.dependent] - np.eye(len(inverse))
        return float(np.linalg.norm(change, 2)) if change.size else 0.0


def with_motors(follower: ContinuationSolver, start: Array, q_actuated: ArrayLike) -> Array:
    """Return the start with the motors where they are to be."""
    model, motors = follower.closer.equations.model, follower.motors
    target = start.copy()
    target[motors] = finite("q_actuated", q_actuated, motors.size)
    target = normalised(model, "q_actuated", target)
    farthest = float(np.abs(pin.difference(model, start, target)).max())
    if not farthest <= _FARTHEST:
        raise InvalidArgument(
            f"q_actuated: a motor is {farthest:.3g} rad or m from where it is in `near`; "
            f"at most {_FARTHEST:g} are followed"
        )
    return target


def drive(scene: Scene, follower: ContinuationSolver, start: Array, target: Array) -> Assembly:
    """Close the start, and move the motors from there."""
    moving, motors = follower.closer.moving, follower.motors
    first = assemble_from(scene, start, moving, within_limits=False)
    if not first.status.ok:
        error = first.error()
        raise type(error)(f"where the motors start, {error}", first)
    q, share = follower.follow(first.q, target)
    there = q.copy()
    there[motors] = target[motors]
    last = assemble_from(scene, there, moving, within_limits=False)
    if share == 1.0:
        return last
    way = f"the motors were followed for {share:.1%} of the way from `near`"
    if not last.closed:
        raise NotAssembled(f"{way}; {last.error()}", last)
    J = follower.closer.equations.jacobian(q)
    loops = chains_of(scene).weakest(J)
    last = replace(last, status=AssemblyStatus.BRANCH_CHANGED, flipped=(loops,))
    raise BranchChanged(
        f"{loops}: {way}, up to a dead point; beyond, they lead to more than one configuration: "
        "pass a `near` on the side that is meant",
        last,
    )


# Sampling: random states that satisfy the constraints.


@one_blas_thread
def sample(
    scene: Scene,
    rng: np.random.Generator,
    *,
    spread: float = 0.2,
    speed: float = 1.0,
    tries: int = 50,
) -> tuple[Array, Array]:
    """Return a random (q, v) that satisfies the constraints.

    It is on the branch of the first posture, and within the joint limits if that posture is.

    Parameters
    ----------
    scene : Scene
    rng : numpy.random.Generator
        The source of randomness; the same generator gives the same states.
    spread : float
        Standard deviation of each joint about the nominal state, before closing [rad, m].
    speed : float
        Standard deviation of each velocity, before projection to J v = 0 [rad/s, m/s].
    tries : int
        How many random guesses are closed at most. One that cannot be closed takes as long as a
        thousand answers.

    Returns
    -------
    q : (nq,) array
        [rad, m].
    v : (nv,) array
        [rad/s, m/s].

    Raises
    ------
    InvalidArgument
        If `rng` is no generator, `spread` or `speed` is no number >= 0, or `tries` no count.
    NotAssembled
        If the loops cannot be closed at the nominal state, or from none of the random guesses.
    """
    check_generator(rng)
    for name, value in (("spread", spread), ("speed", speed)):
        if not finite(name, value, ()) >= 0:
            raise InvalidArgument(f"{name} = {value!r}: a number >= 0 is needed")
    check_count("tries", tries, least=1)
    scene.robot.check_unedited()
    model, nv, home = scene.robot.model, scene.robot.nv, nominal_configuration(scene)
    if not scene.nominal.closed:
        scene.state()  # raises what is in the way
    chains = chains_of(scene)
    limits = NO_LIMITS if chains.limits.beyond(home) else chains.limits
    closer = LoopCloser.of(scene, limits=limits)
    for _ in range(tries):
        guess = normalised(model, "q", pin.integrate(model, home, spread * rng.normal(size=nv)))
        end, status, flipped = best_end(chains, closer, guess, chains.assembly_mode)
        if status.ok:
            v = speed * rng.normal(size=nv)
            terms = closer.equations.mass(end.q), end.J, -closer.equations.wanted[1]
            return end.q, nearest(scene, end.q, "v", v, terms, closed=True)
    found = assembly_of(scene, closer, guess, end, status, flipped)
    raise NotAssembled(
        f"spread = {spread}: none of {tries} random configurations about the nominal one could be "
        f"closed; use a smaller spread. The last one: {found.error()}",
        found,
    )


def check_generator(rng: object) -> None:
    """Refuse what is no generator of random numbers."""
    check_type("rng", rng, np.random.Generator, "numpy.random.default_rng(seed) makes one")
