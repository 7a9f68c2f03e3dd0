"""Solution: an answer that carries its own proof."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from condyn_pin._core import show, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import count_text, renamed
from condyn_pin._core.arrays import Array, ArrayValue, read_only, rounded
from condyn_pin._core.linalg import redundant_rows
from condyn_pin._core.show import require_pandas
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import left_out_at, moves_back
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.joints import by_joint

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import RedundantRows
    from condyn_pin.dynamics.bearings import Bearing


# Rows that miss less, as a share of the largest, are not named.
_NAMED: Final = 0.1

# Of the numbers in a print.

# Why an answer is not ok, and what repairs a state; the rest of a status is what else may help.
_INACCURATE: Final = "the two equations do not hold well enough for the requested accuracy"
_SINGULAR: Final = (
    "the matrix of this method is singular: some rows are redundant or the configuration is "
    "singular (Scene.summary() names the rows)"
)
_NOT_FINITE: Final = (
    "the answer is not finite although the input is: mu is too small for redundant rows, or the "
    "numbers overflow"
)
_REPAIR: Final = (
    "if state_error is large, the state does not satisfy the constraints and no answer can: "
    "Scene.assemble and mechanism.project_velocity repair it"
)


class Status(show.Outcome):
    """The outcome of a solve; the value is advice."""

    OK = (
        "both equations hold at the state given, and a solves them to the requested accuracy; "
        "state_error says how far that state itself is from the constraints, and Scene.rank "
        "whether it is singular, where the equations do not determine the motion"
    )
    INACCURATE = (
        f"{_INACCURATE}: allow more iterations, try another mu, or solve with Reference(); "
        + _REPAIR
    )
    SINGULAR = (
        f"{_SINGULAR}; use Proximal(), or NullSpace() for kinds that it does not take, or give "
        "DenseKKT a small mu"
    )
    NOT_FINITE = f"{_NOT_FINITE}; use Proximal() or Reference()"

    def text(self, rows: int, cures: Iterable[str]) -> str:
        """Return name and cause, and of all `cures` those that may help a method that failed.

        A scene without rows has neither mu nor redundant ones.
        """
        if self.ok:
            return str(self)
        causes = {"INACCURATE": _INACCURATE, "SINGULAR": _SINGULAR, "NOT_FINITE": _NOT_FINITE}
        cause = causes[self.name] if rows else (
            "there are no constraints, so rounding or numbers that overflow are to blame; look at "
            "masses, velocities and torques"
        )  # fmt: skip
        repair = _REPAIR if rows and self is Status.INACCURATE else ""
        return self.text_of(cause, ", or ".join(cures), repair)


class Question(NamedTuple):
    """State, torques, forces from outside and drift control of one solve.

    Attributes
    ----------
    q, v, tau : (nq,), (nv,), (nv,) array
        Configuration [rad, m], velocity [rad/s, m/s] and joint torques [N m, N].
    forces : tuple of AppliedForce
        The forces from outside that were applied.
    drift : Baumgarte or None
        What gave a_ref; None where it is zero.
    """

    q: Array
    v: Array
    tau: Array
    forces: tuple[AppliedForce, ...] = ()
    drift: Baumgarte | None = None


class _Gaps(NamedTuple):
    position: float  # |c(q)|_inf [m, rad]
    velocity: float  # |J v|_inf [m/s, rad/s]


class StateError(_Gaps):
    """Distance of a state from its constraints.

    Attributes
    ----------
    position : float
        |c(q)|_inf [m, rad].
    velocity : float
        |J v|_inf [m/s, rad/s].
    q, v : (nv,) array
        The least moves, in the metric of M, that undone satisfy the constraints: J^+ c to first
        order, and J^+ J v at the configuration that is closed [rad, m; rad/s, m/s].
    """

    _solution: Solution

    @cached_property
    def _moves(self) -> tuple[Array, Array]:
        solution = self._solution
        return moves_back(solution.scene, solution.q, solution.v)

    @property
    def q(self) -> Array:
        """Error of the configuration (nv,), J^+ c to first order [rad, m]."""
        return self._moves[0]

    @property
    def v(self) -> Array:
        """Error of the velocity (nv,), J^+ J v where the loops are closed [rad/s, m/s]."""
        return self._moves[1]


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Solution:
    """Accelerations and constraint forces at one state, with three errors recomputed.

    M a + h = tau + J^T lam + sum J_f^T f,    P (J a + gamma - a_ref) = 0,    lam = P lam

    P = 1 - N N^T leaves out combinations of rows that are redundant where the loops are closed; on
    closed loops J a + gamma = a_ref. An answer that is ok satisfies these at the state given, and
    is that of the machine moved back by `state_error`, to first order. lam is the smallest one.

    Attributes
    ----------
    a : (nv,) array
        Joint accelerations [rad/s^2, m/s^2]; the free-flyer's in its body frame, linear first.
    lam : (m,) array
        Constraint forces, all rows, in the axes of each constraint [N, N m].
    residuals : Residuals
        The residuals, recomputed by Newton-Euler and forward kinematics, whatever the solver was;
        the properties below name them.
    status : Status
        OK if `error_bound` is within the accuracy that was asked for (1e-8 by default), J^T lam
        within ten times that, relative to the largest torque on a joint, and `doubt` below 0.1;
        and if a changes by no more than a tenth of the larger of |a| and gravity in `closed()`.
    iterations : int
        Iterations of the solver; 1 for a direct method.
    solve_time : float
        Time of the solve without the proof [s].
    scene : Scene
        What was solved.
    question : Question
        At which state, with which torques, forces and drift; `q`, `v`, `tau` and `applied` are
        those of it.
    """

    a: Array
    lam: Array
    residuals: Residuals
    status: Status
    iterations: int
    solve_time: float  # [s]
    scene: Scene
    question: Question
    _missed: Array | None = None

    proof = renamed("residuals")

    def __init__(
        self,
        a: Array,
        lam: Array,
        residuals: Residuals,
        status: Status,
        iterations: int,
        solve_time: float,
        scene: Scene,
        question: Question,
        missed: Array | None = None,
    ) -> None:
        # the guarded assignments of a frozen dataclass take twice as long
        its = self.__dict__
        its["a"], its["lam"], its["residuals"], its["status"] = a, lam, residuals, status
        its["iterations"], its["solve_time"] = iterations, solve_time
        its["scene"], its["question"], its["_missed"] = scene, question, missed

    @property
    def q(self) -> Array:
        """Configuration (nq,) [rad, m]."""
        return self.question.q

    @property
    def v(self) -> Array:
        """Velocity (nv,) [rad/s, m/s]."""
        return self.question.v

    @property
    def tau(self) -> Array:
        """Joint torques (nv,) [N m, N]."""
        return self.question.tau

    @property
    def applied(self) -> tuple[AppliedForce, ...]:
        """Forces from outside."""
        return self.question.forces

    @property
    def dynamics_error(self) -> float:
        """|M a + h - tau - J^T lam - sum J_f^T f|_inf [N, N m], by recursive Newton-Euler."""
        return self.residuals.dynamics

    @property
    def constraint_error(self) -> float:
        """|P (J a + gamma - a_ref)|_inf [m/s^2, rad/s^2], by forward kinematics.

        `rest` has what the rows miss that are left out.
        """
        return self.residuals.constraint

    @property
    def state_error(self) -> StateError:
        """Distance of the state from its constraints: |c(q)|_inf, |J v|_inf, and the moves."""
        found = StateError(self.residuals.violation, self.residuals.velocity)
        found._solution = self
        return found

    @property
    def doubt(self) -> float:
        """Share of the way to a singular posture that closing the loops covers [1].

        The move that closes them, or what it changes J by if that is less, over the smallest pivot
        of J that is kept: all in radians, and lengths in sizes of the loop; rounding on closed
        loops.
        From 0.1 on a is not determined at the precision of the state.
        """
        return self._kept.doubt if self.scene.robot.precision else 0.0

    @cached_property
    def _kept(self) -> RedundantRows:
        """The combinations of rows that are left out, on closed loops those that are redundant."""
        return left_out_at(self.scene, self.q)

    @property
    def rank(self) -> int:
        """Independent rows that are kept at this state."""
        return self._kept.rank

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """Rows that can go without changing the answer, as ``constraint.axis``."""
        return redundant_rows(self._kept.N, self.scene.row_names)

    @property
    def rest(self) -> dict[str, float]:
        """N N^T (J a + gamma - a_ref) by row [m/s^2, rad/s^2]: what no acceleration satisfies.

        Rows that contradict each other, because loops are open or J v is not 0; those with less
        than a tenth of the largest are not among them.
        """
        if self._missed is None:
            return {}
        missed = self._missed
        largest = float(np.abs(missed).max(initial=0.0))
        names = self.scene.row_names
        return {
            name: float(part)
            for name, part in zip(names, missed, strict=True)
            if abs(part) > max(_NAMED * largest, tolerances.OPEN)
        }

    def closed(self) -> Solution:
        """Return the answer of the machine moved back onto its constraints.

        At q (-) `state_error.q` and v - `state_error.v`. The distance between both answers is what
        the error of the state does to a.

        Raises
        ------
        InvalidArgument
            If the state is not finite.
        """
        from condyn_pin.dynamics.workspace import solve

        error = self.state_error
        q, v, tau, forces, drift = self.question
        q = np.array(pin.integrate(self.scene.robot.model, q, -error.q))
        return solve(self.scene, q, v - error.v, tau, forces=forces, drift=drift, throw=False)

    @property
    def error_bound(self) -> float:
        """Bound on the error of a, relative to the larger of |a|_inf and gravity [1].

        A bound, up to rounding of tau, at the nominal state of the scene and an estimate elsewhere;
        see `condyn_pin.dynamics.proof`. |a|_inf compares rad/s^2 with m/s^2 as plain numbers:
        in another unit of length another joint may be the fastest.
        """
        return self.residuals.bound

    @property
    def forces(self) -> dict[str, ConstraintForce]:
        """Force on the first-named body by constraint, in its axes [N, N m].

        Each works as the array of its components, and knows where it acts and on whom.
        """
        return self._sites.forces(self.lam)

    @property
    def world_forces(self) -> dict[str, Array]:
        """Force by constraint, in the axes of the world, at the origin of the constraint [N, N m].

        (3,) or (6,) each, force first. A coupling has no axes: it is left out.
        """
        return {name: force.in_world() for name, force in self.forces.items() if force.frame}

    def bearings(self) -> dict[str, Bearing]:
        """Return the wrench in every joint of the tree and in every loop, by name.

        f_i = I_i (a_i - g) + v_i x* I_i v_i - w_i + sum over children of iX_c f_c

        with w_i what constraints and forces from outside do to body i. On the child by its parent;
        of a loop on its second body by the first.

        Notes
        -----
        A recursion of Newton and Euler, and one more for each redundant row: these tell which
        components are determined. Cost: tens of microseconds each.
        """
        from condyn_pin.dynamics.bearings import bearings  # few answers are asked for them

        return bearings(self.scene, self.q, self.v, self.a, self.lam, self.applied)

    @cached_property
    def notices(self) -> tuple[str, ...]:
        """Notices, a sentence each.

        Springs and dampers of the robot that tau lacks, where a would change by more than a
        hundredth. Contacts that pull, as no ground does. Forces that are wrong where a is right.
        A singular configuration, where the equations ask for less than the loops. Where the answer
        is not ok, rows are not met, or forces are a thousand times the weight: rows that contradict
        each other, and those that constrain nothing there any more.

        Computed when first asked for; the singular values then cost a few solves.
        """
        from condyn_pin.dynamics.notices import notices_of  # most answers are not asked for them

        return notices_of(self, self._sites)

    @cached_property
    def _sites(self) -> Sites:
        return Sites(self.scene, self.q)

    def to_pandas(self) -> Any:
        """Return the answer as a `pandas.DataFrame` of one row; ``pandas.concat`` joins several.

        Columns: status, q and a by joint, lam by row, the errors, iterations and solve_time [s].

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        status, errors = [self.status.word], np.array(self.residuals)
        table = solution_columns(self.scene, status, self.q, self.a, self.lam, errors)
        table |= {"iterations": [self.iterations], "solve_time": [self.solve_time]}
        return require_pandas().DataFrame(table)

    def _repr_html_(self) -> str:
        """Return the answer as HTML for a notebook."""
        return solution_html(self)

    def __repr__(self) -> str:
        return (
            f"Solution({self.scene.robot.name}, {len(self.lam)} rows: "
            f"{self.status.word}, error bound {self.error_bound:.1e})"
        )

    def __str__(self) -> str:
        lines = [
            f"{self.status.word} in {1e6 * self.solve_time:.1f} us, "
            f"{count_text(self.iterations, 'iteration')}",
            f"dynamics error    {self.dynamics_error:.1e} N, N m",
            f"constraint error  {self.constraint_error:.1e} m/s^2, rad/s^2",
            f"state error       {self.state_error.position:.1e} m, rad; "
            f"{self.state_error.velocity:.1e} m/s, rad/s",
            f"error bound of a  {self.error_bound:.1e} (relative)",
        ]
        lines += ["accelerations a, entries of v [rad/s^2, m/s^2]:", rounded(self.a)]
        if self.scene.rows:
            lines.append("forces on the first-named body, axes of each constraint [N, N m]:")
        for name, force in self.forces.items():
            lines.append(f"{name:<28} {rounded(force.components)}")
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


