"""Solvers against others: all against `Reference`, mu by itself and by hand, and SciPy's on chains.

    python benchmarks/solvers.py equivalence [--states 1000] [--solvers all] [robot ...]
    python benchmarks/solvers.py auto_mu [--seeds 3] [--families mass_ratio,parallelogram]
    python benchmarks/solvers.py conjugate_gradient [--joints 10 30 100]

equivalence: every solver against `Reference` at random closed states of every robot's scenes. Rows
of solvers that are not named stay. Exits with 1 if an answer that says ok is off by more than it
promises.

auto_mu: every case of `EXTREMES`, the robots' among them, is answered by `Proximal` with mu =
"auto" and with 1e-12 to 1, in 1/kg and as a share of the largest eigenvalue of G, and with up to 20
iterations, 100, and two refinements. The right answer is that of the stress test: in closed form,
or by `Reference`; where rows contradict each other, it is the a that comes nearest to all of them.
The error of a mu is that of the worst of three states. A mu is tuned for a machine and a posture,
not for one torque: where only rounding of G is left, eps cond(G), every mu over four decades has
the same error on average, and the best of 26 at one state is the luckiest. An error counts as no
worse if it is within 3 times the best, or below 1e-10, a hundredth of what ok promises. Time is
compared with that of the mu of fewest iterations whose error is no worse than that of "auto" in
this sense; both are measured in turn, at each of the states, and added up.

conjugate_gradient: `ConjugateGradient`, SciPy's cg and MINRES apply M^-1, J and J^T by the same
sweeps over the tree, and no matrix is formed at a state. cg solves G lam = b with G = J M^-1 J^T;
MINRES solves both equations at once,

    [ M  J^T ] [  a  ]   [ tau - h ]
    [ J   0  ] [ -lam ] = [ -gamma  ].

Preconditioned is G by its inverse at the nominal state, and M by the articulated body algorithm.
Each iterates until |J a + gamma| is what `ConjugateGradient` asks for, or the residual of both is a
billionth of the right side.
"""

from __future__ import annotations

import csv
import os
import sys
import warnings
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from scipy.sparse.linalg import LinearOperator, cg, minres
from script import Printed, Table

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import interleaved, machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.cli.words import solvers_of
from condyn_pin.dynamics.recursion import inverse_delassus
from condyn_pin.dynamics.scene import motor_torque, standard_scenes
from condyn_pin.dynamics.workspace import unsupported_constraints
from lab.extremes.base import EXTREMES, Case
from lab.extremes.stress import Memory, make, tasks
from lab.extremes.verdicts import Task, error_of, right_answers

AGREEMENTS = script.result("solvers equivalence", ".csv")

# --- equivalence


@dataclass(frozen=True)
class Agreement:
    """One solver on one scene.

    Attributes
    ----------
    scene, solver : str
    rows, rank, states : int
    ok, inaccurate, singular, not_finite : int
        How many states ended with which status.
    error : float
        Worst error of a among those that say ok, relative to the larger of |a| and gravity.
    force_error : float
        The same of J^T lam, relative to the larger of it and the weight.
    iterations : int
        The most.
    """

    scene: str
    solver: str
    rows: int
    rank: int
    states: int
    ok: int
    inaccurate: int
    singular: int
    not_finite: int
    error: float
    force_error: float
    iterations: int

    @property
    def is_honest(self) -> bool:
        """Whether every answer that says ok is within what ok promises."""
        return not self.ok or self.error < SOLVED


def agreements(label: str, scene: cp.Scene, count: int, solvers: str = "all") -> list[Agreement]:
    """Compare solvers that take the scene with Reference, on the same random states."""
    contenders = list(_contenders(scene, solvers))
    if not contenders:
        return []
    rng = np.random.default_rng(0)
    states = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]
    reference = cp.Workspace(scene, cp.dynamics.Reference())
    truth = [reference.solve(*state) for state in states]
    forces = [reference.jacobian(state[0]).T for state in states]
    return [
        _agreement(label, name, cp.Workspace(scene, solver), states, truth, forces)
        for name, solver in contenders
    ]


