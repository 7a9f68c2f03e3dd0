"""Inverse kinematics with loops: the configuration with closed loops that is nearest to targets.

    min over q of  sum_k w_k |x_k* - x_k(q)|^2 / 2    with  c(q) = 0,    lower <= q <= upper

x_k is what task k tracks (`condyn_pin.control.Tracking`), c the gap of the loops. A step is one of
Levenberg and Marquardt in the motions Z that the loops leave, J Z = 0, with E the Jacobian of all
x_k and e what is left of them, weighted by w_k:

    dq = Z y,    min over y of  |E Z y - e|^2 / 2 + nu min(|e|, 1)^2 |y|^2 / 2,    lower <= q + dq <= upper

Then the loops are closed again, and the step counts if |e| fell. No weight is between loops and
targets. What targets leave free goes to a posture, if one is given:

    min |q - posture|^2 / 2    with  c(q) = 0,    e(q) as it was

The proof is the gradient of the first problem, without what stops of joints carry,

    Z^T E^T e + sum_i mu_i z_i = 0,    mu_i >= 0,    z_i the row of Z of a joint that is at its stop

and no motion along which that problem curves down, as where an arm is stretched past its target:

    y^T H y >= 0    for all Z y that move no joint with mu_i > 0
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import (
    check_count,
    check_flag,
    check_type,
    checked_names,
    count_text,
    listed,
    normalised,
)
from condyn_pin._core.arrays import Array, finite, text_of
from condyn_pin._core.linalg import null_space
from condyn_pin._core.models import algorithms, data_of, indices, lengths
from condyn_pin._core.show import Outcome
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.forces import ALIGNED, frame_jacobian
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.control.qp.chain import SolverLadder
from condyn_pin.control.qp.qp_solver import QPSolver, QuadraticProgram
from condyn_pin.control.qp.solvers import DAQP
from condyn_pin.control.tasks.task import BoundTask, RobotMotion, TaskQuantity, Tracking
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument, TargetsNotReached
from condyn_pin.mechanism.assembling import assemble_from, check_held, nominal_configuration
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.closing import Assembly, LoopCloser, anchored
from condyn_pin.model.joints import NO_LIMITS

_LONGEST: Final = 0.4  # move of any joint in one step [rad, m]
_CLOSING: Final = 12  # steps that close the loops again after one towards the targets
_DAMPING: Final = 1e-2  # nu at the start
_MOST_DAMPING: Final = 1e12  # where no step brings the targets nearer any more
_FLOOR: Final = 1e-12  # of the damping, relative to |E Z|^2: targets leave some motions free
_SPREAD: Final = 0.4  # of the second start about the first, of the third twice that [rad, m]
_WIDEST: Final = 6  # of these spreads
_SETTLED: Final = 1e-8  # move of any joint that ends the search [rad, m]
_CARRIED: Final = 1e-6  # of |E| |e|: what a joint at its limit carries, if it is in the way
_APART: Final = 1e-3  # moves between which gradients are compared [rad, m]
_CURVED: Final = 1e-6  # curvature that is downwards, relative to the largest
_DOWN: Final = (0.1, 0.01, 0.001)  # moves along it [rad, m]
_HOLDING: Final = 4  # steps that restore loops and targets after one towards the posture


class IKStatus(Outcome):
    """Outcome of an inverse kinematics; the value is advice."""

    REACHED = "the loops are closed and every target is met"
    AT_LIMITS = (
        "joints at their limits keep the targets out of reach; move the targets, or pass "
        "attempts=10 or within_limits=False"
    )
    STATIONARY = (
        "no small motion brings the targets nearer: they are out of reach, or contradict each "
        "other, or another start leads there; move them, or pass attempts=10"
    )
    OPEN = "the loops could not be closed at the start; give another q0"
    OUT_OF_STEPS = "the targets were still getting nearer; pass more steps, solve_ik(steps=1000)"


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """Configuration nearest to targets, with its errors and the proof that none is nearer nearby.

    Attributes
    ----------
    q : (nq,) array
        [rad, m]; quaternions x y z w.
    errors : dict of str to array
        Of each task by its name: target minus actual [m, rad], in the order of its rows.
    status : IKStatus
    at_limits : tuple of str
        Joints that are at a limit.
    slope : float
        Gradient of the sum of squares along the motions that loops and limits leave [m, rad], zero
        where no small motion brings the targets nearer.
    iterations : int
        Of the attempt that ended here.
    attempts : int
        Starts that were tried.
    assembly : Assembly
        Gaps of the loops, rank, branch and passed limits at q.
    """

    q: Array
    errors: Mapping[str, Array]
    status: IKStatus
    at_limits: tuple[str, ...]
    slope: float  # [m, rad]
    iterations: int
    attempts: int
    assembly: Assembly

    @property
    def violation(self) -> Mapping[str, ConstraintViolation]:
        """How far each loop is open: a length [m] and an angle [rad]."""
        return self.assembly.violation

    def error(self) -> TargetsNotReached:
        """Return the error that `solve_ik` raises if the status is not REACHED."""
        if self.status is IKStatus.OPEN:
            return TargetsNotReached(f"q0: {self.assembly.error()}", self)
        name, worst = max(self.errors.items(), key=lambda item: _size(item[1]))
        text = f"{name} is {_size(worst):.3g} from its target after {self.iterations} iterations; "
        text += f"at limits: {listed(self.at_limits)}; " if self.at_limits else ""
        return TargetsNotReached(text + self.status.value, self)

    def __str__(self) -> str:
        lines = [str(self.status)]
        lines += [f"{name:<28} {_size(e):.3g} from its target" for name, e in self.errors.items()]
        lines += [f"{name:<28} open by {gap}" for name, gap in self.violation.items()]
        lines += [f"at limits: {listed(self.at_limits)}"] if self.at_limits else []
        steps = count_text(self.iterations, "iteration")
        lines += [f"{steps}, attempt {self.attempts}, slope {self.slope:.1e}"]
        return "\n".join(lines)


@one_blas_thread
def solve_ik(
    scene: Scene,
    targets: Sequence[Tracking],
    q0: ArrayLike | None = None,
    *,
    posture: str | ArrayLike | None = None,
    fixed: Sequence[str] = (),
    within_limits: bool = True,
    t: float = 0.0,
    attempts: int = 1,
    steps: int = 100,
    qp: QPSolver | None = None,
    throw: bool = True,
) -> InverseKinematics:
    """Return the configuration with closed loops that meets targets, or comes nearest to them.

    min over q of  sum_k w_k |x_k* - x_k(q)|^2 / 2    with  c(q) = 0,    lower <= q <= upper

    Parameters
    ----------
    scene : Scene
        Its loops stay closed, and its contacts stay where they are at the start. Contacts that may
        open are ignored.
    targets : sequence of Tracking
        Tasks of a controller: `FrameTask`, `Orientation`, `CenterOfMass`, `JointTask`, `Posture`.
        The `reference` of each is its target, and `weight` counts where not all can be met; gains
        and rates do not matter.
    q0 : (nq,) array_like, optional
        Start [rad, m]; the closed first posture of the robot by default.
    posture : str or (nq,) array_like, optional
        What joints approach where the targets leave a choice: the name of a posture, or a
        configuration [rad, m]. By default they stay near the start.
    fixed : sequence of str
        Joints that stay as they are in q0, such as stiff springs.
    within_limits : bool
        Whether joints stay within their limits.
    t : float
        Time of driven constraints, and of references that are functions of time [s].
    attempts : int
        How many starts are tried at most, until one reaches the targets: q0, then random ones about
        it, further and further. The best is returned.
    steps : int
        How many each attempt may have.
    qp : QPSolver, optional
        Solver of the step; `DAQP()` by default.
    throw : bool
        Whether targets that are not met raise an error.

    Returns
    -------
    InverseKinematics

    Raises
    ------
    InvalidArgument
        If a target has no position, such as a contact force, or an infinite weight; if q0 or an
        option is not what is needed.
    TargetsNotReached
        If `throw` and the status is not REACHED; the error has the answer.
    MissingExtra
        If the solver of quadratic programs is not installed.

    Notes
    -----
    Levenberg-Marquardt in the null space of the loops' Jacobian, a quadratic program where joints
    are near limits, Newton's method on the loops after each step. It converges quadratically where
    the targets can be met. A pose whose target is turned by nearly half a turn has several
    directions to go; give it in two steps.

    Cost: 4 to 6 steps from nearby, each a few hundred microseconds.

    References
    ----------
    Sugihara. Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method. IEEE
    Transactions on Robotics, 2011.
    """
    check_scene(scene)
    robot = scene.robot
    robot.check_unedited()
    check_count("attempts", attempts)
    check_count("steps", steps)
    check_flag("within_limits", within_limits)
    qp = DAQP() if qp is None else qp
    check_type("qp", qp, QPSolver, "a solver such as DAQP() is needed")
    time = float(finite("t", t, ()))
    bare = scene.bilateral.at(time)
    start = nominal_configuration(bare) if q0 is None else normalised(robot.model, "q0", q0)
    held = indices(robot.model, checked_names("fixed", fixed, robot.joints, "joint"))[1]
    limits = chains_of(bare).limits if within_limits else NO_LIMITS
    check_held("fixed", limits, start, held)
    moving = np.ones(robot.nv, dtype=bool)
    moving[held] = False
    if isinstance(posture, str):
        posture = described_posture(scene, posture)
    goal = None if posture is None else normalised(robot.model, "posture", posture)
    bare = anchored(bare, start)
    closer = LoopCloser.of(bare, moving, limits)
    search = _Search(bare, _bound(bare, targets, time), closer, qp)
    rng = np.random.default_rng(0)
    best: InverseKinematics | None = None
    least = np.inf
    for attempt in range(1, attempts + 1):
        spread = _SPREAD * min(attempt - 1, _WIDEST)
        move = spread * rng.normal(size=robot.nv) * moving
        near = np.array(pin.integrate(robot.model, start, move))
        first = assemble_from(bare, near, moving, within_limits=within_limits)
        found = search.run(first, goal, steps)
        miss = search.miss(np.concatenate(list(found.errors.values())))
        if best is None or (found.assembly.closed, -miss) > (best.assembly.closed, -least):
            best, least = found, miss
        best = replace(best, attempts=attempt)
        if best.status.ok:
            break
    assert best is not None
    if throw and not best.status.ok:
        raise best.error()
    return best


def _size(e: Array) -> float:
    return float(np.linalg.norm(e))


def _bound(
    scene: Scene, targets: Sequence[Tracking], t: float
) -> dict[str, tuple[BoundTask, float]]:
    """Tasks at time t, bound to the scene, and their weights, by name."""
    if not isinstance(targets, Sequence):
        raise InvalidArgument(f"targets = {text_of(targets)}: a list of tasks is needed")
    bound: dict[str, tuple[BoundTask, float]] = {}
    for i, task in enumerate(targets):
        if not isinstance(task, Tracking):
            raise InvalidArgument(
                f"targets[{i}] = {text_of(task)}: a task with a position is needed, such as "
                "FrameTask('foot', reference=[0, 0, 0.1])"
            )
        if not 0.0 < task.weight < np.inf:
            raise InvalidArgument(
                f"targets[{i}]: weight = {task.weight:g}; loops and limits hold exactly, a target "
                "needs a positive, finite weight"
            )
        if task.name in bound:
            raise InvalidArgument(f"targets[{i}]: two are named {task.name!r}; pass name=...")
        bound[task.name] = (
            task.at(t).bind(scene, lambda: nominal_configuration(scene)), task.weight,
        )  # fmt: skip
    if not bound:
        raise InvalidArgument("targets: one at least is needed; Scene.assemble closes the loops")
    return bound


class _ClosedConfiguration(NamedTuple):
    """A configuration with closed loops, J (r, nv) of their gaps, e (s,) and E (s, nv)."""

    q: Array
    J: Array
    e: Array
    E: Array


class _Still(RobotMotion):
    """The robot of a scene at rest, for tasks that ask where it is."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.model = scene, scene.robot.unedited
        self.data, self.v = data_of(self.model), np.zeros(self.model.nv)
        self._run = algorithms(self.data)

    def place(self, q: Array) -> None:
        """Go to a configuration."""
        self.q = q
        self._run.computeJointJacobians(self.model, self.data, q)

    def frame(self, joint: int, placement: Any) -> TaskQuantity:
        """Return a frame: its placement in the world, and 6 rows in the axes of the world."""
        J = frame_jacobian(self.model, self.data, joint, placement, ALIGNED)
        return TaskQuantity(self.data.oMi[joint] * placement, np.zeros(6), J, np.zeros(6))

    def center_of_mass(self) -> TaskQuantity:
        """Return the centre of mass: 3 rows in the axes of the world."""
        com = np.array(self._run.centerOfMass(self.model, self.data, self.q))
        J = np.array(self._run.jacobianCenterOfMass(self.model, self.data, self.q))
        return TaskQuantity(com, np.zeros(3), J.reshape(3, -1), np.zeros(3))


