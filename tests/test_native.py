"""The compiled core itself: equality to the bit, its border, its threads, what it refuses.

`test_native_batches.py`, `test_native_contacts.py` and `test_native_control.py` compare its answers
with those of Python. Without the core these tests are left out; with `-m native` they fail.
"""

from __future__ import annotations

import os
import pickle
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from time import sleep
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from shared import HEADERS, all_scenes, robot
from test_native_batches import (
    AT,
    DRIFTS,
    DRIVEN,
    FOUR_ROWS,
    STEPS,
    assert_moved_alike,
    both,
    by_core,
    moved_off,
    near,
    scene_of,
    starts,
    states_of,
)
from test_native_contacts import (
    ABOUT,
    DT,
    EXACT,
    beside,
    groups_of,
    heap,
    motor,
    normal,
    on_feet,
    shin_on_a_step,
)
from test_native_control import OCTAGON, PATH, standing, tasks_of

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled, compiled_tick, core_features
from condyn_pin._core.tolerances import FORCES, SOLVED
from condyn_pin.constraints import Driven, HeldJoint
from condyn_pin.constraints.forces import ForceSite, PointForce
from condyn_pin.contact import PGS, Lemke
from condyn_pin.control import CapturePoint, ContactForce, Controller, JointTask, Posture
from condyn_pin.control import compiled as ticks
from condyn_pin.dynamics import compiled as arrays
from condyn_pin.dynamics.derivatives.others import BLOCKS
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.gradients import Kappa, step_derivatives_batch
from condyn_pin.simulation import derivatives_batch
from condyn_pin.simulation.batch.inputs import DrivenPath
from condyn_pin.simulation.batch.motions import MEASURED, Measures
from condyn_pin.stepping import step_batch
from condyn_pin.stepping.batch import ERRORS, contacts_of, paths_of, step_plan

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
N = 6
ONE = {"executor": cp.Native(threads=1)} if HEADERS else {}

# To the bit, or to rounding


# What Proximal takes.
TAKEN = (
    "talos contacts", "talos corners", "cassie loops", "cassie loops + contacts",
    "solo12 contacts", "solo12 alone", "four_bar loops", "four_bar backwards", "four_bar hinge",
    "talos foot to foot, welded", "talos hands to the world and together", "talos foot held twice",
    "talos hands hinged", "cassie on lines",
)  # fmt: skip
OPEN = ("cassie loops", "four_bar hinge", "talos foot to foot, welded")


def assert_same(found: np.ndarray, wanted: np.ndarray, name: str, bits: bool = True) -> None:
    """To the bit, or relative to the largest of each row."""
    if bits and SAME:
        assert_array_equal(found, wanted, err_msg=name)
        return
    assert found.shape == wanted.shape
    for one, two in zip(found, wanted, strict=True):
        size = max(1.0, float(np.abs(two).max(initial=0.0)))
        atol = size * (FORCED if name == "lam" else ROUNDED)
        assert_allclose(one, two, rtol=0, atol=atol, err_msg=name)


def assert_same_derivatives(
    found: cp.simulation.BatchDerivatives, wanted: cp.simulation.BatchDerivatives,
    allowed: Sequence[float] = (DIFFERENTIATED,) * N,
) -> None:  # fmt: skip
    assert_array_equal(found.solution.statuses, wanted.solution.statuses)
    for name in BLOCKS:
        one, two = getattr(found, name), getattr(wanted, name)
        assert np.isfinite(one).all()
        for i in range(len(two)):
            size = np.abs(two[i]).max(initial=0.0) or 1.0
            assert np.abs(one[i] - two[i]).max(initial=0.0) <= allowed[i] * size, (name, i)


