"""Times of calls, printed: what comes before a solve, threads, loops closed, derivatives, steps.

    python benchmarks/timings.py startup | threads | assembly | derivatives | steps

startup: import, loading, scenes, workspaces, the first solve.

threads: what threads of the BLAS cost small matrices, with an idle neighbour and with a busy one.
The same calls with one thread, which is what the library takes by itself, and with one for each
core, which is what OMP_NUM_THREADS=<cores> asks for: in turns, each in a process of its own.

assembly: how far `Scene.assemble` reaches, and what it costs. From a closed posture, every joint
moved by a normally distributed 0.2 rad or m: how many of 100 such starts end closed on the branch
of the posture, and the processor time of one.

derivatives: on Talos, two feet, ours against Pinocchio's own and central differences. And on closed
chains and feet of points: a solve with its proof and derivatives, against Pinocchio's dynamics and
derivatives, with how far da_dq is from central differences. Pinocchio's have those of the forces in
them; ours form these when they are asked for.

steps: of a simulation, against one solve and against real time, and how well they go.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Callable
from functools import partial
from statistics import median
from time import perf_counter, process_time
from timeit import repeat

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from script import Printed

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA, pin
from condyn_pin._core.timing import interleaved, machine
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.scene import motor_torque, standard_scenes
from condyn_pin.mechanism import anchored
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import HybridPhase

# --- startup

# What a first solve touches, all imported; scipy's LAPACK comes with the first scene.
EVERYTHING = "import condyn_pin as cp; cp.load_robot; cp.Scene; cp.Workspace; cp.solve"


def import_time(code: str) -> float:
    """Return the median time of a statement in fresh interpreters, after pinocchio [s]."""
    timed = f"""
import pinocchio, time
start = time.perf_counter()
{code}
print(time.perf_counter() - start)
"""
    runs = [
        subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True)
        for _ in range(7)
    ]
    return statistics.median(float(run.stdout) for run in runs)


def median_time(call: Callable[[], object], repeats: int = 21) -> float:
    """Return the median time of a call [s]."""
    samples = []
    for _ in range(repeats):
        start = perf_counter()
        call()
        samples.append(perf_counter() - start)
    return statistics.median(samples)


def first_solve(scene: cp.Scene) -> tuple[float, float, float]:
    """Return the least times of Workspace(scene), of its first solve, and of a later one [s].

    The scene is new, its robot is not. The later solve is that of an older workspace, in turns; the
    least of them, since memory that is new gives other programs their turn.
    """
    still = np.zeros(scene.robot.nv)
    state, older = (cp.dynamics.described_posture(scene), still, still), cp.Workspace(scene)
    times = []
    for _ in range(21):
        new = cp.Scene(scene.robot, scene.constraints)
        start = perf_counter()
        workspace = cp.Workspace(new)
        built = perf_counter()
        workspace.solve(*state, throw=False)
        done = perf_counter()
        warm = median_time(partial(older.solve, *state, throw=False))
        times.append((built - start, done - built, warm))
    least = np.min(times, axis=0)
    return float(least[0]), float(least[1]), float(least[2])


def print_first_solves() -> None:
    """Print what a first solve costs, in solves; createData, twice in it, is Pinocchio's own."""
    print(
        f"{'first solve of a new scene':30}{'createData':>12}{'Workspace':>12}{'solve':>12}"
        f"{'warm':>12}{'first / warm':>14}"
    )
    for name in cp.io.available_robots():
        for label, scene in standard_scenes(cp.load_robot(name)).items():
            kept: list[object] = []  # memory that was used before is quicker to have
            made = median_time(lambda s=scene, k=kept: k.append(s.robot.model.createData()), 5)
            built, first, warm = first_solve(scene)
            milliseconds = (f"{1e3 * each:9.3f} ms" for each in (made, built, first, warm))
            print(f"  {label:28}{''.join(milliseconds)}{(built + first) / warm:14.0f}")