# ConstraintForce: a force that knows on whom it acts, by whom, where, and in which axes.
#
# Of the pair of forces that a constraint is, the one on the first-named body counts; the other body
# feels the opposite. Both do the generalised force J^T lam together, over the rows of the
# constraint.


@dataclass(frozen=True, eq=False)
class Sites:
    """Frames and Jacobian of a scene's constraints at one configuration, computed on first use."""

    scene: Scene
    q: Array
    equations: Equations | None = None
    own: bool = False  # whether forces are in the axes of their rows, whatever was wanted

    @cached_property
    def axes(self) -> list[Any]:
        """The axes of each force in the world (3, 3); None for those of its rows."""
        wanted = [None if self.own else constraint.axes for constraint in self.scene.constraints]
        if not any(wanted):
            return wanted
        equations, robot = self._equations(), self.scene.robot
        equations.placements(self.q)
        places = [None if frame is None else robot.frame(frame) for frame in wanted]
        return [at and np.array((equations.data.oMi[at[0]] * at[1]).rotation) for at in places]

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
class ConstraintForce(ArrayValue):
    """The force of one constraint on one of its two bodies, usable as the array of its numbers.

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
        Whose axes the components are in, the constraint's `axes` if it has such; empty for a
        coupling. For a `PlanarContact` it is the plane, z along its normal; for what rolls, the
        directions of its rows.
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
        """The point of the world (3,) at which the force acts [m]."""
        bound = self._sites.scene.bounds[self._index]
        return bound.acts_at(*self._ends, on_first=self._first)

    @property
    def scene(self) -> Scene:
        """The scene of the constraint."""
        return self._sites.scene

    @property
    def constraint(self) -> Constraint:
        """The constraint that exerts the force."""
        return self._sites.scene.constraints[self._index]

    @property
    def rotation(self) -> Array:
        """The axes of the components in the world (3, 3), column by column."""
        R = self._sites.axes[self._index]
        return np.array(self._ends[0].rotation if R is None else R)

    @property
    def own(self) -> ConstraintForce:
        """Force in the constraint's own axes, c1's, where it has others."""
        if self._sites.axes[self._index] is None:
            return self
        force = _force(replace(self._sites, own=True), self._index, self.lam)
        return force if self._first else force.on_other()

    def in_world(self) -> Array:
        """Return the force in the axes of the world, still at `at`: (3,) or (6,)."""
        R = self.rotation
        return np.asarray((self.components.reshape(-1, 3) @ R.T).ravel())

    def on_other(self) -> ConstraintForce:
        """Return the opposite force: on the other body, in the same axes."""
        b = self._sites.scene.bounds[self._index]
        scale = b.reaction(on_first=self._first)
        return ConstraintForce(
            name=self.name, components=read_only(-scale * self.components), on=self.by, by=self.on,
            frame=self.frame, lam=self.lam, _sites=self._sites, _index=self._index,
            _first=not self._first,
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
        axes = f", axes of {self.frame}" if self.frame else ""
        force = f"{self.name}: {rounded(self.components)}"
        return f"ConstraintForce({force} on {self.on} by {self.by}{axes})"


def pulling(forces: dict[str, ConstraintForce], sites: Sites, unit: str = "N") -> tuple[str, ...]:
    """Sentences on contacts with the world that pull, and on cables that push."""
    # The normal is the z axis of a `SurfaceContact` and that of the plane of a `PlanarContact` and
    # of what rolls. A point or a line has none: the vertical stands for it, if there is gravity.
    # Where rows are redundant, forces N z may be added, J^T N = 0: a normal force counts that no z
    # changes, and else the least pull that some z leaves.
    up = upward(sites.scene)
    largest = max((float(np.abs(f.components).max()) for f in forces.values()), default=0.0)
    least = -tolerances.SOLVED * largest
    cables = [each.name for each in sites.scene.constraints if each.only_pulls]
    slack = [
        f"{name}: the cable pushes with {-forces[name].components[0]:.4g} {unit}; a Cable in "
        "contacts=[...] goes slack"
        for name in cables
        if forces[name].components[0] < least
    ]
    pressing = [each for each in sites.scene.constraints if each.presses]
    normals = {
        each.name: float(force.own[2] if each.has_normal else force.in_world()[:3] @ up)
        for each in pressing
        for force in (forces[each.name],)
    }
    pulls = [each for each in pressing if normals[each.name] < least]
    if not pulls:
        return tuple(slack)
    shared = shared_normals(sites, normals)
    said = slack + [
        pull_text(each, f"{-normals[each.name]:.4g} {unit}")
        for each in pulls
        if each.name not in shared.names
    ]
    if len(said) < len(pulls) and shared.most < least:
        said.append(shared_text(shared, f"{-shared.most:.4g} {unit}"))
    return tuple(said)


class SharedNormals(NamedTuple):
    """Normal forces that redundant rows share among contacts.

    names: contacts whose normal force is not determined: forces N z without effect change it
    most: the least of them, where z makes that as large as can be, 0 at most [N]
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
        "the load; on real ground it would open"
    )