def _contenders(scene: cp.Scene, solvers: str) -> Iterator[tuple[str, cp.dynamics.Solver]]:
    """Yield every named solver that takes the scene, and damped those that need it."""
    mu = float(f"{1e-11 * scene.nominal.delassus_norm:.1e}")
    for solver in solvers_of(solvers):
        if not unsupported_constraints(scene, solver):
            name = type(solver).__name__
            yield name, solver
            if scene.nominal.redundant and not solver.takes_redundant:
                yield f"{name}(mu={mu})", type(solver)(mu=mu)


def _agreement(
    label: str,
    name: str,
    workspace: cp.Workspace,
    states: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]],
    truth: Sequence[cp.dynamics.Solution],
    transposed: Sequence[np.ndarray],
) -> Agreement:
    scene = workspace.scene
    found = [workspace.solve(*state, throw=False) for state in states]
    error = force_error = 0.0
    for one, right, JT in zip(found, truth, transposed, strict=True):
        if one.status.ok:
            error = max(error, _relative(one.a, right.a, scene.nominal.estimator.gravity))
            force = _relative(JT @ one.lam, JT @ right.lam, scene.nominal.weight)
            force_error = max(force_error, force)
    count = {status: sum(one.status is status for one in found) for status in cp.Status}
    return Agreement(
        label,
        name,
        scene.rows,
        scene.nominal.rank,
        len(states),
        **{status.name.lower(): number for status, number in count.items()},
        error=error,
        force_error=force_error,
        iterations=max(one.iterations for one in found),
    )


def _relative(x: np.ndarray, right: np.ndarray, floor: float) -> float:
    return float(np.abs(x - right).max() / max(np.abs(right).max(), floor))


def _others(path: Path, solvers: str) -> tuple[list[dict[str, str]], dict[str, str]]:
    """Return the rows of a table that are of none of these solvers, and what its head is to say."""
    if solvers == "all":
        return [], {}
    named = {type(solver).__name__ for solver in solvers_of(solvers)}
    lines = path.read_text().splitlines()
    head = dict(line[2:].split(": ", 1) for line in lines if line.startswith("#"))
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    kept = [row for row in rows if row["solver"].partition("(")[0] not in named]
    others = f"of {head['date']}, condyn_pin {head['condyn_pin']}"
    return kept, {"rows but of " + ", ".join(sorted(named)): others}


def equivalence(given: Namespace) -> int:
    """Compare and write; 1 if an answer that says ok is off."""
    table: list[Agreement] = []
    for name in given.robots:
        for label, scene in standard_scenes(cp.load_robot(name)).items():
            table += agreements(label, scene, given.states, given.solvers)
            print(label, flush=True)
    others, said = _others(given.csv, given.solvers)
    rows = [*others, *map(asdict, table)]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    rows.sort(key=lambda row: scenes.index(row["scene"]))
    script.write(given.csv, rows, machine() | said)
    lies = [row for row in table if not row.is_honest]
    for row in lies:
        print(f"{row.scene}, {row.solver}: off by {row.error:.1e} where it says ok")
    return int(bool(lies))


# --- auto_mu

WEIGHTS = tuple(float(f"1e{k}") for k in range(-12, 1))
KNOBS: tuple[dict[str, int], ...] = ({}, {"max_iterations": 100}, {"refinements": 2})
WITHIN = 3.0
NOTHING = 1e-10  # an error below is as good as any

# What families of any scene are put on: without redundant rows but zeros, and with.
ROBOTS = ("four_bar", "cassie")

# Families that turn the parameters themselves, and those with numbers that no answer belongs to.
LEFT_OUT = ("weight", "few_iterations", "bad_q", "bad_v", "bad_tau")


Asked = list[tuple[cp.Proximal, cp.dynamics.Solution]]