def startup(_: Namespace) -> None:
    """Print the table."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    print(f"import condyn_pin, after pinocchio   {1e3 * import_time('import condyn_pin'):8.1f} ms")
    print(f"  with all that a solve needs        {1e3 * import_time(EVERYTHING):8.1f} ms")
    for name in ("talos", "cassie"):
        load = median_time(lambda name=name: cp.load_robot(name), 7)
        print(f"load_robot({name!r}){'':16}{1e3 * load:8.1f} ms".replace("'", '"'))
        for label, scene in standard_scenes(cp.load_robot(name)).items():
            print(label)
            analysed = median_time(lambda s=scene: cp.Scene(s.robot, s.constraints).nominal, 7)
            print(f"  Scene, with its nominal analysis   {1e3 * analysed:8.1f} ms")
            for solver in (cp.Proximal(), cp.LCABA(), cp.DenseKKT()):
                try:
                    built = median_time(lambda s=scene, m=solver: cp.Workspace(s, m))
                except cp.errors.UnsupportedBackend:
                    continue
                print(f"  Workspace, {type(solver).__name__:24}{1e3 * built:8.2f} ms")
    print_first_solves()


# --- threads

TURNS = 3

WORK = """
import statistics, sys
from time import perf_counter
import numpy as np
import condyn_pin as cp

robot = cp.load_robot("cassie")
scene = cp.Scene(robot, robot.loops)
q, v = scene.state()
tau = np.zeros(robot.nv)
gauss = cp.Workspace(scene, cp.dynamics.GaussPrinciple())
calls = {
    "derivatives(...)": lambda: cp.derivatives(scene, q, v, tau),
    "Scene.rank": lambda: scene.rank(q),
    "GaussPrinciple, acceleration": lambda: gauss.acceleration(q, v, tau),
}
for name, call in calls.items():
    call()
    times = []
    for _ in range(100):
        start = perf_counter()
        call()
        times.append(perf_counter() - start)
    print(name, statistics.median(times), sep="|")
"""

SPIN = "while True: pass"


def times(**variables: str) -> dict[str, float]:
    """Return the median time of each call [s], in a fresh process."""
    environment = {n: x for n, x in os.environ.items() if not n.endswith("_NUM_THREADS")}
    line = [sys.executable, "-c", WORK]
    ran = subprocess.run(
        line, env=environment | variables, capture_output=True, text=True, check=True
    )
    return {name: float(time) for name, time in (x.split("|") for x in ran.stdout.splitlines())}


def threads(_: Namespace) -> None:
    """Print the table."""
    cores = os.cpu_count() or 1
    print(f"Cassie's loops, {cores} cores, medians [ms]: one thread | one for each core")
    for busy in (0, cores):
        neighbours = [subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(busy)]
        try:
            turns = [(times(), times(OMP_NUM_THREADS=str(cores))) for _ in range(TURNS)]
        finally:
            for each in neighbours:
                each.kill()
        print(f"{busy} busy neighbours")
        for name in turns[0][0]:
            one, all_ = (1e3 * median(turn[k][name] for turn in turns) for k in (0, 1))
            print(f"  {name:32}{one:8.3f} {all_:8.3f}")


# --- assembly

SPREAD = 0.2  # [rad, m]


def assembly(_: Namespace) -> None:
    """Print a line for every robot with loops."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    for load in cp.io.available_robots().values():
        robot = load()
        if not robot.loops:
            continue
        scene = cp.Scene(robot, robot.loops)
        home = scene.assemble(scene.state()[0]).branch
        rng = np.random.default_rng(0)
        times, statuses = [], Counter[str]()
        for _ in range(100):
            start = pin.integrate(robot.model, scene.nominal.q, SPREAD * rng.normal(size=robot.nv))
            before = process_time()
            assembly = scene.assemble(start, branch=home, throw=False)
            times.append(1e3 * (process_time() - before))
            statuses[assembly.status.name.lower()] += 1
        counts = ", ".join(f"{count} {name}" for name, count in statuses.most_common())
        print(
            f"{robot.name:14} median {statistics.median(times):5.1f} ms, "
            f"longest {max(times):6.1f} ms; {counts}"
        )


# --- derivatives