def _normal_row(sites: Sites, name: str) -> Array:
    """Coefficients (m,) of lam in the normal force of a contact."""
    up, i = upward(sites.scene), sites.scene.names.index(name)
    constraint, rows = sites.scene.constraints[i], sites.scene.bounds[i].rows
    found = np.zeros(sites.scene.rows)
    for row, unit in zip(range(rows.start, rows.stop), np.eye(rows.stop - rows.start), strict=True):
        force = _force(sites, i, unit)
        found[row] = force.own[2] if constraint.has_normal else force.in_world()[:3] @ up
    return found


def upward(scene: Scene) -> Array:
    """Return the direction against gravity (3,); zero where there is none."""
    up = -np.array(scene.robot.model.gravity.linear)
    return np.asarray(up / max(float(np.linalg.norm(up)), np.finfo(float).tiny))


def pull_text(constraint: Constraint, pull: str) -> str:
    """Return the sentence on a contact that pulls, with how much."""
    words = "" if constraint.has_normal else " (the vertical is its normal)"
    return f"{constraint.name}: the contact pulls with {pull}{words}; on real ground it would open"


def _force(sites: Sites, i: int, lam: Array) -> ConstraintForce:
    """Return the force of one constraint on its first-named body."""
    constraint, bound = sites.scene.constraints[i], sites.scene.bounds[i]
    components = bound.force(lam, lambda: sites.placements[i])
    on, by, frame = constraint.acting(swapped=bound.sign < 0)
    if (R := sites.axes[i]) is not None:
        turn = R.T @ sites.placements[i][0].rotation
        components, frame = (components.reshape(-1, 3) @ turn.T).ravel(), str(constraint.axes)
    return ConstraintForce(
        name=bound.name,
        components=read_only(components),
        on=on,
        by=by,
        frame=frame,
        lam=read_only(lam.copy()),
        _sites=sites,
        _index=i,
        _first=True,
    )