@dataclass(frozen=True)
class Comparison:
    """One case with one set of other parameters.

    Attributes
    ----------
    task : Task
    parameters : dict
    independent : bool
        Whether no row depends on others.
    error, best : float
        Of a, relative, at the worst state: with "auto", and with the best mu.
    best_mu : float
        [1/kg], at the first state.
    status : str
        Of the answer with "auto" there.
    slower : float
        Time with "auto" over that of the fastest mu that is as good, of all states together; NaN
        where none is.
    """

    task: Task
    parameters: dict[str, int]
    independent: bool
    error: float
    best: float
    best_mu: float
    status: str
    slower: float

    @property
    def error_is_good(self) -> bool:
        """Whether no mu is better by more than is allowed."""
        return self.error <= WITHIN * max(self.best, NOTHING)

    @property
    def time_is_good(self) -> bool:
        """Whether no mu that is as good is faster by more than is allowed."""
        return not self.slower > WITHIN


def compare(
    task: Task, cases: Sequence[Case], parameters: dict[str, int], *, timed: bool
) -> Comparison | None:
    """Return "auto" against every mu on some cases; None where no method has an answer."""
    found = [(case, right) for case in cases if (right := right_answers(case)) and case.scene.rows]
    if not found:
        return None

    def ask(mu: float | None, share: bool = False) -> tuple[float, Asked]:
        """Return the worst error, and the solver and the answer of each case."""
        errors, asked = [], []
        for case, right in found:
            largest = case.scene.nominal.delassus_norm
            solver = cp.Proximal(mu=mu and mu * (largest if share else 1.0), **parameters)  # type: ignore[arg-type]
            workspace = cp.Workspace(case.scene, solver, drift=case.drift)
            solution = workspace.solve(case.q, case.v, case.tau, throw=False)
            errors.append(min(error_of(case, solution.a, a) for a in right))
            asked.append((solver, solution))
        return max(errors), asked

    error, auto = ask(None)
    by_hand = [ask(mu, share) for share in (False, True) for mu in WEIGHTS]
    best, tuned = min(by_hand, key=lambda one: one[0])
    as_good = [asked for other, asked in by_hand if other <= max(error, NOTHING)]
    slower = float("nan")
    if timed and as_good and np.isfinite(error):
        fewest = min(as_good, key=lambda asked: sum(each.iterations for _, each in asked))
        slower = times_slower([case for case, _ in found], auto, fewest)
    (_, solution), best_mu = auto[0], tuned[0][0].mu
    return Comparison(
        task, parameters, found[0][0].scene.nominal.independent, error, best, best_mu,  # type: ignore[arg-type]
        solution.status.name.lower(), slower,
    )  # fmt: skip


def times_slower(cases: Sequence[Case], auto: Asked, by_hand: Asked) -> float:
    """Return the time of one over that of the other, of all cases together."""
    took = {"auto": 0.0, "by hand": 0.0}
    for case, (one, _), (other, _) in zip(cases, auto, by_hand, strict=True):
        solvers = {"auto": one, "by hand": other}
        calls = {
            name: cp.Workspace(case.scene, solver, drift=case.drift).acceleration
            for name, solver in solvers.items()
        }
        times = interleaved(calls, [(case.q, case.v, case.tau)], rounds=20, repeats=3)
        took = {name: took[name] + times[name].median for name in took}
    return took["auto"] / took["by hand"]


def comparisons(
    todo: Sequence[Task], *, seeds: int = 1, timed: bool = True
) -> Iterator[Comparison]:
    """Yield all comparisons of some cases; those that are refused are left out."""
    memory = Memory()
    for task in todo:
        if task.family in LEFT_OUT:
            continue
        made = [make(replace(task, seed=task.seed + k), memory)[0] for k in range(seeds)]
        for parameters in KNOBS:
            try:
                found = compare(task, [case for case in made if case], parameters, timed=timed)
            except cp.CondynError:
                continue
            if found:
                yield found


def auto_mu(given: Namespace) -> script.Saved:
    """Compare family by family."""
    warnings.simplefilter("ignore")
    about, found = script.measured_on(), []
    for family in [name for name in given.families.split(",") if name] or list(EXTREMES):
        found += comparisons(tasks([family], robots=ROBOTS), seeds=given.seeds)
    return {**about, "comparisons": [_numbers(each) for each in found]}


def _numbers(each: Comparison) -> dict[str, Any]:
    """Return a comparison for JSON, which has no NaN and no infinity."""
    found = asdict(each)
    return {k: None if isinstance(x, float) and not np.isfinite(x) else x for k, x in found.items()}


