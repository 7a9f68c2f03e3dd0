"""The compiled core answers what Python answers: to the bit where both have the same headers.

Without it these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

import os
import pickle
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import sleep

import numpy as np
import pytest
from shared import HEADERS, all_scenes, robot

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled
from condyn_pin._core.tolerances import FORCES, SOLVED
from condyn_pin.dynamics import compiled as arrays
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.scene import motor_torque
from condyn_pin.dynamics.workspace import default_solver
from condyn_pin.errors import UnsupportedBackend

pytestmark = pytest.mark.native

SAME = pin.__version__ == HEADERS

# What differs where forces are summed in another order: rounding. Another Pinocchio rounds
# otherwise where an iteration ends, and each of two answers is as near to the truth as a status of
# ok promises, of a and of lam: so they are to each other, twice.
ROUNDED = 1e-12 if SAME else 2 * SOLVED
FORCED = 1e-12 if SAME else 2 * FORCES
# Products with an inverse lose what cancels in them: 2e-11 of the largest entry on Cassie off its
# loops, 5e-15 on Talos.
DIFFERENTIATED = 1e-10 if SAME else SOLVED
# Motions carry rounding on, step by step.
MOVED = 1e-9
# Behind a step the core closes loops by all rows, Python by those that are kept: with redundant
# rows they differ by the square of the gap that the step has left, up to 1.5e-7 on Cassie.
CLOSED = 3e-7
N = 12

# Scenes of rods, gears, sliders, planes, edges and of what rolls: by another method than Python's,
# so that answers agree to rounding. Of a sleigh the joint is refused.
DIRECT = (
    "rolling_ball contacts", "rolling_disc contacts", "unicycle contacts", "four_bar rod",
    "four_bar geared", "talos hands on a rod", "talos hands on a slider", "talos hand on a beam",
    "talos on edges and planes", "talos arms geared",
)  # fmt: skip

# What Proximal takes.
TAKEN = (
    "talos contacts", "talos corners", "cassie loops", "cassie loops + contacts",
    "solo12 contacts", "solo12 alone", "four_bar loops", "four_bar backwards", "four_bar hinge",
    "talos foot to foot, welded", "talos hands to the world and together", "talos foot held twice",
    "talos hands hinged", "cassie on lines",
)  # fmt: skip


OPEN = ("cassie loops", "four_bar hinge", "talos foot to foot, welded")


def batch_of(label: str, count: int = N, seed: int = 5) -> tuple[np.ndarray, ...]:
    scene, rng = all_scenes()[label], np.random.default_rng(seed)
    states = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]
    return tuple(map(np.array, zip(*states, strict=True)))


def assert_same(found: np.ndarray, wanted: np.ndarray, name: str, bits: bool = True) -> None:
    """To the bit, or relative to the largest of each row."""
    if bits and SAME:
        np.testing.assert_array_equal(found, wanted, err_msg=name)
        return
    assert found.shape == wanted.shape
    for one, two in zip(found, wanted, strict=True):
        size = max(1.0, float(np.abs(two).max(initial=0.0)))
        atol = size * (FORCED if name == "lam" else ROUNDED)
        np.testing.assert_allclose(one, two, rtol=0, atol=atol, err_msg=name)


@pytest.mark.parametrize("label", TAKEN)
def test_solutions_are_those_of_python(label):
    scene, states = all_scenes()[label], batch_of(label)
    wanted = cp.solve_batch(scene, *states)
    found = cp.solve_batch(scene, *states, executor=cp.Native(threads=2))
    own_rows = all(b.is_plain or b.size == 1 for b in scene.bounds)
    assert_same(found.a, wanted.a, "a")
    if scene.nominal.looks_independent:  # Python takes what moves nothing out where points push
        assert near(found.lam, wanted.lam, max(FORCED, 1e-10))
    else:
        assert_same(found.lam, wanted.lam, "lam", bits=own_rows)
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert found.ok
    if SAME:
        np.testing.assert_array_equal(found.iterations, wanted.iterations)
    # residuals are rounding, relative to what they are a difference of
    size = np.abs(wanted.a).max() * scene.robot.mass
    assert np.abs(found.residuals - wanted.residuals).max() <= ROUNDED * max(size, 1.0)


@pytest.mark.parametrize("label", OPEN)
@pytest.mark.parametrize("drift", [cp.Baumgarte(3.0, 20.0)])
def test_off_the_constraints_with_gains(label, drift):
    scene, (q, v, tau) = all_scenes()[label], batch_of(label)
    rng = np.random.default_rng(0)
    off = np.array(
        [pin.integrate(scene.robot.model, x, 1e-5 * rng.normal(size=v.shape[1])) for x in q]
    )
    wanted = cp.solve_batch(scene, off, v + 1e-5, tau, drift=drift)
    found = cp.solve_batch(scene, off, v + 1e-5, tau, drift=drift, executor=cp.Native(threads=1))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)  # by other sums than in Python
    assert wanted.violation.max() > 1e-6
    np.testing.assert_allclose(found.violation, wanted.violation, rtol=1e-9)
    np.testing.assert_allclose(found.velocity_violation, wanted.velocity_violation, rtol=1e-9)


def near(found: np.ndarray, wanted: np.ndarray, share: float) -> bool:
    """Whether they differ by a share of the largest number at most."""
    size = max(1.0, float(np.abs(wanted).max(initial=0.0)))
    return float(np.abs(found - wanted).max(initial=0.0)) <= share * size


def test_every_scene_with_rows_of_other_kinds_is_here():
    solvers = {label: default_solver(scene) for label, scene in all_scenes().items()}
    others = {label for label, solver in solvers.items() if not isinstance(solver, cp.Proximal)}
    assert set(DIRECT) | {"sleigh contacts"} == others


@pytest.mark.parametrize("label", DIRECT)
def test_rows_of_every_kind_are_answered(label):
    scene, states = all_scenes()[label], batch_of(label)
    wanted = cp.solve_batch(scene, *states)
    found = cp.solve_batch(scene, *states, executor=cp.Native(threads=2))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)
    assert near(found.violation, wanted.violation, 1e-12)
    assert near(found.velocity_violation, wanted.velocity_violation, 1e-12)
    assert not left_to_python(scene, states).size


def left_to_python(scene: cp.Scene, states: tuple, solver: cp.dynamics.Solver | None = None):
    """Return the rows that the core leaves."""
    q, nv = states[0], scene.robot.nv
    outputs = {
        "a": np.zeros((len(q), nv)), "lam": np.zeros((len(q), scene.rows)),
        "residuals": np.zeros((len(q), 5)), "statuses": np.zeros(len(q), np.int8),
        "iterations": np.zeros(len(q), np.int32), "solve_times": np.zeros(len(q)),
    }  # fmt: skip
    core = cp.Workspace(scene, solver).compiled
    return core.solve(states, outputs, accuracy=None, threads=1)


@pytest.mark.parametrize("label", DIRECT)
def test_rows_of_every_kind_are_differentiated(label):
    scene, states = all_scenes()[label], batch_of(label)
    wanted = cp.simulation.derivatives_batch(scene, *states)
    found = cp.simulation.derivatives_batch(scene, *states, executor=cp.Native(threads=2))
    for name in BLOCKS:
        assert near(getattr(found, name), getattr(wanted, name), 1e-8), name


@pytest.mark.parametrize("label", DIRECT)
def test_rows_of_every_kind_off_the_constraints_with_gains(label):
    scene, (q, v, tau) = all_scenes()[label], batch_of(label)
    rng, drift = np.random.default_rng(0), cp.Baumgarte(3.0, 20.0)
    off = np.array(
        [pin.integrate(scene.robot.model, x, 1e-3 * rng.normal(size=v.shape[1])) for x in q]
    )
    wanted = cp.solve_batch(scene, off, v, tau, drift=drift)
    found = cp.solve_batch(scene, off, v, tau, drift=drift, executor=cp.Native(threads=1))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)
    batch = cp.simulation.derivatives_batch
    wanted = batch(scene, off, v, tau, drift=drift)
    found = batch(scene, off, v, tau, drift=drift, executor=cp.Native(threads=1))
    for name in BLOCKS:
        assert near(getattr(found, name), getattr(wanted, name), 1e-8), name


@pytest.mark.parametrize("solver", [cp.DenseKKT(), cp.dynamics.NullSpace()])
@pytest.mark.parametrize("label", ["solo12 contacts", "talos contacts", "solo12 alone"])
def test_direct_solvers_answer_where_rows_are_independent(label, solver):
    scene, states = all_scenes()[label], batch_of(label)
    wanted = cp.solve_batch(scene, *states, solver=solver)
    found = cp.solve_batch(scene, *states, solver=solver, executor=cp.Native(threads=1))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)
    assert not left_to_python(scene, states, solver).size


def redundant_with_a_rod() -> cp.Scene:
    talos = robot("talos")
    left, right = talos.contacts
    hands = ("gripper_left_base_link", "gripper_right_base_link")
    again = cp.SurfaceContact("left_sole_link", name="again")
    return cp.Scene(talos, [left, again, right, cp.Loop(*hands, "rod", length=0.5, name="rod")])


def test_redundant_rows_get_the_smallest_lam():
    """Of DenseKKT, which takes none, Python says that they are singular."""
    for scene in (redundant_with_a_rod(), all_scenes()["cassie loops"]):
        rng, solver = np.random.default_rng(1), cp.dynamics.NullSpace()
        states = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(N)]
        q, v, tau = map(np.array, zip(*states, strict=True))
        wanted = cp.solve_batch(scene, q, v, tau, solver=solver)
        found = cp.solve_batch(scene, q, v, tau, solver=solver, executor=cp.Native(threads=1))
        np.testing.assert_array_equal(found.statuses, wanted.statuses)
        assert near(found.a, wanted.a, 1e-9)
        assert near(found.lam, wanted.lam, 1e-8)
        assert not left_to_python(scene, (q, v, tau), solver).size
        dense = cp.solve_batch(
            scene, q, v, tau, solver=cp.DenseKKT(), executor=cp.Native(threads=1)
        )
        alone = cp.solve_batch(scene, q, v, tau, solver=cp.DenseKKT())
        np.testing.assert_array_equal(dense.statuses, alone.statuses)
        assert dense.statuses.any()


def test_a_joint_that_is_held_is_a_coupling_of_one():
    solo = robot("solo12")
    held = cp.constraints.HeldJoint("FL_KFE", -1.0)
    scene = cp.Scene(solo, [*solo.contacts[1:], held])
    rng = np.random.default_rng(3)
    states = [(*scene.sample(rng), motor_torque(solo, rng)) for _ in range(N)]
    q, v, tau = map(np.array, zip(*states, strict=True))
    batch = cp.simulation.derivatives_batch
    wanted, found = batch(scene, q, v, tau), batch(scene, q, v, tau, executor=cp.Native(threads=1))
    assert near(found.solution.lam, wanted.solution.lam, 1e-9)
    for name in BLOCKS:
        assert near(getattr(found, name), getattr(wanted, name), 1e-9), name


FORCED_ON = {"solo12 contacts": "FL_FOOT", "talos hands on a rod": "gripper_left_base_link"}


@pytest.mark.parametrize("axes", ["world", "body"])
@pytest.mark.parametrize("label", FORCED_ON)
def test_forces_from_outside(label, axes):
    scene, states = all_scenes()[label], batch_of(label)
    rng, frame = np.random.default_rng(7), FORCED_ON[label]
    forces = [
        cp.AppliedForce(frame, rng.normal(size=6) * 20.0, axes),
        cp.AppliedForce("base_link", rng.normal(size=(N, 3)) * 30.0, axes),
    ]
    wanted = cp.solve_batch(scene, *states, forces=forces)
    found = cp.solve_batch(scene, *states, forces=forces, executor=cp.Native(threads=2), chunk=5)
    assert not near(wanted.a, cp.solve_batch(scene, *states).a, 1e-3)
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)
    assert near(found.error_bound, wanted.error_bound, 1e-11)
    batch = cp.simulation.derivatives_batch
    wanted = batch(scene, *states, forces=forces)
    found = batch(scene, *states, forces=forces, executor=cp.Native(threads=1))
    for name in BLOCKS:
        assert near(getattr(found, name), getattr(wanted, name), 1e-9), name


def test_loops_that_are_open_by_more_and_more_are_answered_as_by_python():
    scene, (q, v, tau) = all_scenes()["cassie loops"], batch_of("cassie loops", 60)
    rng = np.random.default_rng(2)
    for i, scale in enumerate(10.0 ** rng.uniform(-12, -2, len(q))):
        q[i] = pin.integrate(scene.robot.model, q[i], scale * rng.normal(size=v.shape[1]))
    wanted = cp.solve_batch(scene, q, v, tau)
    found = cp.solve_batch(scene, q, v, tau, executor=cp.Native(threads=2))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)
    assert near(found.lam, wanted.lam, 1e-9)


@pytest.mark.parametrize(
    "solver",
    [cp.Proximal(mu=1e-6, max_iterations=3), cp.Proximal(max_iterations=4), cp.Proximal(mu=0.0)],
)
def test_parameters_of_the_solver_are_those_of_python(solver):
    states = batch_of("cassie loops")
    scene = all_scenes()["cassie loops"]
    wanted = cp.solve_batch(scene, *states, solver=solver)
    found = cp.solve_batch(scene, *states, solver=solver, executor=cp.Native(threads=2))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    np.testing.assert_array_equal(np.isfinite(found.a), np.isfinite(wanted.a))
    fine = wanted.statuses == 0
    assert_same(found.a[fine], wanted.a[fine], "a")


def test_threads_change_no_bit():
    scene, states = all_scenes()["cassie loops"], batch_of("cassie loops", 200)
    one = cp.solve_batch(scene, *states, executor=cp.Native(threads=1))
    many = cp.solve_batch(scene, *states, executor=cp.Native(threads=7), chunk=33)
    np.testing.assert_array_equal(one.a, many.a)
    np.testing.assert_array_equal(one.lam, many.lam)


def test_what_overflows_or_is_not_solved_is_said_as_python_says_it():
    scene, (q, v, tau) = all_scenes()["talos contacts"], batch_of("talos contacts")
    v[3], v[5] = 1e160, 1e70
    wanted = cp.solve_batch(scene, q, v, tau)
    found = cp.solve_batch(scene, q, v, tau, executor=cp.Native(threads=2))
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert found.statuses[3] != 0
    assert found.statuses[4] == 0


def test_bad_arguments_are_refused_as_in_python():
    scene, (q, v, tau) = all_scenes()["solo12 contacts"], batch_of("solo12 contacts")
    q[2, 3:7] *= 1.1
    with pytest.raises(cp.InvalidArgument, match=r"Q\[2, 3:7\]"):
        cp.solve_batch(scene, q, v, tau, executor=cp.Native())
    core = cp.Workspace(scene).compiled.core
    answers = {
        "a": np.zeros_like(v), "lam": np.zeros((N, scene.rows)), "residuals": np.zeros((N, 5)),
        "iterations": np.zeros(N, np.int32), "clear": np.zeros(N, np.int32), "times": np.zeros(N),
    }  # fmt: skip
    forces = {
        "pushes": np.array([[1, 0]], np.int32), "placements": np.zeros((1, 12)),
        "wrenches": np.zeros((N, 6)),
    }  # fmt: skip
    more = {"accuracy": 1e-8, "threads": 1}
    core.solve(q, v, tau, **answers, **forces, **more)
    for bad in (
        {"a": v[:, :-1].copy()}, {"residuals": v}, {"wrenches": np.zeros((N, 3))},
        {"pushes": np.array([[99, 0]], np.int32)}, {"clear": np.zeros(2, np.int32)},
    ):  # fmt: skip
        with pytest.raises(ValueError, match="does not fit the scene"):
            core.solve(q, v, tau, **(answers | forces | bad), **more)
    with pytest.raises(ValueError, match="does not fit the scene"):
        core.solve(q[:, :-1].copy(), v, tau, **answers, **forces, **more)


def test_rows_of_constraints_that_do_not_fit_are_refused_at_the_border():
    """What would be written beyond the end of a matrix never gets that far."""
    for label, column, value in (
        ("four_bar loops", 2, 2), ("talos foot to foot, welded", 2, 5), ("four_bar hinge", 7, -1),
        ("four_bar hinge", 7, 3), ("four_bar loops", 3, 99), ("four_bar geared", 10, 99),
    ):  # fmt: skip
        workspace = cp.Workspace(all_scenes()[label])
        rest = {
            **arrays.of_model(workspace.model), **arrays.of_springs(workspace.scene.robot),
            **arrays.of_solver(workspace), **arrays.of_precision(workspace.scene),
        }  # fmt: skip
        rows = arrays.of_constraints(workspace)
        compiled().Core(**rest, **rows)
        bad = rows["constraints"].copy()
        bad[-1, column] = value
        with pytest.raises(ValueError, match=r"constraint|coupling"):
            compiled().Core(**rest, **(rows | {"constraints": bad}))


def test_what_the_core_does_not_take_is_refused_by_name_or_done_by_python():
    scene, states = all_scenes()["solo12 contacts"], batch_of("solo12 contacts")
    damped, sparse = cp.DenseKKT(mu=1e-9), cp.dynamics.SparseKKT()
    for more, word in (({"solver": damped}, "mu=1e-09"), ({"solver": sparse}, "SparseKKT")):
        with pytest.raises(UnsupportedBackend, match=word):
            cp.solve_batch(scene, *states, **more, executor=cp.Native())
        found = cp.solve_batch(scene, *states, **more, executor=cp.Native(where_possible=True))
        wanted = cp.solve_batch(scene, *states, **more)
        np.testing.assert_array_equal(found.a, wanted.a)


def test_workers_of_an_executor_use_the_core():
    scene, states = all_scenes()["cassie loops"], batch_of("cassie loops", 40)
    wanted = cp.solve_batch(scene, *states, executor=cp.Native(threads=1))
    with cp.Processes(2) as workers:
        native = cp.Native(threads=1, executor=workers)
        found = cp.solve_batch(scene, *states, executor=native, chunk=10)
    np.testing.assert_array_equal(found.a, wanted.a)


def test_where_no_thread_can_be_started_the_calling_one_does_the_work():
    """A stack of half the address space, which no thread gets: batches are answered still."""
    code = """