@pytest.mark.parametrize("label", TAKEN)
def test_solutions_are_those_of_python(label):
    """Derivatives of lam too where rows are redundant: those of the smallest lam."""
    scene = scene_of(label)
    states = states_of(scene)
    found, wanted = both(cp.solve_batch, scene, *states)
    own_rows = all(b.is_plain or b.size == 1 for b in scene.bounds)
    assert_same(found.a, wanted.a, "a")
    if scene.nominal.looks_independent:  # Python takes what moves nothing out where points push
        assert near(found.lam, wanted.lam, max(FORCED, 1e-10))
    else:
        assert_same(found.lam, wanted.lam, "lam", bits=own_rows)
    assert_array_equal(found.statuses, wanted.statuses)
    assert found.ok
    if SAME:
        assert_array_equal(found.iterations, wanted.iterations)
    # residuals are rounding, relative to what they are a difference of
    size = np.abs(wanted.a).max() * scene.robot.mass
    assert np.abs(found.residuals - wanted.residuals).max() <= ROUNDED * max(size, 1.0)
    assert_same_derivatives(*both(derivatives_batch, scene, *states))


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
def test_off_the_constraints_with_gains(label):
    scene, drift = scene_of(label), cp.Baumgarte(3.0, 20.0)
    q, v, tau = states_of(scene)
    near_by = moved_off(scene, q, 1e-5)
    found, wanted = both(cp.solve_batch, scene, near_by, v + 1e-5, tau, drift=drift)
    assert_array_equal(found.statuses, wanted.statuses)
    assert near(found.a, wanted.a, 1e-10)  # by other sums than in Python
    assert wanted.violation.max() > 1e-6
    assert_allclose(found.violation, wanted.violation, rtol=1e-9)
    assert_allclose(found.velocity_violation, wanted.velocity_violation, rtol=1e-9)
    off = moved_off(scene, q, 1e-3)
    found, wanted = both(derivatives_batch, scene, off, v, tau, drift=drift)
    assert_same_derivatives(found, wanted, [rounding(scene, x) for x in off])


@pytest.mark.parametrize(
    "solver",
    [cp.Proximal(mu=1e-6, max_iterations=3), cp.Proximal(max_iterations=4), cp.Proximal(mu=0.0)],
)
def test_parameters_of_the_solver_are_those_of_python(solver):
    scene = scene_of("cassie loops")
    found, wanted = both(cp.solve_batch, scene, *states_of(scene), solver=solver)
    assert_array_equal(found.statuses, wanted.statuses)
    assert_array_equal(np.isfinite(found.a), np.isfinite(wanted.a))
    fine = wanted.statuses == 0
    assert_same(found.a[fine], wanted.a[fine], "a")


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("steps", [steps for steps in STEPS if steps != "Runge-Kutta 4"])
def test_motions_have_the_bits_of_python(steps, drift):
    """Of loops that are not redundant, of no body that floats: sums in the order of Python."""
    scene = scene_of("four_bar loops")
    how = {"duration": 0.02, "dt": 2e-4, "integrator": STEPS[steps], "drift": DRIFTS[drift]}
    found, wanted = assert_moved_alike(scene, *starts(scene), **how, record=7)
    if SAME:
        assert_array_equal(found.q, wanted.q)
        assert_array_equal(found.v, wanted.v)
        for part, its in wanted.samples.arrays.items():
            assert_array_equal(found.samples.arrays[part], its, err_msg=part)


def test_what_overflows_or_is_not_solved_is_said_as_python_says_it():
    scene = scene_of("talos contacts")
    q, v, tau = states_of(scene)
    v[3], v[5] = 1e160, 1e70
    found, wanted = both(cp.solve_batch, scene, q, v, tau)
    assert_array_equal(found.statuses, wanted.statuses)
    assert found.statuses[3] != 0
    assert found.statuses[4] == 0


# Threads, and workers


def of_bilateral(verb: Callable) -> Callable:
    scene = scene_of("cassie loops")
    return lambda **how: verb(scene, *states_of(scene, 60), **how)


def moved(label: str, **how: object) -> Callable:
    scene = scene_of(label)
    q, v, tau = starts(scene, 8)
    return lambda **over: cp.simulate_batch(scene, q, v, tau, duration=0.02, dt=DT, **how, **over)


def moved_heap(**over: object) -> cp.simulation.BatchTrajectory:
    start = heap()
    V = start.v + normal(2, 0.1, 8, 18)
    return cp.simulate_batch(
        start.scene, np.tile(start.q, (8, 1)), V, duration=0.05, **ABOUT, **over
    )


THREADED = {
    "answers": lambda: of_bilateral(cp.solve_batch),
    "motions with springs": lambda: moved(
        "four_bar loops, sprung", integrator=cp.simulation.LinearlyImplicitMidpoint()
    ),
    "steps": lambda: lambda **over: step_batch(*groups_of("falls")[0], dt=DT, **over),
    "derivatives of steps": lambda: (
        lambda **over: step_derivatives_batch(*groups_of("falls")[0], dt=DT, **over)
    ),
    "derivatives where shapes meet": lambda: (
        lambda **over: step_derivatives_batch(*beside(shin_on_a_step), **ABOUT, **over)
    ),
    "motions where shapes meet": lambda: moved_heap,
}