def forces_in_axes(scene: Scene, Q: Array, lam: Array) -> dict[str, Array]:
    """Forces of the constraints with `axes`, in these, at many states (k, 3) or (k, 6) [N, N m]."""
    # The rows of lam (k, m) are taken at the configurations Q (k, nq).
    names = [b.name for b, c in zip(scene.bounds, scene.constraints, strict=True) if c.axes]
    if not names:
        return {}
    equations = Equations(scene.robot.unedited, scene.bounds)
    each = [Sites(scene, q, equations).forces(row) for q, row in zip(Q, lam, strict=True)]
    return {name: np.array([forces[name].components for forces in each]) for name in names}


# Columns of answers, named by joint and by constraint: of one state, or of many.


# How `Solution` and `BatchSolution` call the numbers of `Residuals`.
_ERRORS = {
    "dynamics": "dynamics_error", "constraint": "constraint_error", "violation": "violation",
    "velocity": "velocity_violation", "bound": "error_bound",
}  # fmt: skip


def solution_columns(
    scene: Scene, status: Any, q: Array, a: Array, lam: Array, residuals: Array
) -> dict[str, Any]:
    """Return statuses, q, a, lam and errors of N states by name, each (N,)."""
    q, a, lam = (np.atleast_2d(each) for each in (q, a, lam))
    table = {"status": status} | by_joint(scene.robot.model, {"q": q, "a": a})
    table |= {f"lam {name}": each for name, each in zip(scene.row_names, lam.T, strict=True)}
    errors = zip(Residuals._fields, np.atleast_2d(residuals).T, strict=True)
    return table | {_ERRORS[name]: each for name, each in errors}


