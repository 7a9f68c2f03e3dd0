"""Benchmark problems: answers and scenes, each derived a second time, and their runs."""

from __future__ import annotations

import functools
import json
import pickle
from dataclasses import replace
from pathlib import Path

import classical
import mpmath as mp
import numpy as np
import pinocchio as pin
import pytest
from referee import MujocoReferee
from shared import each_row, relative
from typer.testing import CliRunner

import condyn_pin as cp
import lab
from condyn_pin.simulation import NoDrift
from lab.cli import app
from lab.problems.base import Limit, Problem, Setting
from lab.problems.mechanisms import _inertia_and_height

GRAVITY = 9.81
EVERY = [*lab.PROBLEMS, "A02, n = 40"]


def problem(label: str) -> Problem:
    return lab.load_problem("A02", n=40) if label == "A02, n = 40" else lab.load_problem(label)


@pytest.fixture(params=EVERY)
def each(request) -> Problem:
    return problem(request.param)


# What every problem keeps


@pytest.mark.long
def test_a_problem_starts_closed_and_consistent(each):
    workspace = cp.Workspace(each.scene)
    assert np.abs(workspace.violation(each.q0)).max() < 1e-15
    assert np.abs(workspace.jacobian(each.q0) @ each.v0).max() < 1e-15


@pytest.mark.long
def test_a_problem_starts_where_its_answer_does(each):
    observed = each.observe(each.q0, each.v0)
    if each.only_at:
        assert all(each.answer(t).shape == observed.shape for t in each.only_at)
        with pytest.raises(cp.InvalidArgument, match="the answer is known at"):
            each.answer(0.01)
    else:
        assert np.abs(observed - each.answer(0.0)).max() < 1e-14


@pytest.mark.long
def test_a_problem_is_a_value(each):
    again = pickle.loads(pickle.dumps(each))
    assert again == each
    assert again.scene == each.scene
    values = [limit.value for limit in each.limits]
    assert values == sorted(values, reverse=True)
    assert each.label.startswith(each.name)


# Answers


@pytest.mark.parametrize("t", [0.3, 1.0, 4.7, 9.99])
def test_answer_of_the_pendulum(t):
    mp.mp.dps = 30
    u, m = mp.sqrt(mp.mpf("9.81")) * mp.mpf(t), mp.mpf("0.5")
    s = -mp.sqrt(m) * mp.ellipfun("cd", u, m=m)
    wanted = [2 * s * mp.sqrt(1 - s * s), 2 * s * s - 1]
    assert np.abs(lab.load_problem("A01").answer(t) - [float(x) for x in wanted]).max() < 1e-14


@pytest.mark.values
@pytest.mark.parametrize("n", [1, 2, 40])
@pytest.mark.parametrize("t", [0.3, 1.0, 9.7, 20.0])
def test_answer_of_the_n_four_bar(n, t):
    """sin(psi / 2) = sn, cos(psi / 2) = cn; x = sin(psi), z = -cos(psi)."""
    mp.mp.dps = 30
    w2 = mp.mpf("9.81") * (mp.mpf(n + 1) / 2 + n) / (mp.mpf(n + 1) / 3 + n)
    W = mp.sqrt(1 + 4 * w2)
    m = 4 * w2 / W**2
    u = mp.ellipk(m) - W * mp.mpf(t) / 2
    sn, cn, dn = (mp.ellipfun(name, u, m=m) for name in ("sn", "cn", "dn"))
    x, z, rate = 2 * sn * cn, sn * sn - cn * cn, -W * dn
    wanted = [float(each) for each in (x, z, -z * rate, x * rate)]
    assert np.abs(lab.load_problem("A02", n=n).answer(t) - wanted).max() < 2e-13


# a, a' and P3 by extrapolation in extended precision of the equation of motion in a
BRICARD = {
    0.25: (6.1775472057108669e-02, 4.9858921461749518e-01,
           9.4005696834112811e-01, -9.9830806396076588e-01, -5.8146448136643635e-02),
    1.0: (1.0350284595180622e00, 2.0364153809699696e00,
          2.7448131926462304e-01, -8.8670793873467202e-01, -4.6233000268737604e-01),
    10.0: (2.6904888332479593e-04, 3.2462011740996746e-02,
           9.997309873038352e-01, -9.9999996382581727e-01, -2.6897651224945394e-04),
}  # fmt: skip