@pytest.mark.parametrize("label", THREADED)
def test_threads_change_no_bit(label):
    verb = THREADED[label]()
    one, many = verb(**ONE), verb(executor=cp.Native(threads=7), chunk=7)
    names = {"a", "lam", "q", "v", "dq", "dv", "codes", "margins", "errors", "energy_error"}
    compared = [name for name in sorted(names) if hasattr(one, name)]
    assert one.ok
    assert len(compared) >= 3
    for name in compared:
        assert_array_equal(getattr(one, name), getattr(many, name), err_msg=name)


def test_workers_of_an_executor_use_the_core():
    scene = scene_of("cassie loops")
    states = states_of(scene, 40)
    wanted = cp.solve_batch(scene, *states, executor=cp.Native(threads=1))
    with cp.Processes(2) as workers:
        native = cp.Native(threads=1, executor=workers)
        found = cp.solve_batch(scene, *states, executor=native, chunk=10)
    assert_array_equal(found.a, wanted.a)


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
    scene = scene_of("cassie loops")
    states = states_of(scene, 2000)
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
    scene = scene_of("cassie loops + contacts")
    many = [np.repeat(x, 6000, axis=0) for x in states_of(scene)]

    def interrupt(done: int, total: int) -> None:
        if done == 3000:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(cp.errors.Interrupted) as stopped:
        cp.solve_batch(scene, *many, executor=cp.Native(threads=2), chunk=3000, progress=interrupt)
    table = stopped.value.table
    assert 0 < len(table.missing) < len(many[0])


def test_a_native_is_a_value():
    assert cp.Native(threads=2) == pickle.loads(pickle.dumps(cp.Native(threads=2)))
    assert cp.Native().at_work >= 1
    assert replace(cp.Native(), threads=3).at_work == 3
    for bad in ({"threads": 0}, {"threads": 1.5}, {"executor": 2}, {"where_possible": 1}):
        with pytest.raises(cp.InvalidArgument, match=next(iter(bad))):
            cp.Native(**bad)


# What is refused by name, or left to Python


def solve_of(label: str, **more: object) -> Callable:
    scene = scene_of(label)
    return lambda **over: cp.solve_batch(scene, *states_of(scene, 2), **more, **over).a


def derivatives_of(label: str, **more: object) -> Callable:
    scene = scene_of(label)
    return lambda **over: derivatives_batch(scene, *states_of(scene, 2), **more, **over).da_dq


def motion_of(label: str, **more: object) -> Callable:
    scene = scene_of(label)
    q, v, tau = starts(scene, 2)
    state = q, v, more.pop("torque", tau)
    return lambda **over: cp.simulate_batch(scene, *state, duration=5e-3, **more, **over).q


def on_solo(verb: Callable, **more: object) -> Callable:
    scene, q, v, tau = on_feet("solo12", friction=0.7)
    more |= {"duration": 0.01} if verb is cp.simulate_batch else {"dt": DT}
    part = "dv" if verb is step_derivatives_batch else "v"
    return lambda **over: getattr(verb(scene, q[None], v[None], tau, **more, **over), part)


def _no_torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 0.0 * v


SOLO, SPARSE, LEAPFROG = "solo12 contacts", cp.dynamics.SparseKKT(), cp.simulation.StormerVerlet()
PUSH = [cp.AppliedForce("base_link", (1.0, 0.0, 0.0))]
MOREAU = cp.Moreau()
BY_PGS, BY_LEMKE = cp.StewartTrinkle(contact=PGS()), cp.StewartTrinkle(contact=Lemke())
REFUSED = [
    ("mu=1e-09", solve_of, SOLO, {"solver": cp.DenseKKT(mu=1e-9)}),
    ("SparseKKT", solve_of, SOLO, {"solver": SPARSE}),
    ("constraint 'gear': it has no such row", solve_of, "three_gears", {}),
    ("pinocchio", derivatives_of, SOLO, {"method": "pinocchio"}),
    ("StormerVerlet", motion_of, SOLO, {"integrator": LEAPFROG}),
    ("StormerVerlet", motion_of, "crank", {"integrator": LEAPFROG}),
    ("Projection", motion_of, SOLO, {"drift": cp.simulation.Projection()}),
    ("forces", motion_of, SOLO, {"forces": PUSH}),
    ("SparseKKT", motion_of, SOLO, {"solver": SPARSE}),
    ("function", motion_of, SOLO, {"torque": _no_torque}),
    ("StewartTrinkle alone", on_solo, step_batch, {"integrator": MOREAU}),
    ("PGS", on_solo, step_batch, {"integrator": BY_PGS}),
    ("Lemke", on_solo, cp.simulate_batch, {"integrator": BY_LEMKE}),
    ("StewartTrinkle alone", on_solo, cp.simulate_batch, {"integrator": MOREAU}),
    ("ActiveSet", on_solo, step_derivatives_batch, {"route": Kappa(1e-6)}),
    ("inertias", on_solo, step_derivatives_batch, {"wrt": ["inertias"]}),
    ("StewartTrinkle alone", on_solo, step_derivatives_batch, {"integrator": MOREAU}),
]