def comparisons_of(saved: script.Saved) -> list[Comparison]:
    """Return the comparisons."""
    return [
        Comparison(
            **{k: float("nan") if x is None else x for k, x in each.items()}
            | {"task": Task(**each["task"])}
        )
        for each in saved["comparisons"]
    ]


def weights_text(saved: script.Saved) -> str:
    """Return a line a family, and a line for each case that is worse."""
    found = comparisons_of(saved)
    lines = [
        f'{len(found)} comparisons of "auto" with {2 * len(WEIGHTS)} values of mu; '
        f"within {WITHIN:g} times: {sum(c.error_is_good for c in found)} in error, "
        f"{sum(c.time_is_good for c in found)} in time.",
        "",
        "| family | cases | error within 3 x | time within 3 x | slowest |",
        "|---|---|---|---|---|",
    ]
    for family in dict.fromkeys(c.task.family for c in found):
        own = [c for c in found if c.task.family == family]
        slowest = max((c.slower for c in own if c.slower > 0), default=float("nan"))
        lines.append(
            f"| {family} | {len(own)} | {sum(c.error_is_good for c in own)} "
            f"| {sum(c.time_is_good for c in own)} | {slowest:.1f} |"
        )
    lines += ["", "Where it is worse:", ""]
    lines += [
        f"- {c.task.family} {c.task.robot} {c.task.severity:g}, {c.parameters or 'defaults'}: "
        f"{c.error:.1e} ({c.status}) against {c.best:.1e} with {c.best_mu:.1e}; "
        f"time x {c.slower:.1f}"
        for c in found
        if not (c.error_is_good and c.time_is_good)
    ]
    text = "{processor}, {system}, Python {python}, Pinocchio {pinocchio}, {date}."
    return "\n".join([*lines, "", text.format(**saved["machine"])])


def weights_sentence(saved: script.Saved) -> str:
    """Return the sentence of the page on solvers."""
    found = comparisons_of(saved)
    families = len({c.task.family for c in found})
    errors, times = sum(c.error_is_good for c in found), sum(c.time_is_good for c in found)
    source = script.source("solvers auto_mu", saved["machine"], script.SHORT)
    return (
        "`Proximal` chooses its mu itself. Compared with the best of "
        f"{2 * len(WEIGHTS)} values set by hand, on {families} families of hard cases,\n"
        f"its error is at most {WITHIN:g} times as large in {errors} of {len(found)} comparisons "
        f"(errors below {NOTHING:g} count as equal), its time at most {WITHIN:g} times\n"
        f"as long in {times} ({source})."
    )


# --- conjugate_gradient

JOINTS = (10, 30, 100, 400)
MOST_IN_CELLS = 100  # joints: MINRES alone would take minutes with more
MOST = 5  # iterations of SciPy's methods, times unknowns

State = tuple[Array, Array, Array]
Solve = Callable[[Array, Array, Array], tuple[Array, int]]


@dataclass(frozen=True)
class Row:
    """One method on one scene.

    Attributes
    ----------
    scene : str
    joints, rows, rank : int
    method : str
    iterations : int
    us : float
        Least time of 15 samples [us].
    to_ours : float
        Over that of `ConjugateGradient`.
    error : float
        Of a, against `Reference`, relative to the larger of |a| and gravity.
    """

    scene: str
    joints: int
    rows: int
    rank: int
    method: str
    iterations: int
    us: float
    to_ours: float
    error: float