@pytest.mark.parametrize("t", BRICARD)
def test_answer_of_bricard(t):
    bricard = lab.load_problem("A04")
    found = [*bricard.motion(t), *bricard.answer(t)]
    assert np.abs(np.array(found) - BRICARD[t]).max() < 2e-13


def test_answers_of_the_test_set():
    """Its own digits, as far as they are right."""
    andrews = (
        15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
        0.5244099658805303, 0.5347301163226948, 1.048080741042263,
    )  # fmt: skip
    assert np.abs(lab.load_problem("A03").answer(0.03) / andrews - 1).max() < 3e-10
    car_axis = (0.04934557842754028, 0.49698946023017115, 1.0417425248854215, 0.37391102726536124)
    assert np.abs(lab.load_problem("car_axis").answer(3.0) / car_axis - 1).max() < 4e-13


# Scenes: their accelerations against the equations of the literature


def acceleration(one: Problem, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    tau = np.zeros(one.scene.robot.nv) if one.torque is None else one.torque(t, q, v)
    return cp.solve(one.scene, q, v, tau, solver=cp.dynamics.Reference()).a


@pytest.mark.parametrize(("psi", "rate"), [(-1.5707963, 0.0), (0.3, -2.0), (2.8, 5.0)])
def test_scene_of_the_pendulum(psi, rate):
    q = np.array([np.sin(psi), -np.cos(psi)])
    along = np.array([np.cos(psi), np.sin(psi)])
    a = acceleration(lab.load_problem("A01"), 0.0, q, rate * along)
    assert np.abs(a - (-GRAVITY * np.sin(psi) * along - rate**2 * q)).max() < 1e-13


@pytest.mark.parametrize("n", [2, 40])
@pytest.mark.parametrize("t", [0.2, 1.4])
def test_scene_of_the_n_four_bar(n, t):
    one = lab.load_problem("A02", n=n)
    x, z, dx, dz = one.answer(t)
    theta, rate = np.arctan2(z, x), x * dz - z * dx
    signs = np.array([1.0, *([-1.0, 1.0] * n)])
    wanted = -((n + 1) / 2 + n) / ((n + 1) / 3 + n) * GRAVITY * np.cos(theta)
    a = acceleration(one, t, theta * signs, rate * signs)
    assert relative(a, wanted * signs) < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_scene_of_andrews(seed):
    one = lab.load_problem("A03")
    rng = np.random.default_rng(seed)
    q, v = one.scene.sample(rng)
    v *= 1000.0
    order = [one._column(name) for name in classical.ANDREWS_ORDER]
    terms = classical.andrews(q[order], v[order])
    assert np.abs(classical.andrews_gap(q[order])).max() < 1e-13
    assert np.abs(terms.G @ v[order]).max() < 1e-12
    wanted, _ = classical.accelerations(terms)
    assert relative(acceleration(one, 0.0, q, v)[order], wanted) < 1e-10


@pytest.mark.parametrize("t", [0.1, 0.9, 1.9, 4.4])
def test_scene_of_bricard(t):
    """m a'' = -m'(a) a'^2 / 2 - V'(a), with differences of the fourth order for m' and V'."""
    one = lab.load_problem("A04")
    a, rate = one.motion(t)
    b = np.arcsin(-np.sin(a) / (1 + np.sin(a)))
    db = -np.cos(a) / ((1 + np.sin(a)) ** 2 * np.cos(b))
    q, v = np.array([a, b, a, b, a]), rate * np.array([1, db, 1, db, 1])
    h = 1e-3
    far, near = (
        np.subtract(_inertia_and_height(a + k * h), _inertia_and_height(a - k * h)) for k in (2, 1)
    )
    dm, dz = (8 * near - far) / (12 * h)
    inertia, _ = _inertia_and_height(a)
    wanted = -(dm * rate**2 / 2 + GRAVITY * dz) / inertia
    assert acceleration(one, t, q, v)[0] == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("t", [0.0, 0.37, 1.1])
@pytest.mark.parametrize("s", [0.4, 0.6])
def test_scene_of_the_car_axis(t, s):
    """At states that satisfy both constraints exactly: s along the line, psi of the axle."""
    one = lab.load_problem("car_axis")
    B, dB, _ = classical.road(t)
    psi, ds, dpsi = -0.2, 0.3, 0.8
    across, dacross = np.array([-B[1], B[0]]), np.array([-dB[1], dB[0]])
    axle, daxle = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    left, dleft = s * across, ds * across + s * dacross
    p = np.concatenate([left, left + axle])
    v = np.concatenate([dleft, dleft + dpsi * daxle])
    wanted, _ = classical.accelerations(classical.car_axis(t, p, v))
    road = np.arctan2(B[1], B[0])
    found = acceleration(one, t, np.array([road, *p]), np.array([B[0] * dB[1] - B[1] * dB[0], *v]))
    assert relative(found[1:], wanted) < 1e-10


@pytest.mark.parametrize("seed", range(3))
def test_scene_of_the_heavy_top(seed):
    """A e'' = L' x e + L x e'."""
    rng = np.random.default_rng(seed)
    R = pin.exp3(rng.normal(size=3))
    omega = rng.normal(scale=20.0, size=3)
    arm = np.array([0.0, 1.0, 0.0])
    q = np.concatenate([R @ arm, pin.Quaternion(R).coeffs()])
    v = np.concatenate([np.cross(omega, arm), omega])
    a = acceleration(lab.load_problem("heavy_top"), 0.0, q, v)
    across, e = 0.234375 + 15.0, R @ arm
    L = R @ (np.array([across, 0.46875, across]) * omega)
    de = np.cross(L, e) / across
    dL = -15.0 * GRAVITY * np.cross(e, [0.0, 0.0, 1.0])
    wanted = (np.cross(dL, e) + np.cross(L, de)) / across
    assert relative(R @ (a[:3] + np.cross(omega, v[:3])), wanted) < 1e-11


@pytest.mark.parametrize("label", ["A02", "A02, n = 40", "A03", "A04", "heavy_top"])
def test_scenes_in_mujoco(label):
    """The others have point masses, which MuJoCo refuses."""
    one = problem(label)
    scene = one.scene
    q, v = one.q0, one.v0
    if label.startswith("A0"):
        q, v = scene.sample(np.random.default_rng(0), spread=0.1)
    referee = MujocoReferee(replace(scene.robot, loops=scene.constraints))
    tau = np.zeros(scene.robot.nv) if one.torque is None else one.torque(0.0, q, v)
    wanted = referee.constrained_acceleration(q, v, tau)
    assert relative(acceleration(one, 0.0, q, v), wanted) < 1e-9


# Energy


@pytest.mark.parametrize("name", ["A03"])
def test_the_potential_is_that_of_the_torque(name):
    """tau = -dU/dq, by central differences."""
    one = lab.load_problem(name)
    q, v = one.scene.sample(np.random.default_rng(1))
    h = 1e-6
    slope = [(one.potential(q + d) - one.potential(q - d)) / (2 * h) for d in h * np.eye(len(q))]
    assert np.abs(one.torque(0.0, q, v) + slope).max() < 1e-7


# Runs


def test_two_problems_of_one_name_are_refused():
    with pytest.raises(cp.InvalidArgument, match="a problem named A01 exists"):

        class Again(Problem):
            name = "A01"


@pytest.mark.long
def test_loading():
    assert lab.load_problem("A02", n=7).n == 7
    with pytest.raises(cp.errors.UnknownName, match="did you mean 'A02'"):
        lab.load_problem("A2")
    with pytest.raises(cp.InvalidArgument, match="A01 has no size; A02 has"):
        lab.load_problem("A01", n=2)
    for n in (0, 1.5, "two", True):
        with pytest.raises(cp.InvalidArgument, match="a whole number of at least 1"):
            lab.load_problem("A02", n=n)


@functools.cache
def as_set(label: str) -> lab.ProblemResult:
    return problem(label).run()


@pytest.mark.parametrize("label", lab.PROBLEMS)
def test_a_problem_meets_its_finest_limit_as_it_is_set(label):
    result = as_set(label)
    assert result.met == result.problem.limits, str(result)
    assert result.verdict.startswith("met: ")


@pytest.mark.long
def test_what_is_promised():
    """The figures of docs/results.md."""
    pendulum, four_bar, bricard = as_set("A01"), as_set("A02"), as_set("A04")
    assert pendulum.energy_drift < 1e-10
    last = four_bar.trajectory
    found = four_bar.problem.observe(last.q[-1], last.v[-1])
    assert np.abs(found - four_bar.problem.answer(10.0)).max() < 1e-9
    assert bricard.error < 1e-10
    assert bricard.violation < 1e-12


@pytest.mark.long
def test_forty_cells_through_the_flat_posture_forty_times():
    """The library's own case: 20 s, high precision."""
    result = lab.load_problem("A02", n=40).run()
    assert result.error < 1e-3
    assert result.met == result.problem.limits
    assert result.violation < 1e-8


@pytest.mark.long
def test_a_part_of_a_problem_earns_no_verdict():
    result = lab.load_problem("A04").run(duration=1.0)
    assert result.verdict == "no verdict: 1 s of 10 s"
    assert result.met == ()


def test_the_error_falls_with_the_order_of_the_integrator():
    bricard = lab.load_problem("A04")
    coarse, fine = (
        bricard.run(dt=dt, drift=cp.Baumgarte(10.0, 10.0), duration=1.0) for dt in (0.02, 0.01)
    )
    assert np.log2(coarse.error / fine.error) == pytest.approx(4.0, abs=0.4)


@pytest.mark.long
def test_a_motion_that_ends_early_is_a_failure_and_not_an_exception():
    """Without drift control the third singular passage or so is the last."""
    result = lab.load_problem("A02").run(drift=NoDrift(), dt=0.005)
    assert result.ended
    assert result.verdict.startswith("failed: ")
    assert result.met == ()
    assert result.error == np.inf
    assert json.loads(json.dumps(result.to_dict()))["error"] is None


@each_row(
    ("options", "said"),
    [
        ({"dt": 0.0}, r"dt = 0.0: a positive number"),
        ({"dt": np.nan}, r"dt = nan: a positive number"),
        ({"dt": 3e-3}, r"dt = 0.003: 10 s is not a whole number of steps; .* is"),
        ({"duration": -1.0}, r"duration = -1.0: a positive number"),
    ],
)
def test_what_cannot_be_run_is_refused(options, said):
    with pytest.raises(cp.InvalidArgument, match=said):
        lab.load_problem("A01").run(**options)


@pytest.mark.long
def test_a_problem_known_at_its_end_only_runs_to_there():
    with pytest.raises(cp.InvalidArgument, match=r"duration = 0.01: .* known at 0.03 and 0.05 s"):
        lab.load_problem("A03").run(duration=0.01)
    assert lab.load_problem("A03").run(duration=0.05).error < 1e-10


@pytest.mark.long
def test_limits_are_judged_by_what_the_problem_says():
    result = lab.load_problem("A01").run(dt=0.01, drift=cp.Baumgarte(3.0, 3.0))
    assert result.judged == result.energy_drift
    assert result.met == (Limit("5e-5 J", 5e-5, "what EXUDYN's example aims at"),)


@pytest.mark.long
def test_a_setting_is_used_as_a_whole_or_not_at_all():
    one = lab.load_problem("A04")
    assert one.run(duration=0.1).setting == one.setting
    assert one.run(duration=0.1, dt=0.01).setting == Setting(0.01)


# The committed results


def test_committed_settings_meet_their_limits():
    root = Path(__file__).resolve().parent.parent
    saved = json.loads((root / "benchmarks" / "results" / "problems_runs.json").read_text("utf-8"))
    for row in saved["settings"]:
        assert row["verdict"].startswith("met: ")


# The command line


def run(*words: str):
    return CliRunner().invoke(app, ["problem", *words])


@pytest.mark.long
def test_the_command_lists_every_problem():
    output = run().output
    for name in lab.PROBLEMS:
        assert name in output


def test_the_command_prints_error_energy_time_and_verdict():
    done = run("A02", "--n", "3", "--duration", "0.5", "--dt", "0.01")
    assert done.exit_code == 1  # half a second earns no verdict
    for word in ("A02, n = 3", "error", "energy drift", "CPU", "verdict", "0.5 s of 20 s"):
        assert word in done.output
    done = run("A04", "--dt", "0.01", "--drift", "baumgarte", "--gain", "5", "--json")
    assert done.exit_code == 0
    saved = json.loads(done.output)
    assert saved["problem"] == "A04"
    assert saved["drift"] == "Baumgarte(alpha=5.0, beta=5.0)"
    assert saved["error"] < 1e-6