def derivatives(_: Namespace) -> None:
    """Print times and ratios."""
    talos = cp.load_robot("talos")
    scene, rng = cp.Scene(talos, talos.contacts), np.random.default_rng(0)
    state = (*scene.sample(rng), motor_torque(talos, rng))
    workspace = cp.Workspace(scene, cp.Proximal())
    fastest = cp.Workspace(scene, cp.LCABA() if HAS_LCABA else cp.Proximal())
    solution = workspace.solve(*state)

    def of(v: np.ndarray, tau: np.ndarray) -> KktDerivatives:
        return KktDerivatives(workspace, solution, v, tau)

    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    beside_solves(workspace, fastest, state, of)
    beside_differences(workspace.model, fastest, state, of)
    for name, held in (("four_bar", False), ("cassie", False), ("cassie", True), ("solo12", True)):
        on_chains(cp.load_robot(name), held)


def on_chains(robot, held) -> None:
    """Print what derivatives of a robot cost, with its contacts or with its loops alone."""
    scene = cp.Scene(robot, [*robot.loops, *(robot.contacts if held else [])])
    rng = np.random.default_rng(0)
    state = (*scene.sample(rng), motor_torque(robot, rng))
    workspace, bare = cp.Workspace(scene, cp.Proximal()), cp.Workspace(scene, cp.Proximal())
    model, data = bare.model, bare.data
    args = (bare.constraint_models, bare.constraint_datas, bare.proximal_settings)

    def pinocchio():
        pin.constraintDynamics(model, data, *state, *args)
        pin.computeConstraintDynamicsDerivatives(model, data, *args)

    def ours():
        d = workspace.derivatives(*state)
        return d.da_dq, d.da_dv, d.da_dtau

    def of_forces_too():
        d = workspace.derivatives(*state)
        return d.da_dq, d.da_dv, d.da_dtau, d.dlam_dq, d.dlam_dv, d.dlam_dtau

    of_pinocchio, of_ours, of_both = least_in_turns((pinocchio, ours, of_forces_too))
    numeric = cp.derivatives(scene, *state, method="differences")
    da_dq = workspace.derivatives(*state).da_dq @ numeric.along.T
    error = np.abs(da_dq - numeric.da_dq @ numeric.along.T).max() / np.abs(da_dq).max()
    print(
        f"{robot.name}, {scene.rows:2} rows: Pinocchio {of_pinocchio:6.1f} us, "
        f"ours {of_ours:6.1f} us, {of_ours / of_pinocchio:5.2f} x, error {error:.0e}; "
        f"with those of the forces {of_both:6.1f} us, {of_both / of_pinocchio:5.2f} x"
    )


def least_in_turns(functions) -> list[float]:
    """Return the least times of functions that take turns [us]: a busy machine only adds."""
    turns = [[min(repeat(f, number=5, repeat=40)) for f in functions] for _ in range(10)]
    return [1e6 / 5 * min(times) for times in zip(*turns, strict=True)]


def beside_solves(workspace, fastest, state, of) -> None:
    """Print the times of the derivatives, of Pinocchio's own and of a solve."""
    model, data, ones = workspace.model, workspace.data, np.ones(workspace.model.nv)
    models, datas = workspace.constraint_models, workspace.constraint_datas
    settings = workspace.proximal_settings
    times = interleaved(
        {
            "pinocchio": lambda q, v, tau: pin.computeConstraintDynamicsDerivatives(
                model, data, models, datas, settings
            ),
            "kkt": lambda q, v, tau: of(v, tau).da_dq,
            "jvp": lambda q, v, tau: of(v, tau).jvp(ones, ones, ones),
            "solve": workspace.solve,
            "fastest acceleration": fastest.acceleration,
            "fastest solve": fastest.solve,
        },
        [state],
        rounds=200,
        repeats=30,
    )
    for name, time in times.items():
        print(f"{name:<22} {time.median:7.1f} us")
    print(f"kkt / pinocchio          {times['kkt'].ratio(times['pinocchio']):.2f}")
    print(f"jvp / solve              {times['jvp'].ratio(times['solve']):.2f}")