class Sweeps:
    """The operators of a scene by sweeps over the tree."""

    def __init__(self, scene: cp.Scene) -> None:
        self.scene, self.model = scene, scene.robot.model
        self.data, self.still = self.model.createData(), np.zeros(self.model.nv)
        self.equations = cp.Workspace(scene, cp.dynamics.NullSpace()).equations
        self.weightless = pin.Model(self.model)
        self.weightless.gravity = pin.Motion.Zero()
        self.P = inverse_delassus(scene.nominal)
        self.enough = scene.nominal.estimator.tolerated_constraint_error / 10

    def free(self, q: Array, v: Array, tau: Array, lam: Array) -> Array:
        """Return M^-1 (tau + J^T lam - h)."""
        forces, wrenches = tau + self.equations.torque(lam), self.equations.wrenches(lam)
        return np.array(pin.aba(self.model, self.data, q, v, forces, wrenches))

    def delassus(self, q: Array) -> Callable[[Array], Array]:
        """Return x to J M^-1 J^T x."""

        def product(x: Array) -> Array:
            torque, wrenches = self.equations.torque(x), self.equations.wrenches(x)
            a = pin.aba(self.weightless, self.data, q, self.still, torque, wrenches)
            return self.equations.jacobian_product(q, a)

        return product

    def kkt(self, q: Array) -> Callable[[Array], Array]:
        """Return (a, -lam) to (M a - J^T lam, J a)."""
        n = self.model.nv

        def product(x: Array) -> Array:
            a, lam = x[:n], -x[n:]
            slips = self.equations.jacobian_product(q, a)
            wrenches = self.equations.wrenches(lam)
            forces = pin.rnea(self.weightless, self.data, q, self.still, a, wrenches)
            return np.concatenate([forces - self.equations.torque(lam), slips])

        return product


def by_cg(sweeps: Sweeps, *, preconditioned: bool) -> Solve:
    """Return SciPy's cg for lam."""
    m = sweeps.scene.rows

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, int]:
        count = [0]
        target = sweeps.equations.target(q, v)
        b = target - sweeps.equations.jacobian_product(q, sweeps.free(q, v, tau, np.zeros(m)))
        lam, _ = cg(
            LinearOperator((m, m), sweeps.delassus(q), dtype=np.float64),
            b,
            rtol=0.0,
            atol=sweeps.enough,
            maxiter=MOST * m,
            M=sweeps.P if preconditioned else None,
            callback=lambda _: count.__setitem__(0, count[0] + 1),
        )
        return sweeps.free(q, v, tau, lam), count[0]

    return solve


def by_minres(sweeps: Sweeps, *, preconditioned: bool) -> Solve:
    """Return SciPy's MINRES for a and lam at once."""
    n, m = sweeps.model.nv, sweeps.scene.rows

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, int]:
        count = [0]
        h = pin.nonLinearEffects(sweeps.model, sweeps.data, q, v)
        y = np.concatenate([tau - h, sweeps.equations.target(q, v)])

        def precondition(r: Array) -> Array:
            a = pin.aba(sweeps.weightless, sweeps.data, q, sweeps.still, np.array(r[:n]))
            return np.concatenate([a, sweeps.P @ r[n:]])

        x, _ = minres(
            LinearOperator((n + m, n + m), sweeps.kkt(q), dtype=np.float64),
            y,
            rtol=1e-9,
            maxiter=MOST * (n + m),
            M=LinearOperator((n + m, n + m), precondition, dtype=np.float64)
            if preconditioned
            else None,
            callback=lambda _: count.__setitem__(0, count[0] + 1),
        )
        return x[:n], count[0]

    return solve


def ours(scene: cp.Scene, solver: cp.dynamics.Solver) -> Solve:
    """Return a solver of this library."""
    workspace = cp.Workspace(scene, solver)

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, int]:
        return workspace.acceleration(q, v, tau), 0

    return solve