import threading
import numpy as np
import condyn_pin as cp
try:
    threading.Thread(target=int).start()
    print("threads")
except RuntimeError:
    print("no thread")
scene = cp.Scene(cp.load_robot("solo12"))
rng = np.random.default_rng(0)
q, v = map(np.array, zip(*(scene.sample(rng) for _ in range(40))))
found = cp.solve_batch(scene, q, v, 0 * v, executor=cp.Native(threads=3))
print("answered", int((found.statuses == 0).sum()))
"""
    shell = f"ulimit -s {2**46 // 1024} && exec {sys.executable} -c {shlex.quote(code)}"
    said = subprocess.run(["sh", "-c", shell], capture_output=True, text=True)
    assert said.stdout.split("\n")[:2] == ["no thread", "answered 40"], said.stderr


def test_other_threads_of_python_go_on_meanwhile():
    scene, states = all_scenes()["cassie loops"], batch_of("cassie loops", 2000)
    native, done, ticks = cp.Native(threads=1), threading.Event(), 0
    cp.solve_batch(scene, *(x[:2] for x in states), executor=native)
    work = threading.Thread(
        target=lambda: (cp.solve_batch(scene, *states, executor=native, chunk=2000), done.set())
    )
    work.start()
    while not done.is_set():
        ticks += 1
        sleep(0)
    work.join()
    assert ticks > 5


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Python's own handler: workers that a test runs in its own process leave Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_a_batch_and_keeps_what_was_done():
    scene, (q, v, tau) = (
        all_scenes()["cassie loops + contacts"],
        batch_of("cassie loops + contacts"),
    )
    many = [np.repeat(x, 3000, axis=0) for x in (q, v, tau)]

    def interrupt(done: int, total: int) -> None:
        if done == 3000:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(cp.errors.Interrupted) as stopped:
        cp.solve_batch(scene, *many, executor=cp.Native(threads=2), chunk=3000, progress=interrupt)
    table = stopped.value.table
    assert 0 < len(table.missing) < len(q) * 3000


def test_a_native_is_a_value():
    assert cp.Native(threads=2) == pickle.loads(pickle.dumps(cp.Native(threads=2)))
    assert cp.Native().at_work >= 1
    assert replace(cp.Native(), threads=3).at_work == 3
    for bad in ({"threads": 0}, {"threads": 1.5}, {"executor": 2}, {"where_possible": 1}):
        with pytest.raises(cp.InvalidArgument, match=next(iter(bad))):
            cp.Native(**bad)


def test_the_workspace_of_another_scene_has_another_core():
    cassie = robot("cassie")
    workspace = cp.Workspace(all_scenes()["cassie loops"])
    before = workspace.compiled
    workspace.use(cp.Scene(cassie, [*cassie.loops, *cassie.contacts]))
    assert workspace.compiled is not before


@pytest.mark.parametrize("label", TAKEN)
def test_derivatives_are_those_of_python(label):
    """Of lam too where rows are redundant: those of the smallest lam."""
    scene, states = all_scenes()[label], batch_of(label)
    wanted = cp.simulation.derivatives_batch(scene, *states)
    found = cp.simulation.derivatives_batch(scene, *states, executor=cp.Native(threads=2))
    assert_derivatives(found, wanted)


def assert_derivatives(
    found: cp.simulation.BatchDerivatives,
    wanted: cp.simulation.BatchDerivatives,
    allowed: Sequence[float] = (DIFFERENTIATED,) * N,
) -> None:
    np.testing.assert_array_equal(found.solution.statuses, wanted.solution.statuses)
    for name in BLOCKS:
        one, two = getattr(found, name), getattr(wanted, name)
        assert np.isfinite(one).all()
        for i in range(len(two)):
            size = np.abs(two[i]).max(initial=0.0) or 1.0
            assert np.abs(one[i] - two[i]).max(initial=0.0) <= allowed[i] * size, (name, i)


def rounding(scene: cp.Scene, q: np.ndarray) -> float:
    """Return what rounding does to derivatives: off its loops, redundant rows nearly contradict.

    Singular values of J L^-T are then down to 1e-5 of the largest, and the inverse of G carries
    rounding of either side on by as much.
    """
    terms = cp.Workspace(scene).terms(q, np.zeros(scene.robot.nv))
    S = np.linalg.svd(np.linalg.solve(np.linalg.cholesky(terms.M), terms.J.T), compute_uv=False)
    least = S[1e-11 * S[0] < S][-1]
    return max(DIFFERENTIATED, 256 * np.finfo(float).eps * S[0] / least)


@pytest.mark.parametrize("label", OPEN)
def test_derivatives_with_gains_off_the_constraints(label):
    scene, (q, v, tau) = all_scenes()[label], batch_of(label)
    rng = np.random.default_rng(0)
    off = np.array(
        [pin.integrate(scene.robot.model, x, 1e-3 * rng.normal(size=v.shape[1])) for x in q]
    )
    drift = cp.Baumgarte(3.0, 20.0)
    wanted = cp.simulation.derivatives_batch(scene, off, v, tau, drift=drift)
    found = cp.simulation.derivatives_batch(
        scene, off, v, tau, drift=drift, executor=cp.Native(threads=1)
    )
    assert_derivatives(found, wanted, [rounding(scene, x) for x in off])


def test_methods_of_derivatives_that_it_has_not_are_refused():
    scene, states = all_scenes()["solo12 contacts"], batch_of("solo12 contacts", 2)
    with pytest.raises(UnsupportedBackend, match="pinocchio"):
        cp.simulation.derivatives_batch(
            scene, *states, method="pinocchio", executor=cp.Native(threads=1)
        )


def starts(label: str, count: int = 5) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """States at which a motion begins, with torques that move it."""
    scene = all_scenes()[label]
    q, v, tau = batch_of(label, count)
    return scene, q, 0.3 * v, 0.1 * tau


STEPS = {
    "semi-implicit": cp.SemiImplicitEuler(),
    "semi-implicit, explicit forces": cp.SemiImplicitEuler(implicit=False),
    "linearly implicit midpoint": cp.simulation.LinearlyImplicitMidpoint(),
    "implicit midpoint": cp.simulation.ImplicitMidpoint(),
    "Runge-Kutta 4": cp.RungeKutta4(),
}
DRIFTS = {
    "none": cp.simulation.NoDrift(),
    "Baumgarte": cp.Baumgarte.critical(60.0),
    "post": cp.simulation.PostStabilization(),
    "post, every third": cp.simulation.PostStabilization(every=3),
}


@pytest.mark.pairs
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("label", ["cassie loops", "four_bar loops", "solo12 contacts"])
def test_motions_are_those_of_python(label, steps, drift):
    """With springs, damping and armature on Cassie, contacts that are anchored on Solo."""
    scene, q, v, tau = starts(label, 3)
    how = {"duration": 0.02, "dt": 2e-4, "integrator": STEPS[steps], "drift": DRIFTS[drift]}
    wanted = cp.simulate_batch(scene, q, v, tau, **how, record=7)
    found = cp.simulate_batch(scene, q, v, tau, **how, record=7, executor=cp.Native(threads=2))
    # steps leave loops a little open, and rows that are redundant then are left out by other sums
    redundant = scene.nominal.looks_independent
    # bodies that float are turned by other sums
    floats = scene.robot.model.joints[1].shortname() == "JointModelFreeFlyer"
    same_bits = steps != "Runge-Kutta 4" and not redundant and not floats
    within = CLOSED if redundant and "post" in drift else MOVED
    assert_moved_alike(found, wanted, bits=same_bits, within=within)
    for name, its in wanted.samples.arrays.items():
        assert_near(found.samples.arrays[name], its, name, bits=same_bits, within=within)


def assert_near(
    found: np.ndarray, wanted: np.ndarray, name: str, *, bits: bool, within: float = MOVED
) -> None:
    if bits and SAME:
        np.testing.assert_array_equal(found, wanted, err_msg=name)
    size = max(1.0, float(np.nanmax(np.abs(wanted), initial=0.0)))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=within * size, err_msg=name)


def assert_moved_alike(
    found: cp.simulation.BatchTrajectory, wanted: cp.simulation.BatchTrajectory, *, bits: bool,
    within: float = MOVED,
) -> None:  # fmt: skip
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert list(found.reasons) == list(wanted.reasons)
    assert_near(found.q, wanted.q, "q", bits=bits, within=within)
    assert_near(found.v, wanted.v, "v", bits=bits, within=within)
    np.testing.assert_array_equal(found.t, wanted.t)
    for name in ("violation", "constraint_velocity", "energy_error"):
        one, two = getattr(found, name), getattr(wanted, name)
        least = 1e-9 if within == MOVED else within * max(1.0, float(np.abs(wanted.v).max()))
        np.testing.assert_allclose(one, two, rtol=1e-6, atol=least, err_msg=name)


@pytest.mark.pairs
@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("label", ["four_bar rod", "unicycle contacts", "rolling_disc contacts"])
def test_motions_of_rods_and_of_what_rolls(label, steps, drift):
    assert_moved_like_python(*starts(label, 3), steps, drift)


@pytest.mark.parametrize("drift", ["Baumgarte", "post"])
@pytest.mark.parametrize("label", ["talos on edges and planes", "talos arms geared"])
def test_motions_of_edges_and_planes_that_are_anchored_where_they_begin(label, drift):
    assert_moved_like_python(*starts(label), "semi-implicit", drift)


def test_points_nearly_one_are_anchored_where_a_motion_begins():
    """Pinocchio has them further apart; no motion tells their forces along that line."""
    talos = cp.load_robot("talos")
    toes = [cp.PointContact("left_sole_link", (x, 0, 0), name=f"{x}") for x in (0.1, 0.1001)]
    scene, rng = cp.Scene(talos, toes), np.random.default_rng(2)
    q, v = (np.array(x) for x in zip(*(scene.sample(rng) for _ in range(4)), strict=True))
    how = {"duration": 0.02, "dt": 2e-4, "drift": DRIFTS["Baumgarte"]}
    wanted = cp.simulate_batch(scene, q, 0.3 * v, **how)
    found = cp.simulate_batch(scene, q, 0.3 * v, **how, executor=cp.Native(threads=2))
    assert_moved_alike(found, wanted, bits=False)


def test_motions_of_redundant_rows_of_every_kind():
    scene, rng = redundant_with_a_rod(), np.random.default_rng(1)
    q, v = (np.array(x) for x in zip(*(scene.sample(rng) for _ in range(4)), strict=True))
    assert_moved_like_python(scene, q, 0.1 * v, 0.0 * v, "semi-implicit", "post")


def assert_moved_like_python(scene, q, v, tau, steps, drift, within=MOVED):
    how = {"duration": 0.02, "dt": 2e-4, "integrator": STEPS[steps], "drift": DRIFTS[drift]}
    wanted = cp.simulate_batch(scene, q, v, tau, **how, record=7)
    found = cp.simulate_batch(scene, q, v, tau, **how, record=7, executor=cp.Native(threads=2))
    assert_moved_alike(found, wanted, bits=False, within=within)
    for name, its in wanted.samples.arrays.items():
        assert_near(found.samples.arrays[name], its, name, bits=False, within=within)


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("steps", ["linearly implicit midpoint", "implicit midpoint"])
def test_a_correction_behind_a_step_with_damping_is_in_the_metric_of_mass_alone(steps, every):
    """In the middle of a step M has the damping ahead; an arm whose tip is on a rod."""
    model, joint = pin.Model(), 0
    for i in range(3):
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5 * (i > 0)]))
        joint = model.addJoint(joint, pin.JointModelRY(), below, f"hinge {i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.3), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5]))
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    model.damping[1] = 5.0
    arm = cp.Robot("arm", model)
    scene = cp.Scene(arm, [cp.Loop("tip", "universe", "rod", length=1.2)])
    q = scene.assemble(np.array([0.3, 0.5, 0.4])).q
    v = cp.mechanism.project_velocity(scene, q, np.array([3.0, -2.0, 4.0]))
    how = {"duration": 0.2, "dt": 5e-3, "integrator": STEPS[steps]}
    how["drift"] = cp.simulation.PostStabilization(every=every)
    wanted = cp.simulate_batch(scene, q[None], v[None], **how)
    found = cp.simulate_batch(scene, q[None], v[None], **how, executor=cp.Native(threads=1))
    assert_moved_alike(found, wanted, bits=False)


def test_motions_without_samples_are_measured_as_in_python():
    scene, q, v, tau = starts("cassie loops", 9)
    how = {"duration": 0.2, "dt": 1e-3, "integrator": cp.simulation.LinearlyImplicitMidpoint()}
    wanted = cp.simulate_batch(scene, q, v, tau, **how)
    found = cp.simulate_batch(scene, q, v, tau, **how, executor=cp.Native(threads=2))
    assert found.samples is None
    # steps leave Cassie's loops a little open
    assert_moved_alike(found, wanted, bits=False, within=CLOSED)
    assert found.run_times.min() > 0


def test_motions_that_break_down_or_cannot_begin_say_what_python_says():
    scene, q, v, tau = starts("cassie loops", 4)
    v[1] *= 1e4  # it turns too far in a step, or is lost
    q[2] = pin.integrate(scene.robot.model, q[2], np.full(v.shape[1], 0.05))  # open loops
    how = {"duration": 0.05, "dt": 1e-3}  # the damping of its rods is too stiff for Runge-Kutta 4
    wanted = cp.simulate_batch(scene, q, v, tau, **how, record=5)
    found = cp.simulate_batch(scene, q, v, tau, **how, record=5, executor=cp.Native(threads=2))
    assert wanted.counts.get("failed", 0) + wanted.counts.get("diverged", 0) > 1
    np.testing.assert_array_equal(found.statuses, wanted.statuses)
    assert list(found.reasons) == list(wanted.reasons)
    np.testing.assert_array_equal(np.isfinite(found.samples.t), np.isfinite(wanted.samples.t))


def test_a_motion_of_the_core_is_a_trajectory_like_any_other():
    scene, q, v, tau = starts("solo12 contacts", 2)
    run = cp.simulate_batch(scene, q, v, tau, duration=0.01, record=1, executor=cp.Native())[1]
    wanted = cp.simulate(scene, q[1], v[1], tau[1], duration=0.01)
    assert_near(run.q, wanted.q, "q", bits=False)
    assert_near(run.energy.total, wanted.energy.total, "energy", bits=False)
    assert run.status is wanted.status


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"integrator": cp.simulation.StormerVerlet()}, "StormerVerlet"),
        ({"drift": cp.simulation.Projection()}, "Projection"),
        ({"forces": [cp.AppliedForce("base_link", (1.0, 0.0, 0.0))]}, "forces"),
        ({"solver": cp.dynamics.SparseKKT()}, "SparseKKT"),
    ],
)
def test_motions_that_the_core_does_not_take_are_refused_or_left_to_python(more, word):
    scene, q, v, tau = starts("solo12 contacts", 2)
    how = {"duration": 0.005, **more}
    with pytest.raises(UnsupportedBackend, match=word):
        cp.simulate_batch(scene, q, v, tau, **how, executor=cp.Native(threads=1))
    native = cp.Native(threads=1, where_possible=True)
    found = cp.simulate_batch(scene, q, v, tau, **how, executor=native)
    wanted = cp.simulate_batch(scene, q, v, tau, **how)
    np.testing.assert_array_equal(found.q, wanted.q)


def test_torques_that_are_a_function_are_left_to_python():
    scene = cp.Scene(robot("solo12"))
    q, v = (x[None] for x in scene.state("standing"))
    with pytest.raises(UnsupportedBackend, match="function"):
        cp.simulate_batch(scene, q, v, _no_torque, duration=0.01, executor=cp.Native())


def _no_torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0.0 * v


@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar hinge"])
def test_a_workspace_of_the_core_answers_one_state_as_python_does(label):
    scene, states = all_scenes()[label], batch_of(label, 3)
    native, python = cp.Workspace(scene, native=True), cp.Workspace(scene)
    for state in zip(*states, strict=True):
        found, wanted = native.solve(*state), python.solve(*state)
        assert_same(found.a[None], wanted.a[None], "a")
        assert_same(found.lam[None], wanted.lam[None], "lam", bits=label != "four_bar hinge")
        assert (found.status, found.scene) == (wanted.status, wanted.scene)
        if SAME:
            assert found.iterations == wanted.iterations
        assert found.error_bound == pytest.approx(wanted.error_bound, abs=ROUNDED)
        one, two = native.derivatives(*state), python.derivatives(*state)
        for name in BLOCKS:
            size = np.abs(getattr(two, name)).max()
            assert np.abs(getattr(one, name) - getattr(two, name)).max() <= DIFFERENTIATED * size
        along = [np.ones(scene.robot.nv)] * 3
        for left, right in zip(one.jvp(*along), two.jvp(*along), strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-8, atol=1e-8 * np.abs(right).max())
        back = np.ones(scene.robot.nv), np.ones(scene.rows)
        for left, right in zip(one.vjp(*back), two.vjp(*back), strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-8, atol=1e-8 * np.abs(right).max())
        for left, right in zip(one.by_gravity(), two.by_gravity(), strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-8, atol=1e-8 * np.abs(right).max())


def test_derivatives_by_the_core_are_of_the_state_and_the_scene_that_were_asked_about():
    scene, (q, v, tau) = all_scenes()["cassie loops"], [
        x[0].copy() for x in batch_of("cassie loops", 1)
    ]  # fmt: skip
    workspace = cp.Workspace(scene, native=True)
    wanted = cp.Workspace(scene).derivatives(q, v, tau)
    found = workspace.derivatives(q, v, tau)
    by_gravity, by_inertias = wanted.by_gravity()[0], wanted.by_inertias()[0]
    of = q.copy()
    q[7:], v[:], tau[:] = 0.0, 0.0, 0.0
    workspace.solve(of, v, tau)
    workspace.use(cp.Scene(scene.robot, scene.robot.contacts))
    np.testing.assert_array_equal(found.solution.q, of)
    assert found.solution.scene is scene
    assert near(found.solution.a, wanted.solution.a, 1e-10)
    assert near(found.by_gravity()[0], by_gravity, 1e-8)
    assert near(found.by_inertias()[0], by_inertias, 1e-8)
    assert found.solution.residuals.bound == pytest.approx(wanted.solution.error_bound, abs=ROUNDED)
    assert found.solution.iterations >= 1
    assert found.solution.solve_time > 0.0
    assert near(found.dlam_dv, wanted.dlam_dv, 1e-8)


def test_an_empty_list_of_forces_is_no_forces_to_the_core(monkeypatch):
    scene, (q, v, tau) = (
        all_scenes()["solo12 contacts"],
        [x[0] for x in batch_of("solo12 contacts", 1)],
    )
    workspace = cp.Workspace(scene, native=True)
    monkeypatch.setattr(workspace, "_answered", None)  # of Python: it may not be asked
    wanted, blocks = workspace.solve(q, v, tau), workspace.derivatives(q, v, tau)
    for none in ([], {}, np.zeros(0)):
        found = workspace.solve(q, v, tau, forces=none)
        np.testing.assert_array_equal(found.a, wanted.a)
        np.testing.assert_array_equal(found.lam, wanted.lam)
        assert found.applied == ()
        by_q = workspace.derivatives(q, v, tau, forces=none).da_dq
        np.testing.assert_array_equal(by_q, blocks.da_dq)


@pytest.mark.parametrize("label", ["four_bar rod", "rolling_disc contacts", "talos arms geared"])
def test_a_workspace_of_the_core_answers_rows_of_every_kind(label):
    scene, states = all_scenes()[label], batch_of(label, 3)
    native, python = cp.Workspace(scene, native=True), cp.Workspace(scene)
    for state in zip(*states, strict=True):
        found, wanted = native.solve(*state), python.solve(*state)
        assert near(found.a, wanted.a, 1e-10)
        assert near(found.lam, wanted.lam, 1e-9)
        one, two = native.derivatives(*state), python.derivatives(*state)
        for name in BLOCKS:
            assert near(getattr(one, name), getattr(two, name), 1e-9), name


def test_a_workspace_says_of_a_hard_state_what_python_says():
    scene, (q, v, tau) = all_scenes()["talos contacts"], batch_of("talos contacts", 1)
    native, python = cp.Workspace(scene, native=True), cp.Workspace(scene)
    for state in ((q[0], 1e160 * v[0], tau[0]), (q[0], v[0], np.full(len(v[0]), np.inf))):
        errors = []
        for workspace in (native, python):
            with pytest.raises((cp.SolveFailed, cp.InvalidArgument)) as raised:
                workspace.solve(*state)
            errors.append(type(raised.value))
        assert errors[0] is errors[1]


def test_a_workspace_refuses_or_leaves_what_the_core_does_not_take():
    scene, states = all_scenes()["solo12 contacts"], batch_of("solo12 contacts", 1)
    with pytest.raises(UnsupportedBackend, match="mu=1e-09"):
        cp.Workspace(scene, cp.DenseKKT(mu=1e-9), native=True)
    damped = cp.DenseKKT(mu=1e-9, refinements=1)
    workspace = cp.Workspace(scene, damped, native="where possible")
    state = [x[0] for x in states]
    wanted = cp.solve(scene, *state, solver=damped)
    np.testing.assert_array_equal(workspace.solve(*state).a, wanted.a)
    with pytest.raises(cp.InvalidArgument, match="native = 3"):
        cp.Workspace(scene, native=3)
    again = pickle.loads(pickle.dumps(cp.Workspace(scene, native=True)))
    assert again.native is True
    push = [cp.AppliedForce("base_link", (1.0, 0.0, 0.0))]
    native = cp.Workspace(scene, native=True)
    for more, word in (({"forces": push}, "forces"), ({"forces": push, "method": "kkt"}, "forces")):
        verb = native.derivatives if "method" in more else native.solve
        with pytest.raises(UnsupportedBackend, match=word):
            verb(*state, **more)
    with pytest.raises(UnsupportedBackend, match="pinocchio"):
        native.derivatives(*state, method="pinocchio")
    willing = cp.Workspace(scene, native="where possible")
    pushed = willing.solve(*state, forces=push)
    np.testing.assert_array_equal(pushed.a, cp.solve(scene, *state, forces=push).a)


@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar hinge"])
def test_the_verdict_of_the_core_is_that_of_python(label):
    """From quiet states to those whose forces are a million times the weight, and accuracies."""
    scene, (Q, V, TAU) = all_scenes()[label], batch_of(label, 8)
    workspace = cp.Workspace(scene, native=True)
    core, equations, estimator = workspace.compiled, workspace.equations, scene.nominal.estimator
    left = 0
    for q, v, tau in zip(Q, V, TAU, strict=True):
        for scale in (0.0, 1.0, 1e2, 1e4, 1e6):
            state = q, scale * v, scale**2 * tau
            found = core.one(*state, 1e-8)
            if found is None:
                left += 1
                assert not _is_clear(workspace, *state)
                continue
            dynamics, largest = equations.errors(*state, found.a, found.lam)
            wanted, doubtful = estimator.prove(dynamics, largest, state[2])
            assert not doubtful
            size = max(largest[1], estimator.gravity)
            rounded = _rounding(workspace, q, found) / size
            assert found.error_bound == pytest.approx(wanted.bound, rel=1e-3, abs=rounded)
            assert found.dynamics_error <= estimator.negligible_dynamics_error * size
            assert core.one(*state, 0.99 * found.error_bound) is None
            assert core.one(*state, 1.01 * found.error_bound) is not None
    assert 0 < left < 40


def _rounding(workspace: cp.Workspace, q: np.ndarray, found: cp.Solution) -> float:
    """What the rounding of M a + h - tau - J^T lam may add to the bound on the error of a."""
    equations, estimator = workspace.equations, workspace.scene.nominal.estimator
    M, J = np.abs(equations.mass(q)), np.abs(equations.jacobian(q))
    terms = 2.0 * (M @ np.abs(found.a) + J.T @ np.abs(found.lam))  # h and tau make up for these
    sums = 8 * np.finfo(float).eps * estimator.weights @ terms
    return float(estimator.largest_weight * sums)


def _is_clear(workspace: cp.Workspace, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> bool:
    """Whether Python calls its answer ok without a second look, and its forces small."""
    nominal = workspace.scene.nominal
    found = workspace._by_python((q, v, tau), (), 1e-8, False)
    dynamics, largest = workspace.equations.errors(q, v, tau, found.a, found.lam)
    residuals, doubtful = nominal.estimator.prove(dynamics, largest, tau)
    size = max(largest[1], nominal.estimator.gravity)
    falls = nominal.pivots.may_fall and not nominal.pivots.holds(
        residuals.bound, workspace.equations.mass(q)
    )
    small = residuals.dynamics <= nominal.estimator.negligible_dynamics_error * size
    return not doubtful and not falls and small and residuals.bound <= 1e-8


def test_arguments_that_only_need_converting_are_converted_for_the_core():
    scene, states = all_scenes()["solo12 contacts"], batch_of("solo12 contacts", 1)
    workspace, (q, v, tau) = cp.Workspace(scene, native=True), [x[0] for x in states]
    wanted = workspace.solve(q, v, tau)
    many = np.repeat(v, 2)[::2]
    for state in (
        (q.tolist(), v.tolist(), tau.tolist()), (q, many, tau), (q, v.astype(">f8"), tau),
        pickle.loads(pickle.dumps((q, v, tau))),
    ):  # fmt: skip
        found = workspace.solve(*state)
        np.testing.assert_array_equal(found.a, wanted.a)
        np.testing.assert_array_equal(found.q, q)
        assert not np.shares_memory(found.q, state[0])
        by = workspace.derivatives(*state)
        np.testing.assert_array_equal(by.da_dv, workspace.derivatives(q, v, tau).da_dv)
    still = workspace.solve(q, v, 0 * tau)
    np.testing.assert_array_equal(workspace.solve(q, v, 0).a, still.a)
    rough = workspace.solve(q, v.astype(np.float32), tau)
    np.testing.assert_array_equal(rough.a, workspace.solve(q, np.float64(np.float32(v)), tau).a)
    for bad, text in (
        ((q, v[:-1], tau), "v"), ((q, v[None], tau), "v"), ((q, 1j * v, tau), "v"),
        ((q[:, None], v, tau), "q"), ((q, v, "torques"), "tau"), ((1.1 * q, v, tau), "norm"),
    ):  # fmt: skip
        for verb in (workspace.solve, workspace.derivatives):
            with pytest.raises(cp.InvalidArgument, match=text):
                verb(*bad)
    with pytest.raises(cp.InvalidArgument, match="accuracy"):
        workspace.solve(q, v, tau, accuracy=0.0)


def test_couplings_of_many_joints_are_answered_in_python():
    model = pin.Model()
    for name in "abc":
        i = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), name)
        model.appendBodyToJoint(i, pin.Inertia.FromBox(1.0, 0.1, 0.2, 0.3), pin.SE3.Identity())
    gear = cp.constraints.Coupling({"a": 30.0, "b": 70.0, "c": -100.0}, name="gear")
    scene = cp.Scene(cp.Robot("gears", model), [gear])
    q, v, tau = np.zeros((2, 3)), np.zeros((2, 3)), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
    with pytest.raises(cp.errors.UnsupportedBackend, match="constraint 'gear': it has no such row"):
        cp.solve_batch(scene, q, v, tau, executor=cp.Native(threads=1))
    found = cp.solve_batch(scene, q, v, tau, executor=cp.Native(threads=1, where_possible=True))
    assert np.array_equal(found.a, cp.solve_batch(scene, q, v, tau).a)