def _are_lengths(model: Any, task: BoundTask) -> Array:
    """Flag of each row of a task: a length, or else an angle."""
    if task.fixed is None:
        return np.array(["about " not in name for name in task.names])
    of_columns = np.concatenate([lengths(joint) for joint in list(model.joints)[1:]])
    return np.asarray(of_columns[np.abs(task.fixed).argmax(axis=1)])


class _Search:
    """The search from one start after the other: tasks, loops and limits of one problem."""

    def __init__(
        self,
        scene: Scene,
        tasks: dict[str, tuple[BoundTask, float]],
        closer: LoopCloser,
        qp: QPSolver,
    ) -> None:
        self._scene, self._tasks, self._closer = scene, tasks, closer
        self._motion = _Still(scene)
        self._ladder = SolverLadder(qp)
        weights = [np.full(len(task.names), weight) for task, weight in tasks.values()]
        every = np.concatenate(weights)
        self._root = np.sqrt(every / every.max())  # of the weight of each row
        size = scene.robot.longest_link or 1.0
        flags = [_are_lengths(scene.robot.model, task) for task, _ in tasks.values()]
        self._unit = np.where(np.concatenate(flags), size, 1.0)  # of each row [m, rad]

    def run(self, first: Assembly, posture: Array | None, steps: int) -> InverseKinematics:
        """Answer from a start with closed loops."""
        closing = self._closer.close(first.q)
        here = self._place(closing.q, closing.J)
        self._check_distance(here)
        if not first.closed:
            return self._answer(here, IKStatus.OPEN, 0, first)
        here, status, iterations = self._towards_targets(here, steps)
        if posture is not None:
            here = self._towards_posture(here, posture, steps)
        return self._answer(here, status, iterations)

    def _place(self, q: Array, J: Array) -> _ClosedConfiguration:
        """Targets at a configuration with closed loops; J is that of all rows."""
        self._motion.place(q)
        rows = [(task.approach or task.rows)(self._motion, 0.0) for task, _ in self._tasks.values()]
        E, e = np.vstack([E for E, _ in rows]), np.concatenate([e for _, e in rows])
        return _ClosedConfiguration(q, J[self._closer.rows], e, E)

    def _met(self, e: Array) -> bool:
        """True if errors e, or changes of them, count as none."""
        return float(np.abs(e / self._unit).max()) <= tolerances.TARGET

    def _check_distance(self, here: _ClosedConfiguration) -> None:
        """Refuse targets that are so far away that rounding hides what the robot moves."""
        for name, e in self._errors(here._replace(e=here.e / self._unit)).items():
            if not np.abs(e).max() <= tolerances.FAR:
                raise InvalidArgument(
                    f"{name}: its target is {_size(self._errors(here)[name]):.3g} away, and the "
                    f"longest link {self._scene.robot.longest_link or 1.0:.3g} m: no robot reaches "
                    "that; correct its reference"
                )

    def miss(self, e: Array) -> float:
        """|e|, weighted."""
        return _size(self._root * e)

    def _weighted(self, here: _ClosedConfiguration) -> tuple[Array, Array]:
        """Rows e and E, times the roots of their weights."""
        return self._root * here.e, self._root[:, None] * here.E

    def _free(self, rows: Array) -> Array:
        """Basis Z (nv, k) of the motions of the joints that may move with no motion of rows."""
        moving = self._closer.moving
        basis = null_space(rows[:, moving])
        Z = np.zeros((len(moving), len(basis)))
        Z[moving] = basis.T
        return Z

    def _towards_targets(
        self, here: _ClosedConfiguration, steps: int
    ) -> tuple[_ClosedConfiguration, IKStatus, int]:
        """Configuration nearest to the targets."""
        nu = _DAMPING
        for iteration in range(steps):
            if self._met(here.e):
                return here, IKStatus.REACHED, iteration
            Z, (e, E) = self._free(here.J), self._weighted(here)
            A, size = E @ Z, _size(e)
            H, g = A.T @ A, -A.T @ e
            H.flat[:: len(g) + 1] += nu * min(size, 1.0) ** 2 + _FLOOR * (np.trace(H) or 1.0)
            dq = self._within(here.q, Z, H, g)
            there = self._closed(here.q, dq)
            gained = 0.0 if there is None else size**2 - self.miss(there.e) ** 2
            if there is None or gained <= 0.0:
                nu *= 10.0
                stuck = nu > _MOST_DAMPING or np.abs(dq).max(initial=0.0) < tolerances.CLOSED
            else:
                promised = size**2 - _size(e - E @ dq) ** 2
                nu *= 4.0 if gained < 0.25 * promised else 0.2 if gained > 0.75 * promised else 1.0
                here = there
                stuck = np.abs(dq).max() < _SETTLED and not self._met(here.e)
            if stuck:
                _, carries = self._carried(here)
                lower = self._lower(here, carries)
                if lower is None:
                    status = IKStatus.AT_LIMITS if carries.any() else IKStatus.STATIONARY
                    return here, status, iteration + 1
                here, nu = lower, _DAMPING
        status = IKStatus.REACHED if self._met(here.e) else IKStatus.OUT_OF_STEPS
        return here, status, steps

    def _towards_posture(
        self, here: _ClosedConfiguration, posture: Array, steps: int
    ) -> _ClosedConfiguration:
        """Configuration nearest to a posture among those with the targets where they are."""
        model, moving = self._scene.robot.model, self._closer.moving
        damping = 1e-3
        for _ in range(steps):
            p = np.array(pin.difference(model, here.q, posture)) * moving
            N = self._free(np.vstack((here.J, here.E)))
            H = (1.0 + damping) * np.eye(N.shape[1])
            dq = self._within(here.q, N, H, -N.T @ p)
            if np.abs(dq).max(initial=0.0) < _SETTLED:
                break
            there = self._held(here, dq)
            left = None if there is None else pin.difference(model, there.q, posture) * moving
            if there is not None and left is not None and left @ left < p @ p:
                here, damping = there, max(damping / 5.0, 1e-6)
            elif (damping := 10.0 * damping) > _MOST_DAMPING:
                break
        return here

    def _within(self, q: Array, Z: Array, H: Array, g: Array) -> Array:
        """Step dq = Z y with the least y H y / 2 + g y within limits, none longer than _LONGEST."""
        limits = self._closer.limits
        x, C = q[limits.iq], Z[limits.iv]
        y = -np.linalg.solve(H, g) if len(g) else g
        lower, upper = np.minimum(limits.lower - x, 0.0), np.maximum(limits.upper - x, 0.0)
        dx = C @ y
        if ((dx < lower) | (dx > upper)).any():
            none = np.zeros((0, len(g))), np.zeros(0)
            program = QuadraticProgram(H, g, *none, C, lower, upper)
            answer = self._ladder.solve(program, lambda: (none[1], np.ones(len(lower)))).answer
            y = answer.x if answer else np.zeros(len(g))
        dq: Array = Z @ y
        longest = float(np.abs(dq).max(initial=0.0))
        return dq if longest <= _LONGEST else dq * (_LONGEST / longest)

    def _closed(self, q: Array, dq: Array) -> _ClosedConfiguration | None:
        """Configuration after a step, its loops closed again; None if they stay open."""
        moved = np.array(pin.integrate(self._scene.robot.model, q, dq))
        self._closer.limits.clip(moved)
        end = self._closer.close(moved, most=_CLOSING)
        return self._place(end.q, end.J) if end.size <= tolerances.CLOSED else None

    def _held(self, here: _ClosedConfiguration, dq: Array) -> _ClosedConfiguration | None:
        """Configuration after a step with loops and targets as they were; None if that fails."""
        there = self._closed(here.q, dq)
        for _ in range(_HOLDING):
            if there is None:
                return None
            off = here.e - there.e
            if self._met(10.0 * off):
                return there
            stops = self._stopped(there.q)
            free = self._closer.moving.copy()
            free[self._closer.limits.iv[stops]] = False
            rows = np.vstack((there.J, there.E))[:, free]
            wanted = np.concatenate((np.zeros(len(there.J)), -off))
            step = np.zeros(len(free))
            step[free] = np.linalg.lstsq(rows, wanted, rcond=tolerances.RANK)[0]
            there = self._closed(there.q, step)
        if there is None or not self._met(here.e - there.e):
            return None
        return there

    def _stops(self, q: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks of the limits that joints are at: of the lower and of the upper ones."""
        limits, x = self._closer.limits, q[self._closer.limits.iq]
        return x <= limits.lower + tolerances.TARGET, x >= limits.upper - tolerances.TARGET

    def _stopped(self, q: Array) -> NDArray[np.bool_]:
        """Mask of the limits that joints are at."""
        return np.logical_or(*self._stops(q))

    def _lower(
        self, here: _ClosedConfiguration, carries: NDArray[np.bool_]
    ) -> _ClosedConfiguration | None:
        """Nearer configuration along the most negative curvature where the gradient is zero."""
        stops = np.eye(len(here.E.T))[self._closer.limits.iv[carries]]
        Z = self._free(np.vstack((here.J, stops)))
        unlimited = replace(self._closer, limits=NO_LIMITS)
        model, H = self._scene.robot.model, np.zeros((Z.shape[1],) * 2)
        for i, z in enumerate(Z.T):
            for sign in (1.0, -1.0):
                end = unlimited.close(pin.integrate(model, here.q, sign * _APART * z))
                there = self._place(end.q, end.J)
                Y, (e, E) = self._free(there.J), self._weighted(there)
                H[i] -= sign / (2.0 * _APART) * (Z.T @ (Y @ (Y.T @ (E.T @ e))))
        curvatures, motions = np.linalg.eigh((H + H.T) / 2.0)
        if not len(H) or curvatures[0] >= -_CURVED * np.abs(curvatures).max():
            return None
        for move in (sign * move for move in _DOWN for sign in (1.0, -1.0)):
            lower = self._closed(here.q, move * Z @ motions[:, 0])
            if lower is not None and self.miss(lower.e) < self.miss(here.e):
                return lower
        return None

    def _errors(self, here: _ClosedConfiguration) -> dict[str, Array]:
        """Target minus actual, by task."""
        sizes = [len(task.names) for task, _ in self._tasks.values()]
        parts = np.split(here.e, np.cumsum(sizes)[:-1])
        return dict(zip(self._tasks, parts, strict=True))

    def _carried(self, here: _ClosedConfiguration) -> tuple[float, NDArray[np.bool_]]:
        """Gradient along the motions that loops leave, less what joints at limits carry; and which.

        The second is a mask of the limits.
        """
        Z, limits = self._free(here.J), self._closer.limits
        e, E = self._weighted(here)
        g, (low, high) = Z.T @ (E.T @ e), self._stops(here.q)
        carries = np.zeros(len(low), dtype=bool)
        pushed = np.vstack((-Z[limits.iv[low]], Z[limits.iv[high]]))
        if not len(pushed) or not len(g):
            return _size(g), carries
        # imported here: it takes as long to import as Pinocchio
        from scipy.optimize import nnls

        mu, slope = nnls(pushed.T, g)
        at = np.concatenate((np.flatnonzero(low), np.flatnonzero(high)))
        carries[at[mu > _CARRIED * float(np.linalg.norm(E)) * _size(e)]] = True
        return float(slope), carries

    def _answer(
        self,
        here: _ClosedConfiguration,
        status: IKStatus,
        iterations: int,
        assembly: Assembly | None = None,
    ) -> InverseKinematics:
        limits, stops = self._closer.limits, self._stopped(here.q)
        names = dict.fromkeys(limits.joints[i] for i in np.flatnonzero(stops))
        if assembly is None:
            within = limits is not NO_LIMITS
            assembly = assemble_from(self._scene, here.q, self._closer.moving, within_limits=within)
        return InverseKinematics(
            here.q,
            self._errors(here),
            status,
            tuple(names),
            self._carried(here)[0],
            iterations,
            1,
            assembly,
        )