@pytest.mark.parametrize(("words", "verb_of", "what", "more"), REFUSED)
def test_what_the_core_does_not_take_is_refused_by_name_or_done_by_python(
    words, verb_of, what, more
):
    verb = verb_of(what, **more)
    with pytest.raises(UnsupportedBackend, match=words):
        verb(**ONE)
    if words != "pinocchio":
        willing = cp.Native(threads=1, where_possible=True)
        assert_array_equal(verb(executor=willing), verb())


def test_a_start_that_penetrates_is_refused_by_python():
    scene, q, v, tau = on_feet("solo12", friction=0.7)
    q[2] -= 0.01
    found = cp.simulate_batch(scene, q[None], v[None], tau, duration=0.01, **ONE)
    assert "penetrates" in found.reasons[0]


PUSHED = PointForce(ForceSite(1, pin.SE3.Identity()), False, np.zeros(6))

# The border: what would be read or written beyond the end of an array never gets that far


def given_of(label: str) -> dict[str, Any]:
    scene = scene_of(label).at(0.0) if label in DRIVEN else scene_of(label)
    return arrays.describe(cp.Workspace(scene))


def changed(items: Sequence[Any], i: int, **fields: object) -> list[Any]:
    """The items, one of them with other fields."""
    items = list(items)
    items[i] = items[i] | fields if isinstance(items[i], dict) else items[i]._replace(**fields)
    return items


@pytest.mark.parametrize(
    ("label", "name", "changes", "words"),
    [
        (
            "four_bar loops", "constraints",
            ({"rows": slice(1, 3)}, {"joint1": 99}, {"kind": "hose"}, {"joint1": 0.5}),
            "constraint|joint1",
        ),
        ("talos foot to foot, welded", "constraints", ({"rows": slice(0, 5)},), "constraint"),
        ("four_bar hinge", "constraints", ({"axis": -1}, {"axis": 3}), "constraint"),
        ("cardan", "constraints", ({"other_axis": 3}, {"kind": "ball"}), "constraint"),
        ("four_bar geared", "constraints", ({"at_q": (99, 0)},), "coupling"),
        (
            "four_bar loops, sprung", "between", ({"joint_b": -1}, {"joint_b": 4}),
            "joint of a spring",
        ),
    ],
)  # fmt: skip
def test_scenes_that_do_not_fit(label, name, changes, words):
    given = given_of(label)
    compiled().Core(**given)
    for each in changes:
        with pytest.raises(ValueError, match=words):
            compiled().Core(**(given | {name: changed(given[name], -1, **each)}))
    without = {key: its for key, its in given.items() if key != name}
    with pytest.raises(KeyError, match=name):
        compiled().Core(**without)


def test_columns_of_tables_are_those_of_python():
    assert compiled().columns == {
        "residuals": Residuals._fields, "measures": Measures._fields, "errors": ERRORS,
        "work": ("contact", "correction", "algorithmic", "driven"),
    }  # fmt: skip


def test_places_of_driven_rows_that_do_not_fit():
    given = given_of("crank")
    compiled().Core(**given)
    for shape in ((3, 1), (2, 3), (1, 3)):
        with pytest.raises(ValueError, match="wanted does not fit"):
            compiled().Core(**(given | {"wanted": np.zeros(shape)}))


def test_states_and_forces_that_do_not_fit():
    scene = scene_of(SOLO)
    q, v, tau = states_of(scene)
    bad_q = q.copy()
    bad_q[2, 3:7] *= 1.1
    with pytest.raises(cp.InvalidArgument, match=r"Q\[2, 3:7\]"):
        cp.solve_batch(scene, bad_q, v, tau, executor=cp.Native())
    core = cp.Workspace(scene).compiled.core
    given = {
        "a": np.zeros_like(v), "lam": np.zeros((N, scene.rows)), "residuals": np.zeros((N, 5)),
        "iterations": np.zeros(N, np.int32), "clear": np.zeros(N, np.int32), "times": np.zeros(N),
        "pushes": [PUSHED], "wrenches": np.zeros((N, 6)), "accuracy": 1e-8, "threads": 1,
        "Q": q, "V": v, "TAU": tau,
    }  # fmt: skip
    core.solve(**given)
    for bad in (
        {"a": v[:, :-1].copy()}, {"residuals": v}, {"wrenches": np.zeros((N, 3))},
        {"pushes": [PUSHED._replace(place=PUSHED.place._replace(joint=99))]},
        {"clear": np.zeros(2, np.int32)}, {"clear": np.zeros(N)}, {"Q": q[:, :-1].copy()},
        {"a": np.zeros_like(v).T.copy().T}, {"Q": q.astype(np.float32)},
    ):  # fmt: skip
        with pytest.raises(ValueError, match="does not fit the scene"):
            core.solve(**(given | bad))