def scenes(joints: int) -> Iterator[tuple[str, cp.Scene]]:
    """Yield a chain whose tip is held, and cells side by side, of about so many joints."""
    chain = cp.model.chain(joints)
    yield "chain, tip held", cp.Scene(chain, [cp.PointContact(chain.model.frames[-1].name)])
    if joints <= MOST_IN_CELLS:
        cells = cp.model.n_four_bar(max(1, joints // 2))
        yield "four-bars in a row", cp.Scene(cells, cells.loops)


def measure(label: str, scene: cp.Scene) -> Iterator[Row]:
    """Measure all methods on a scene, at one state."""
    q = scene.assemble(bent(scene)).q
    state = (q, np.zeros(scene.robot.nv), np.zeros(scene.robot.nv))
    truth = cp.Workspace(scene, cp.dynamics.Reference()).solve(*state, throw=False)
    sweeps = Sweeps(scene)
    methods: dict[str, Solve] = {
        "ConjugateGradient": ours(scene, cp.dynamics.ConjugateGradient()),
        "NullSpace, dense": ours(scene, cp.dynamics.NullSpace()),
        "scipy cg": by_cg(sweeps, preconditioned=False),
        "scipy cg, preconditioned": by_cg(sweeps, preconditioned=True),
        "scipy MINRES": by_minres(sweeps, preconditioned=False),
        "scipy MINRES, preconditioned": by_minres(sweeps, preconditioned=True),
    }
    found = {name: solve(*state) for name, solve in methods.items()}
    times = interleaved(methods, [state], rounds=15, repeats=5, enough=0.003)
    # the least: other programs make times longer, never shorter
    least = {name: min(found.samples) for name, found in times.items()}
    iterations = (
        cp.Workspace(scene, cp.dynamics.ConjugateGradient()).solve(*state, throw=False).iterations
    )
    scale = max(np.abs(truth.a).max(), scene.nominal.estimator.gravity)
    for name, (a, count) in found.items():
        yield Row(
            label, scene.robot.nv, scene.rows, scene.nominal.rank, name,
            iterations if name == "ConjugateGradient" else count,
            least[name], least[name] / least["ConjugateGradient"],
            float(np.abs(a - truth.a).max() / scale),
        )  # fmt: skip


def bent(scene: cp.Scene) -> Array:
    """Return a configuration near the nominal one: a chain that hangs straight is singular."""
    q, v = scene.state()
    step = 0.02 * np.random.default_rng(0).normal(size=len(v))
    return np.array(pin.integrate(scene.robot.model, q, step))


def conjugate_gradient(given: Namespace) -> script.Saved:
    """Measure all methods on all scenes."""
    about, rows = script.measured_on(), []
    for joints in given.joints:
        for label, scene in scenes(joints):
            for row in measure(label, scene):
                print(row, flush=True)
                rows.append(asdict(row))
    return {**about, "rows": rows}


def chain_table(saved: script.Saved) -> str:
    """Return a row a method."""
    lines = [
        "| scene | joints | rows | method | iterations | time [us] | to ours | error of a |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in (Row(**each) for each in saved["rows"]):
        cells = (
            row.scene, row.joints, row.rows, row.method, row.iterations or "",
            f"{row.us:.0f}", f"{row.to_ours:.2f}", f"{row.error:.0e}",
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    said = (
        f"{script.source('solvers conjugate_gradient', saved['machine'])}. At rest, without "
        "torques; the least of 15 times; error against `Reference`, relative to the larger of "
        "abs(a) and gravity."
    )
    return "\n".join([*lines, "", said])


def _equivalence_options(parser: ArgumentParser) -> None:
    parser.add_argument("robots", nargs="*", default=list(cp.io.available_robots()))
    parser.add_argument("--states", type=int, default=1000)
    parser.add_argument("--solvers", default="all", help="names of `condyn solvers`, with commas")
    parser.add_argument("--csv", type=Path, default=AGREEMENTS)


def _auto_mu_options(parser: ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, default=3, help="states of a case")
    some = "some of EXTREMES, separated by commas; nothing is written"
    parser.add_argument("--families", default="", help=some)


def _chain_options(parser: ArgumentParser) -> None:
    parser.add_argument("--joints", nargs="*", type=int, default=JOINTS)


SUBJECTS = [
    Printed(
        "solvers equivalence", "every solver against Reference", equivalence, _equivalence_options
    ),
    Table(
        "solvers auto_mu",
        "Proximal's own mu against every mu by hand",
        auto_mu,
        weights_text,
        pages=lambda saved: {script.RESULTS_PAGE: {"auto_mu": weights_sentence(saved)}},
        beside=lambda saved: script.write(
            script.result("solvers auto_mu", ".md"), weights_text(saved)
        ),
        options=_auto_mu_options,
        draft=("families",),
    ),
    Table(
        "solvers conjugate_gradient",
        "beside SciPy's cg and MINRES on long chains",
        conjugate_gradient,
        chain_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"conjugate_gradient": chain_table(saved)}},
        options=_chain_options,
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