# A Scene and a Solution as a notebook shows them.


def scene_html(scene: Scene) -> str:
    """Return a scene as HTML: robot, constraints and contacts; the rank is in `Scene.summary`."""
    robot = scene.robot
    rows = [(each.name, each.title, str(each.rows)) for each in scene.constraints]
    touching = [(each.name, type(each).__name__) for each in scene.contacts]
    said = {
        "robot": f"{robot.name}: nq {robot.nq}, nv {robot.nv}, {robot.mass:.6g} kg",
        "constraints": f"{len(rows)}, with {scene.rows} rows",
        "contacts": f"{len(touching)} that may open and slide",
    }
    return show.page(
        f"Scene of {robot.name}",
        show.facts(said.items()),
        show.folded_html(
            "constraints", show.grid(("constraint", "kind", "rows"), rows), count=len(rows)
        ),
        show.folded_html("contacts", show.grid(("contact", "kind"), touching), count=len(touching)),
        '<div style="opacity:0.7">scene.summary() has rank, redundant rows and mobility</div>',
    )


def solution_html(solution: Solution) -> str:
    """Return status, errors, forces and notices of an answer."""
    state, status = solution.state_error, solution.status
    steps = count_text(solution.iterations, "iteration")
    said = {
        "dynamics error": f"{solution.dynamics_error:.1e} N, N m",
        "constraint error": f"{solution.constraint_error:.1e} m/s², rad/s²",
        "state error": f"{state.position:.1e} m, rad; {state.velocity:.1e} m/s, rad/s",
        "error bound of a": f"{solution.error_bound:.1e} (relative)",
        "time": f"{1e6 * solution.solve_time:.1f} µs, {steps}",
    }
    forces = [
        (name, force.on, force.by, *_six([f"{x:.4f}" for x in force.components]))
        for name, force in solution.forces.items()
    ]
    headings = ("constraint", "on", "by", "fx", "fy", "fz", "mx", "my", "mz")
    return show.page(
        f"{solution.scene.robot.name}: {status.word}",
        "" if status.ok else show.notes([status.value]),
        show.facts(said.items()),
        show.folded_html(
            "forces on the first-named body, in the axes of each constraint [N, N m]",
            show.grid(headings, forces),
            count=len(forces),
        ),
        show.notes(solution.notices),
        ok=status.ok,
    )


def _six(numbers: list[str]) -> list[str]:
    """Return three or six components as six cells; of a coupling or a rod there is one."""
    return numbers + [""] * (6 - len(numbers))