def test_paths_of_motions_that_do_not_fit():
    scene = scene_of("crank").at(0.0)
    workspace = cp.Workspace(scene)
    core, path = workspace.compiled.core, DrivenPath(workspace, 1e-3, 4)
    q, v = (x[None] for x in scene.state())

    def simulate(rows, wanted, of=core):
        found = {
            "t": np.zeros((1, 2)), "q": np.zeros((1, 2, 3)), "v": np.zeros((1, 2, 3)),
            "a": np.zeros((1, 2, 3)), "lam": np.zeros((1, 2, scene.rows)),
            "measures": np.zeros((1, 2, MEASURED)),
        }  # fmt: skip
        done = np.zeros(1, np.int32)
        plan = {
            "integrator": "runge_kutta_4", "dt": 1e-3, "steps": 4, "every": 4, "correct_every": 0,
            "with_answers": True, "closed": 1e-7, "largest": 1e100, "lost": 1e50, "reach": 1.0,
            "rank": 3, "out_of_reach": 1e-2,
        }  # fmt: skip
        of.simulate(
            Q=q, V=v, TAU=0 * v, plan=plan, driven=rows, path=wanted, **found, done=done,
            times=np.zeros(1), threads=1,
        )  # fmt: skip
        return bool(done[0])

    assert simulate(path.rows, path.wanted)
    for rows, wanted in (
        (path.rows, path.wanted[:-1].copy()), (path.rows, path.wanted[:, :2].copy()),
        (path.rows, path.wanted[:, :, :0].copy()), (path.rows + 99, path.wanted),
        (path.rows - 99, path.wanted), (path.rows[:0], path.wanted[:, :, :0].copy()),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="does not fit the scene"):
            simulate(rows, wanted)
    bare = cp.Workspace(cp.Scene(scene.robot, scene.constraints[:1])).compiled.core
    with pytest.raises(ValueError, match="number of driven rows"):
        simulate(path.rows, path.wanted, bare)
    for place in range(path.wanted.size):  # wherever it is, no answer of the core has seen it
        broken = path.wanted.copy()
        broken.flat[place] = np.nan
        assert not simulate(path.rows, broken)


def test_plans_and_paths_of_steps_that_do_not_fit():
    scene, q, v, tau = motor()
    workspace = cp.Workspace(scene.bilateral.at(0.0))
    contacts = contacts_of(workspace, tuple(scene.contacts))
    plan = step_plan(EXACT, DT)
    given = {
        "q": np.zeros((1, 3)), "v": np.zeros((1, 3)), "lam": np.zeros((1, 4)),
        "errors": np.zeros((1, len(ERRORS))), "modes": np.zeros((1, 1), np.int32),
        "done": np.zeros(1, np.int32), "plan": plan, "threads": 1, **paths_of(workspace, DT),
    }  # fmt: skip

    def step(**bad: object) -> None:
        contacts.step(Q=q[None], V=v[None], TAU=tau[None], **(given | bad))

    step()
    assert given["done"][0]
    for rows, shape in (([], (3, 3, 0)), ([0], (2, 3, 1)), ([0], (3, 2, 1)), ([1], (3, 3, 1))):
        with pytest.raises(ValueError, match=r"driven rows|path"):
            step(driven=np.array(rows, np.int32), path=np.zeros(shape))
    for name, value in (
        ("polish", -1), ("tolerance", -1e-9), ("tolerance", np.nan), ("max_iterations", -1),
        ("anderson", 10**12), ("steps", 1.5),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"method of contacts|{name}"):
            step(plan=plan._replace(method=plan.method._replace(**{name: value})))
    with pytest.raises(ValueError, match="dt"):
        step(plan=plan._replace(dt=0.0))