def beside_differences(model, fastest, state, of) -> None:
    """Print the times of central differences over those of the derivatives."""
    for what, f in (
        ("of a and lam, solve", lambda *at: np.concatenate(_answer(fastest.solve(*at)))),
        ("of a, acceleration", fastest.acceleration),
    ):
        pair = interleaved(
            {
                "kkt": lambda q, v, tau: of(v, tau).da_dq,
                "differences": lambda q, v, tau, f=f: central(model, f, q, v, tau),
            },
            [state],
            rounds=30,
            repeats=1,
        )
        ratio = pair["differences"].ratio(pair["kkt"])
        print(f"central differences {what}: {pair['differences'].median:.0f} us, {ratio:.0f} x kkt")


def central(model, f, q, v, tau, h=1e-6):
    """Return the derivatives of f by q, v and tau: two calls a column, as users write it."""
    steps = h * np.eye(model.nv)
    columns = [
        f(pin.integrate(model, q, s), v, tau) - f(pin.integrate(model, q, -s), v, tau)
        for s in steps
    ]
    columns += [f(q, v + s, tau) - f(q, v - s, tau) for s in steps]
    columns += [f(q, v, tau + s) - f(q, v, tau - s) for s in steps]
    return np.column_stack(columns) / (2 * h)


def _answer(solution):
    return solution.a, solution.lam


# --- steps

DT = 1e-3  # [s]


def steps(_: Namespace) -> None:
    """Print a table for Talos on two feet, and one for Cassie hanging by the pelvis."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    talos, cassie = cp.load_robot("talos"), cp.load_robot("cassie")
    steps_table(cp.Scene(talos, talos.contacts), duration=0.2)
    steps_table(cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")]), duration=1.0)


def steps_table(scene: cp.Scene, *, duration: float) -> None:
    """Print what steps cost, and what a run leaves open."""
    q, v = scene.state()
    tau = np.zeros(scene.robot.nv)
    integrators = [kind() for kind in cp.simulation.INTEGRATORS.values()]
    workspace = cp.Workspace(anchored(scene, q))
    calls = {"a solve": workspace.acceleration}
    calls |= {i.title: one_step(workspace.scene, q, v, i) for i in integrators}
    times = interleaved(calls, [(q, v, tau)], rounds=200, repeats=10)
    solve = times["a solve"]
    name = f"{scene.robot.name}, {scene.rows} rows"
    print(f"\n{name}, dt {1e3 * DT:g} ms; a solve {solve.median:.1f} us")
    print(
        f"{'':<28}{'us':>8}{'solves':>8}{'measured':>10}{'x real time':>13}{'gap':>10}"
        f"{'energy [J]':>12}"
    )
    for i in integrators:
        time = times[i.title]
        run = cp.simulate(scene, q, v, duration=duration, dt=DT, integrator=i)
        quality = f"{run.violation.max():>10.1e}{np.abs(run.energy.error).max():>12.1e}"
        print(
            f"{i.title:<28}{time.median:>8.1f}{i.solves_per_step:>8g}{time.ratio(solve):>10.2f}"
            f"{1e6 * DT / time.median:>13.1f}"
            f"{quality if run.status.ok else '  ' + run.status.name.lower()}"
        )


def one_step(
    scene: cp.Scene, q: np.ndarray, v: np.ndarray, integrator: cp.simulation.Integrator
) -> Callable[..., object]:
    """Return a step as `simulate` takes it, its sample kept."""
    planned = plan(
        scene, 0.0, duration=DT, dt=DT, integrator=integrator, drift=None, solver=None, record=1
    )
    phase = HybridPhase(scene, planned)
    phase.begin(0.0, q, v)
    return lambda q, v, tau: phase.step(0.0, q, v, 0)


SUBJECTS = [
    Printed("timings startup", "what comes before the first solve", startup),
    Printed("timings threads", "threads of the BLAS, neighbours idle and busy", threads),
    Printed("timings assembly", "closing loops from random starts", assembly),
    Printed("timings derivatives", "beside Pinocchio's own and differences", derivatives),
    Printed("timings steps", "time steps against a solve and real time", steps),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
