"""The main job, timed: ABA, LCABA, proximal and dense KKT on the same states of the same scenes.

Beside them stand the same equations written by hand, without input checks or residuals. A speed-up
over dense is one over the fastest of these and of dense KKT.

Error and time come from the same run. The error of a is taken against `Reference` at closed
states, relative to the larger of |a| and gravity, the worst over the states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import Any, ClassVar, Final

import numpy as np
from scipy.linalg.lapack import dsysv

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled_lcaba, constrained_aba
from condyn_pin._core.timing import Call, Times, interleaved, machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.constraints.rows.groups import PinocchioRows
from condyn_pin.dynamics.at_state import raw_constraints
from condyn_pin.dynamics.compiled import CompiledMethod
from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from condyn_pin.dynamics.scene import Scene, standard_scenes
from condyn_pin.dynamics.solvers.constrained_aba import ConstrainedABA
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.pv import PV
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace, unsupported_constraints
from condyn_pin.errors import Interrupted
from condyn_pin.io.load import load_robot
from condyn_pin.study.case import Case, measure_errors, prepare
from condyn_pin.study.measures.answers import AccelerationMeasure
from condyn_pin.study.measures.measure import relative
from condyn_pin.study.states import SampledStates
from condyn_pin.study.tables import Columns, Measurements, Record, number

BY_HAND = "by hand"  # in place of a status

ROBOTS = ("talos", "cassie", "solo12", "four_bar")

Progress = Callable[[str, int, int], None]

# What a sample need not last longer than beside batches, which answer all states in a call [s].
_ENOUGH = 1e-3


def silent(what: str, done: int, total: int) -> None:
    """Progress callback that prints nothing."""


@dataclass(frozen=True)
class Effort:
    """Number of closed states of each scene, and `rounds`, `repeats` of `interleaved`."""

    states: int = 20
    rounds: int = 400
    repeats: int = 30


FULL = Effort()
QUICK = Effort(states=3, rounds=30, repeats=5)


def bench(
    robots: Sequence[str] = ROBOTS,
    *,
    solvers: Sequence[Solver] = (),
    effort: Effort = FULL,
    native: bool = False,
    progress: Progress = silent,
) -> BenchTable:
    """Time some methods on the standard scenes of some robots."""
    # On each scene those solvers are timed that take it, by default LCABA, proximal and dense KKT,
    # and the equations written by hand (below). With `native` these come beside `ConstrainedABA`,
    # `PV` and what is compiled, timed in C++ in the same rounds; MissingExtra where it is not
    # installed. Progress is called with (scene, round, rounds). Ctrl-C raises `Interrupted` with
    # the scenes that were measured before.
    check_called("progress", progress, "scene, round, rounds")
    rows: list[BenchRow] = []
    where = machine()
    if native:
        core, lcaba = constrained_aba(), compiled_lcaba()
        headers = f"Pinocchio {core.pinocchio}, {lcaba.pinocchio} for LCABA"
        where["C++ compiler"] = core.compiler
        where["C++ headers"] = f"{headers}, Eigen {core.eigen} with {core.simd}"
    try:
        for name in robots:
            for label, scene in standard_scenes(load_robot(name)).items():
                rows += bench_scene(
                    label, scene, solvers=solvers, effort=effort, native=native, progress=progress
                )
    except KeyboardInterrupt as stop:
        raise Interrupted(BenchTable(tuple(rows), where)) from stop
    return BenchTable(tuple(rows), where)


@dataclass(frozen=True)
class _Candidate:
    """A row without times, and the calls to time by name: "once", "solve", "bare", or `CPP`."""

    row: BenchRow
    calls: Mapping[str, Call]
    is_dense: bool


def bench_scene(
    label: str,
    scene: Scene,
    *,
    solvers: Sequence[Solver] = (),
    effort: Effort,
    native: bool = False,
    progress: Progress = silent,
) -> list[BenchRow]:
    """Time some methods on one scene."""
    case = prepare(label, scene, AccelerationMeasure(), SampledStates(effort.states), SOLVED)
    asked = solvers or [*_solvers(scene), *([ConstrainedABA(), PV()] if native else [])]
    chosen = [s for s in asked if not unsupported_constraints(scene, s)]
    damping = _damping(scene)
    compiled: list[_Candidate] = []
    if native:
        of_all = [_compiled(case, name, method) for name, method in _methods(case, damping)]
        compiled = [each for each in of_all if not each.row.rows or isfinite(each.row.error)]
    written = {_named(name, damping): call for name, call in by_hand(scene, damping).items()}
    model, data = pin.Model(scene.robot.model), scene.robot.model.createData()
    free = BenchRow(scene=label, method="ABA, unconstrained", rows=0, rank=0)
    candidates = [
        _Candidate(free, {"bare": lambda q, v, tau: pin.aba(model, data, q, v, tau)}, False),
        *(_solver(case, solver) for solver in chosen),
        *(_equations(case, method, call) for method, call in written.items()),
        *compiled,
    ]
    calls: dict[tuple[int, str], Call] = {
        (i, what): call for i, c in enumerate(candidates) for what, call in c.calls.items()
    }
    done = iter(range(1, effort.rounds + 1))
    times = interleaved(
        calls,
        case.states,
        rounds=effort.rounds,
        repeats=effort.repeats,
        enough=_ENOUGH if native else inf,
        tick=lambda: progress(label, next(done), effort.rounds),
    )
    fastest: dict[str, Times] = {}  # of the dense ones, in Python and in C++
    for (i, what), spent in times.items():
        if candidates[i].is_dense and what in ("once", CPP):
            fastest[what] = min(fastest.get(what, spent), spent, key=lambda each: each.median)
    return [
        _timed_row(c.row, {what: times[i, what] for what in c.calls}, fastest, len(case.states))
        for i, c in enumerate(candidates)
    ]


def _solver(case: Case, solver: Solver) -> _Candidate:
    """Return a solver with its answers at the states."""
    found = measure_errors(case, solver)
    is_dense = isinstance(solver, DenseKKT)
    row = BenchRow(
        scene=case.label,
        method=_named(solver.title, solver.mu if isinstance(solver, DenseKKT) else 0.0),
        rows=case.scene.rows,
        rank=case.scene.nominal.rank,
        error=found.error_worst,
        dynamics_error=found.dynamics_error,
        constraint_error=found.constraint_error,
        iterations=found.iterations,
        status=found.said,
    )
    has_answers = isfinite(found.error_worst)
    calls = case.measure.calls(Workspace(case.scene, solver)) if has_answers else {}
    return _Candidate(row, calls, is_dense)


def _equations(case: Case, method: str, call: Call) -> _Candidate:
    """Row of equations written by hand, with their error but no solver status, and their call."""
    gravity = case.scene.nominal.estimator.gravity
    try:
        pairs = zip(case.states, case.truth, strict=True)
        error = max(relative(np.asarray(call(*s)), truth, gravity) for s, truth in pairs)
    except np.linalg.LinAlgError:  # singular
        error = inf
    rows, rank = case.scene.rows, case.scene.nominal.rank
    row = BenchRow(case.label, method, rows, rank, error=error, status=BY_HAND)
    return _Candidate(row, {"once": call} if isfinite(error) else {}, True)


def _timed_row(
    row: BenchRow, times: Mapping[str, Times], fastest: Mapping[str, Times], states: int
) -> BenchRow:
    """Row with its times, beside those of the fastest dense ones; a call of `CPP` is all states."""
    hot, full, bare = (times.get(what) for what in ("once", "solve", "bare"))
    if in_cpp := times.get(CPP):
        each = Times(tuple(spent / states for spent in in_cpp.samples))
        x = fastest[CPP].ratio(in_cpp) if CPP in fastest and row.rows else nan
        row = replace(row, bare_us=each.median, bare_p95_us=each.p95, to_dense=x)
    if hot:
        to_dense = fastest["once"].ratio(hot) if "once" in fastest else nan
        p95 = hot.p95
        row = replace(row, acceleration_us=hot.median, acceleration_p95_us=p95, to_dense=to_dense)
    if full:
        row = replace(row, solve_us=full.median)
    if bare:
        row = replace(row, bare_us=bare.median, bare_p95_us=bare.p95)
    if hot and full and bare:
        row = replace(row, to_bare=hot.ratio(bare), solve_to_bare=full.ratio(bare))
    return row


def _solvers(scene: Scene) -> list[Solver]:
    kinds: tuple[type[Solver], ...] = (LCABA, Proximal, DenseKKT)
    solvers = [kind() for kind in kinds if not kind.missing()]
    if damping := _damping(scene):
        solvers.append(DenseKKT(mu=damping))
    return solvers


def _damping(scene: Scene) -> float:
    """Damping mu of the dense KKT matrix if rows are redundant, else zero [1/kg]."""
    return float(f"{1e-11 * scene.nominal.delassus_norm:.1e}") if scene.nominal.dependent else 0.0


def _named(method: str, mu: float) -> str:
    return f"{method}, mu {mu:.1e}" if mu else method


# What `bench` times in C++: batches of the same states, without Python in between.
#
# Each method gets the settings that its solver in Python has on the scene, and is compiled by one
# compiler with the same flags: from headers of Pinocchio 3.9, or of 4.1 where only that has it.


CPP: Final = "C++"  # the origin of such rows

# Names of rows: those of solvers in Python, where there is one of the same equations.
_OF_SOLVERS: Final[Mapping[str, type[Solver]]] = {
    "ConstrainedABA": ConstrainedABA,
    "pinocchio::constrainedABA": ConstrainedABA,
    "PV": PV,
    "pinocchio::lcaba": LCABA,
    "pinocchio::constraintDynamics": Proximal,
}
_TITLES: Final = {
    "ConstrainedABA": ConstrainedABA.title,
    "PV": PV.title,
    "pinocchio::lcaba": LCABA.title,
    "pinocchio::constraintDynamics": Proximal.title,
    "pinocchio::constrainedABA": "constrainedABA, Pinocchio's driver",
    "pinocchio::aba": "ABA, unconstrained",
}
FREE: Final = "pinocchio::aba"


def _methods(case: Case, damping: float) -> Iterator[tuple[str, CompiledMethod]]:
    scene, settings = case.scene, {}
    for name, kind in _OF_SOLVERS.items():
        if not kind.missing() and not unsupported_constraints(scene, kind()):
            settings[name] = _settings(Workspace(scene, kind()))
    workspace = Workspace(scene)
    constraints = workspace.pinocchio_constraints.constraints
    if workspace.pinocchio_constraints.unsupported:
        return
    plain = {"mu": damping, "accuracy": 0.0, "limit": 1}
    for module in (constrained_aba(), compiled_lcaba()):
        for name in module.methods:
            solver_is_in_other = module is compiled_lcaba() and name != "pinocchio::lcaba"
            if solver_is_in_other or (name in _OF_SOLVERS and name not in settings):
                continue
            chosen: dict[str, Any] = settings.get(name, plain)
            model = workspace.model
            yield name, CompiledMethod(name, model, constraints, None, **chosen, module=module)


def _settings(workspace: Workspace) -> dict[str, Any]:
    """Proximal settings of a solver: mu, stopping accuracy, and iteration limit."""
    found = workspace.proximal_settings
    relative_one = isinstance(workspace.solver, Proximal)
    accuracy = found.relative_accuracy if relative_one else found.absolute_accuracy
    return {"mu": found.mu, "accuracy": accuracy, "limit": found.max_iter}


def _compiled(case: Case, name: str, method: CompiledMethod) -> _Candidate:
    """Compiled method with its worst relative error of a over the states."""
    states = [np.ascontiguousarray(x) for x in map(np.array, zip(*case.states, strict=True))]
    answers, scene = method.many(*states), case.scene
    gravity, error = scene.nominal.estimator.gravity, nan
    if name != FREE:
        pairs = zip(answers, case.truth, strict=True)
        error = max(relative(a, truth, gravity) for a, truth in pairs)
    row = BenchRow(
        case.label,
        _TITLES.get(name, name),
        rows=0 if name == FREE else scene.rows,
        rank=0 if name == FREE else scene.nominal.rank,
        error=error,
        origin=CPP,
    )
    return _Candidate(row, {CPP: lambda *_: method.many(*states)}, name.startswith("Dense"))


# BenchTable: the rows of a benchmark, with the machine that they were measured on.


@dataclass(frozen=True)
class BenchRow(Record):
    """One method on one scene; NaN where something was not measured."""

    scene: str
    method: str
    rows: int  # of constraints
    rank: int  # how many of them are independent
    bare_us: float = nan  # Pinocchio's own call with the same settings, unguarded [us]
    bare_p95_us: float = nan
    acceleration_us: float = nan  # `Workspace.acceleration` [us]
    acceleration_p95_us: float = nan
    solve_us: float = nan  # `Workspace.solve`, with its three errors [us]
    to_bare: float = nan  # `acceleration` over the bare call, median of ratios within one round
    solve_to_bare: float = nan
    # The time of the fastest dense method over this method's: how many times faster it is. Dense
    # are `DenseKKT` and the equations by hand, solved by numpy, by LAPACK's sysv and by Pinocchio's
    # contact Cholesky; in C++ the whole matrix by Eigen's LDLT and its blocks by LLT.
    to_dense: float = nan
    error: float = nan  # worst of a against Reference, relative to the larger of |a| and gravity
    dynamics_error: float = nan  # worst residual [N, N m]
    constraint_error: float = nan  # [m/s^2, rad/s^2]
    iterations: int = 0
    status: str = ""  # how many states ended with which; "by hand" where nothing says one
    origin: str = "python"  # or "C++", for what is compiled: then `bare_us` is its time


@dataclass(frozen=True)
class BenchTable(Measurements[BenchRow]):
    """Rows of a benchmark, scene by scene, and the machine they were measured on."""

    kind: ClassVar[type[BenchRow]] = BenchRow
    columns: ClassVar[Columns[BenchRow]] = (
        ("method", lambda r: r.method if r.origin == "python" else f"{r.method} ({r.origin})"),
        ("bare", lambda r: number(r.bare_us, ".1f")),
        ("a", lambda r: number(r.acceleration_us, ".1f")),
        ("p95", lambda r: number(r.acceleration_p95_us, ".1f")),
        ("solve", lambda r: number(r.solve_us, ".1f")),
        ("a / bare", lambda r: number(r.to_bare, ".2f")),
        ("solve / bare", lambda r: number(r.solve_to_bare, ".2f")),
        ("x dense", lambda r: number(r.to_dense, ".2f")),
        ("error of a", lambda r: number(r.error if isfinite(r.error) else nan, ".0e")),
        ("it.", lambda r: str(r.iterations or "")),
        ("status", lambda r: r.status),
    )

    def of_origin(self, origin: str) -> BenchTable:
        """Return the rows of Python, or of C++."""
        return BenchTable(tuple(r for r in self.rows if r.origin == origin), self.machine)

    def by_scene(self) -> dict[str, BenchTable]:
        """Return the table of each scene, by its title: label, rows and rank."""
        found = {}
        for scene in dict.fromkeys(row.scene for row in self.rows):
            rows = tuple(row for row in self.rows if row.scene == scene)
            sizes = next((f": {row.rows} rows, rank {row.rank}" for row in rows if row.rows), "")
            found[scene + sizes] = BenchTable(rows, self.machine)
        return found


# The equations of a scene as one writes them by hand: what `bench` compares every method with.
#
#     [ M   J^T  ] [   a  ]   [ tau - h ]
#     [ J  -mu I ] [ -lam ] = [ -gamma  ]
#
# Each is one function of q, v and tau that calls Pinocchio and then one solver of somebody else. No
# argument is looked at, nothing is scaled, no condition estimated and no error computed.


Answer = Callable[[Array, Array, Array], Array]


def by_hand(scene: Scene, mu: float = 0.0) -> dict[str, Answer]:
    """Return hand-written solutions for a (nv,) by method name, each called with (q, v, tau)."""
    # Damping mu [1/kg] is needed where rows are redundant. Constraints that Pinocchio lacks, and
    # welds of two bodies, have no such solution: writing these by hand means writing a library.
    rows = PinocchioRows(scene.robot.model, scene.robot.model.createData(), scene.bounds)
    if not (scene.rows and rows.have_gamma):
        return {}
    return {name: method(scene, mu) for name, method in METHODS.items()}


def _by_numpy(scene: Scene, mu: float) -> Answer:
    n, assemble = scene.robot.nv, _assembly(scene, mu)

    def answer(q: Array, v: Array, tau: Array) -> Array:
        K, y = assemble(q, v, tau)
        return np.linalg.solve(K, y)[:n]  # type: ignore[return-value]

    return answer


def _by_lapack(scene: Scene, mu: float) -> Answer:
    n, assemble = scene.robot.nv, _assembly(scene, mu)

    def answer(q: Array, v: Array, tau: Array) -> Array:
        K, y = assemble(q, v, tau)
        # K^T is in the order of Fortran
        return dsysv(K.T, y, lower=1, overwrite_a=1, overwrite_b=1)[2][:n]  # type: ignore[no-any-return]

    return answer


def _assembly(scene: Scene, mu: float) -> Callable[[Array, Array, Array], tuple[Array, Array]]:
    """Function of (q, v, tau) that assembles the KKT matrix K and its right side."""
    model = pin.Model(scene.robot.model)
    data, n, still = model.createData(), model.nv, np.zeros(model.nv)
    rows, size = PinocchioRows(model, data, scene.bounds), model.nv + scene.rows
    damping = -mu * np.eye(scene.rows)

    def assemble(q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
        K, y = np.zeros((size, size)), np.zeros(size)
        K[:n, :n] = pin.crba(model, data, q)
        y[:n] = tau - pin.nonLinearEffects(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, still)
        pin.computeJointJacobians(model, data)
        rows.gamma(y[n:])
        y[n:] *= -1.0
        J = rows.jacobian()
        K[n:, :n], K[:n, n:] = J, J.T
        if mu:
            K[n:, n:] = damping
        return K, y

    return assemble


def _by_contact_cholesky(scene: Scene, mu: float) -> Answer:
    """Solution by Pinocchio's sparse Cholesky factor of the same matrix, constraint rows first."""
    model = pin.Model(scene.robot.model)
    data, m, still = model.createData(), scene.rows, np.zeros(model.nv)
    models, datas = raw_constraints(model, pinocchio_constraints_of(scene).constraints, None)
    _pin.init_constraint_dynamics(model, data, models, datas)
    rows, y = PinocchioRows(model, data, scene.bounds), np.zeros(m + model.nv)

    def answer(q: Array, v: Array, tau: Array) -> Array:
        y[m:] = tau - pin.nonLinearEffects(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, still)
        rows.gamma(y[:m])
        y[:m] *= -1.0
        factor = _pin.factorise_constraints(model, data, models, datas, q, mu)
        return factor.solve(y)[m:].ravel()  # type: ignore[no-any-return]

    return answer


METHODS: Final = {
    "numpy.linalg.solve": _by_numpy,
    "LAPACK sysv": _by_lapack,
    "Contact Cholesky": _by_contact_cholesky,
}