def test_tasks_and_ticks_that_do_not_fit():
    pytest.importorskip("proxsuite")
    stands = standing("solo12")
    knee = stands.state()[0][stands.robot.index_q("FL_KFE")] - PATH(0.0)[0][0]
    driven = Driven(HeldJoint("FL_KFE", float(knee)), PATH)
    scene = cp.Scene(stands.robot, [*stands.constraints, driven])
    cones = {c.name: OCTAGON for c in stands.constraints}
    controller = Controller(scene, [CapturePoint(), Posture()], cones=cones, engine="core")
    given = ticks.describe(controller._program, 1e-8)
    whole = compiled_tick().Tick(**given)
    for wrong, words in (
        ({"tasks": changed(given["tasks"], 0, of_x=6)}, "support of a task"),  # half an edge
        ({"tasks": changed(given["tasks"], 0, of_x=3)}, "support of a task"),
        ({"tasks": changed(given["tasks"], 0, kd=0.0)}, "support of a task"),  # omega
        ({"driven": [scene.rows]}, "rows that are driven"),
        ({"driven": [-1]}, "rows that are driven"),
        ({"motors": []}, "motors"),
    ):
        with pytest.raises(ValueError, match=words):
            compiled_tick().Tick(**(given | wrong))
    q, v = scene.at(0.0).state()
    numbers = controller._tick._references.at(0.0)
    sides, out = np.zeros(len(controller.rows), np.int8), np.zeros(controller._tick._size)
    whole.solve(q, v, 0 * v, numbers, sides, out)
    for state in (
        (q[1:], v, 0 * v, numbers, sides, out), (q, v, 0 * v, numbers[:-1], sides, out),
        (q, v, 0 * v, numbers[:-3], sides, out), (q, v, 0 * v, numbers, sides[1:], out),
        (q, v, 0 * v, numbers, sides, out[len(v) :]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="does not fit"):
            whole.solve(*(np.ascontiguousarray(each) for each in state))

    tasks = [*tasks_of("solo12"), JointTask("FL_HAA"), ContactForce("FL_FOOT", weight=1e-3)]
    given = ticks.describe(Controller(stands, tasks, cones=OCTAGON, engine="core")._program, 1e-8)
    compiled_tick().Tick(**given)
    for i, fields in (
        *((i, {"kind": "wish"}) for i in range(5)), *((i, {"size": 2}) for i in range(5)),
        *((i, {"at": 99}) for i in (1, 3, 4)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="task"):
            compiled_tick().Tick(**(given | {"tasks": changed(given["tasks"], i, **fields)}))
    apart = {"touching": [], "held": [*range(stands.rows)], "cones": np.zeros((0, 0))}
    with pytest.raises(ValueError, match="contact of a task"):
        compiled_tick().Tick(**(given | apart))


# Workspaces: one state at a time


@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar hinge"])
def test_a_workspace_answers_one_state_as_python_does(label):
    scene = scene_of(label)
    native, python = cp.Workspace(scene, engine="core"), cp.Workspace(scene)
    for state in zip(*states_of(scene, 3), strict=True):
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
        along, back = [np.ones(scene.robot.nv)] * 3, (np.ones(scene.robot.nv), np.ones(scene.rows))
        for mine, its in (
            (one.jvp(*along), two.jvp(*along)), (one.vjp(*back), two.vjp(*back)),
            (one.by_gravity(), two.by_gravity()),
        ):  # fmt: skip
            for left, right in zip(mine, its, strict=True):
                assert_allclose(left, right, rtol=1e-8, atol=1e-8 * np.abs(right).max())


@pytest.mark.parametrize(
    "label",
    ["four_bar rod", "rolling_disc contacts", "talos arms geared", *FOUR_ROWS, *DRIVEN],
)
def test_a_workspace_answers_rows_of_every_kind(label):
    """Driven ones at two times; at another time the state is off its paths, rows at their word."""
    scene = scene_of(label)
    if scene.is_driven:
        scene = replace(scene, robot=replace(scene.robot, precision=0.0))
    there = [scene.at(t) for t in (AT, 0.1)] if scene.is_driven else [scene]
    native, lams = cp.Workspace(there[0], engine="core"), []
    state = [x[0] for x in states_of(there[0], 1)]
    for now in there:
        native.use(now)
        found, wanted = native.solve(*state), cp.solve(now, *state)
        assert near(found.a, wanted.a, 1e-12 if scene.is_driven else 1e-10)
        assert near(found.lam, wanted.lam, 1e-12 if scene.is_driven else 1e-9)
        assert found.residuals.violation == pytest.approx(wanted.residuals.violation, abs=1e-14)
        one, two = native.derivatives(*state), cp.derivatives(now, *state)
        for name in BLOCKS:
            share = 1e-12 if scene.is_driven else 1e-9
            assert near(getattr(one, name), getattr(two, name), share), name
        lams.append(wanted.lam)
    assert len(lams) == 1 or not near(*lams, 1e-3)


def test_the_memory_of_a_workspace_may_have_moved_on():
    """A motion takes its rows along their paths: the core begins at the time of the scene."""
    scene = scene_of("crank").at(AT)
    q, v, tau = states_of(scene, 1)
    workspace = cp.Workspace(scene)
    workspace.equations.at(3.0)
    answer, _ = by_core(workspace, (q, v, tau))
    assert near(answer["a"][0], cp.solve(scene, q[0], v[0], tau[0]).a, 1e-12)


def test_the_workspace_of_another_scene_has_another_core():
    cassie = robot("cassie")
    workspace = cp.Workspace(all_scenes()["cassie loops"])
    before = workspace.compiled
    workspace.use(cp.Scene(cassie, [*cassie.loops, *cassie.contacts]))
    assert workspace.compiled is not before


def test_derivatives_by_the_core_are_of_the_state_and_the_scene_of_the_call():
    scene = scene_of("cassie loops")
    q, v, tau = (x[0].copy() for x in states_of(scene, 1))
    workspace = cp.Workspace(scene, engine="core")
    wanted = cp.Workspace(scene).derivatives(q, v, tau)
    found = workspace.derivatives(q, v, tau)
    by_gravity, by_inertias = wanted.by_gravity()[0], wanted.by_inertias()[0]
    of = q.copy()
    q[7:], v[:], tau[:] = 0.0, 0.0, 0.0
    workspace.solve(of, v, tau)
    workspace.use(cp.Scene(scene.robot, scene.robot.contacts))
    assert_array_equal(found.solution.q, of)
    assert found.solution.scene is scene
    assert near(found.solution.a, wanted.solution.a, 1e-10)
    assert near(found.by_gravity()[0], by_gravity, 1e-8)
    assert near(found.by_inertias()[0], by_inertias, 1e-8)
    assert found.solution.residuals.bound == pytest.approx(wanted.solution.error_bound, abs=ROUNDED)
    assert found.solution.iterations >= 1
    assert found.solution.solve_time > 0.0
    assert near(found.dlam_dv, wanted.dlam_dv, 1e-8)


def test_an_empty_list_of_forces_is_no_forces_to_the_core(monkeypatch):
    scene = scene_of(SOLO)
    q, v, tau = (x[0] for x in states_of(scene, 1))
    workspace = cp.Workspace(scene, engine="core")
    monkeypatch.setattr(workspace, "_answered", None)  # of Python: no call may come
    wanted, blocks = workspace.solve(q, v, tau), workspace.derivatives(q, v, tau)
    for none in ([], {}, np.zeros(0)):
        found = workspace.solve(q, v, tau, forces=none)
        assert_array_equal(found.a, wanted.a)
        assert_array_equal(found.lam, wanted.lam)
        assert found.applied == ()
        by_q = workspace.derivatives(q, v, tau, forces=none).da_dq
        assert_array_equal(by_q, blocks.da_dq)


def test_a_workspace_says_of_a_hard_state_what_python_says():
    scene = scene_of("talos contacts")
    q, v, tau = states_of(scene, 1)
    native, python = cp.Workspace(scene, engine="core"), cp.Workspace(scene)
    for state in ((q[0], 1e160 * v[0], tau[0]), (q[0], v[0], np.full(len(v[0]), np.inf))):
        errors = []
        for workspace in (native, python):
            with pytest.raises((cp.SolveFailed, cp.InvalidArgument)) as raised:
                workspace.solve(*state)
            errors.append(type(raised.value))
        assert errors[0] is errors[1]


def test_the_core_answers_by_itself_where_it_is_installed(monkeypatch):
    """What none is named for: verbs, batches and controllers; the environment turns it off."""
    scene = scene_of(SOLO)
    Q, V, TAU = states_of(scene, 3)
    python = cp.solve_batch(scene, Q, V, TAU)
    monkeypatch.delenv("CONDYN_ENGINE")
    assert_array_equal(
        cp.solve_batch(scene, Q, V, TAU).a,
        cp.solve_batch(scene, Q, V, TAU, executor=cp.Native(threads=1)).a,
    )
    core = cp.Workspace(scene, engine="auto")
    assert "compiled core" in repr(core)
    one = cp.solve(scene_of(SOLO), Q[0], V[0], TAU[0])
    assert_array_equal(one.a, core.solve(Q[0], V[0], TAU[0]).a)
    assert_array_equal(python[0].a, cp.Workspace(scene).solve(Q[0], V[0], TAU[0]).a)
    assert_allclose(one.a, python[0].a, rtol=1e-9, atol=1e-9)
    legs = Controller(scene, [Posture()], cones=cp.contact.FrictionCone(0.6, sides=8))
    assert "compiled core" in repr(legs)
    assert "used by default" in core_features()["compiled core"]
    monkeypatch.setenv("CONDYN_ENGINE", "python")
    assert_array_equal(cp.solve_batch(scene, Q, V, TAU).a, python.a)
    monkeypatch.setenv("CONDYN_ENGINE", "C")
    with pytest.raises(cp.InvalidArgument, match="CONDYN_ENGINE = 'C'"):
        cp.solve_batch(scene, Q, V, TAU)


def test_a_workspace_refuses_or_leaves_what_the_core_does_not_take(monkeypatch):
    monkeypatch.delenv("CONDYN_ENGINE")
    scene = scene_of(SOLO)
    states = states_of(scene, 1)
    with pytest.raises(UnsupportedBackend, match="mu=1e-09"):
        cp.Workspace(scene, cp.DenseKKT(mu=1e-9), engine="core")
    damped = cp.DenseKKT(mu=1e-9, refinements=1)
    workspace = cp.Workspace(scene, damped, engine="auto")
    state = [x[0] for x in states]
    wanted = cp.solve(scene, *state, solver=damped)
    assert_array_equal(workspace.solve(*state).a, wanted.a)
    with pytest.raises(cp.InvalidArgument, match="engine = 'C'"):
        cp.Workspace(scene, engine="C")
    with pytest.warns(DeprecationWarning, match="native = True is engine = 'core' now"):
        assert cp.Workspace(scene, native=True).engine == "core"
    again = pickle.loads(pickle.dumps(cp.Workspace(scene, engine="core")))
    assert again.engine == "core"
    push = [cp.AppliedForce("base_link", (1.0, 0.0, 0.0))]
    native = cp.Workspace(scene, engine="core")
    for more, word in (({"forces": push}, "forces"), ({"forces": push, "method": "kkt"}, "forces")):
        verb = native.derivatives if "method" in more else native.solve
        with pytest.raises(UnsupportedBackend, match=word):
            verb(*state, **more)
    with pytest.raises(UnsupportedBackend, match="pinocchio"):
        native.derivatives(*state, method="pinocchio")
    willing = cp.Workspace(scene, engine="auto")
    pushed = willing.solve(*state, forces=push)
    assert_array_equal(pushed.a, cp.solve(scene, *state, forces=push).a)


@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar hinge"])
def test_the_verdict_of_the_core_is_that_of_python(label):
    """From quiet states to those whose forces are a million times the weight, and accuracies."""
    scene = scene_of(label)
    Q, V, TAU = states_of(scene, 8)
    workspace = cp.Workspace(scene, engine="core")
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
    scene = scene_of(SOLO)
    states = states_of(scene, 1)
    workspace, (q, v, tau) = cp.Workspace(scene, engine="core"), [x[0] for x in states]
    wanted = workspace.solve(q, v, tau)
    many = np.repeat(v, 2)[::2]
    for state in (
        (q.tolist(), v.tolist(), tau.tolist()), (q, many, tau), (q, v.astype(">f8"), tau),
        pickle.loads(pickle.dumps((q, v, tau))),
    ):  # fmt: skip
        found = workspace.solve(*state)
        assert_array_equal(found.a, wanted.a)
        assert_array_equal(found.q, q)
        assert not np.shares_memory(found.q, state[0])
        by = workspace.derivatives(*state)
        assert_array_equal(by.da_dv, workspace.derivatives(q, v, tau).da_dv)
    still = workspace.solve(q, v, 0 * tau)
    assert_array_equal(workspace.solve(q, v, 0).a, still.a)
    rough = workspace.solve(q, v.astype(np.float32), tau)
    assert_array_equal(rough.a, workspace.solve(q, np.float64(np.float32(v)), tau).a)
    for bad, text in (
        ((q, v[:-1], tau), "v"), ((q, v[None], tau), "v"), ((q, 1j * v, tau), "v"),
        ((q[:, None], v, tau), "q"), ((q, v, "torques"), "tau"), ((1.1 * q, v, tau), "norm"),
    ):  # fmt: skip
        for verb in (workspace.solve, workspace.derivatives):
            with pytest.raises(cp.InvalidArgument, match=text):
                verb(*bad)
    with pytest.raises(cp.InvalidArgument, match="accuracy"):
        workspace.solve(q, v, tau, accuracy=0.0)
