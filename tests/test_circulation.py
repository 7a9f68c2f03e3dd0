"""Formulas and figures in circulation: `docs/in-circulation.md` is right about each of them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.constraints import HeldJoint

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "in-circulation.md").read_text(encoding="utf-8")
LINES = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)


def test_each_formula_of_the_page_is_tested():
    assert {f"test_{name}" for name in LINES} <= globals().keys()
    assert len(LINES) >= 8


def held(drift: cp.Baumgarte, duration: float, dt: float, integrator=None) -> cp.Trajectory:
    """The gap of a joint that is held 1 mrad beside its value."""
    scene = cp.Scene(robot("four_bar"), [HeldJoint("crank")])
    return cp.simulate(
        scene, [1e-3, 0.0, 0.0], np.zeros(3), duration=duration, dt=dt, drift=drift,
        integrator=integrator, close_start=False,
    )  # fmt: skip


def test_solref():
    """MuJoCo's own stiffness and damping of a joint equality, off critical damping."""
    mujoco = pytest.importorskip("mujoco")
    timeconst, dampratio, d = 0.05, 0.4, 0.9
    model = mujoco.MjModel.from_xml_string(f"""
      <mujoco><option timestep="0.001"/><worldbody><body>
        <joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.5"/>
      </body></worldbody><equality>
        <joint joint1="hinge" polycoef="0.1 0 0 0 0" solref="{timeconst} {dampratio}"
               solimp="{d} {d} 0.001"/>
      </equality></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    k, b = data.efc_KBIP.reshape(-1, 4)[0, :2]
    gains = cp.Baumgarte.from_solref(timeconst, dampratio)
    assert b == pytest.approx(gains.Kd / d, rel=1e-9)
    assert k == pytest.approx(gains.Kp / d**2, rel=1e-9)
    # what circulates is something else, but where the ratio is 1
    assert b / d != pytest.approx(2 * dampratio / timeconst, rel=0.5)
    assert k * d**2 != pytest.approx(1 / timeconst**2, rel=0.5)


def test_static_error():
    """A regularised matrix errs by mu lam: the gap ends at mu lam / beta^2."""
    ball, mu = cp.model.free_ball(mass=2.0, radius=0.05), 1e-2
    hung = cp.Scene(ball, [cp.Loop("ball", "world", "planar", axis="x")])
    left = []
    for beta in (20.0, 40.0):
        run = cp.simulate(
            hung, *hung.state(), duration=1.5, dt=5e-3, drift=cp.Baumgarte.critical(beta),
            solver=cp.DenseKKT(mu=mu),
        )  # fmt: skip
        left.append(run.violation[-1])
        assert left[-1] == pytest.approx(mu * 2.0 * 9.81 / beta**2, abs=1e-7)
    assert left[0] / left[1] == pytest.approx(4.0, rel=1e-3)


def test_settling():
    T = 0.1
    by_rule = held(cp.Baumgarte.critical(4.6 / T), T, 1e-3).q[-1, 0] / 1e-3
    assert by_rule == pytest.approx((1 + 4.6) * np.exp(-4.6), rel=1e-4)
    assert by_rule > 0.05
    right = cp.Baumgarte.from_settling_time(T, 0.01)
    assert right.alpha * T == pytest.approx(6.64, abs=0.01)
    assert held(right, T, 1e-3).q[-1, 0] / 1e-3 == pytest.approx(0.01, rel=1e-4)


def test_sign():
    solo = robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    q, v = scene.sample(np.random.default_rng(1))
    tau = np.ones(solo.nv)
    t = cp.Workspace(scene).terms(q, v)
    M_inv = np.linalg.inv(t.M)
    free = t.J @ M_inv @ (tau - t.h) + t.gamma  # what the rows have to take off
    G = t.J @ M_inv @ t.J.T
    left = []
    for sign in (-1.0, 1.0):
        lam = sign * np.linalg.solve(G, free)
        a = M_inv @ (tau - t.h + t.J.T @ lam)
        left.append(np.abs(t.J @ a + t.gamma).max() / np.abs(free).max())
    assert left == pytest.approx([0.0, 2.0], abs=1e-10)
    lam = -np.linalg.solve(G, free)
    assert cp.solve(scene, q, v, tau).lam == pytest.approx(lam, rel=1e-7, abs=1e-7)


def eigenvalues(drift: cp.Baumgarte, dt: float) -> np.ndarray:
    """Of a step of semi-implicit Euler for c'' + 2 alpha c' + beta^2 c = 0, in (c, dt c')."""
    p, d = drift.Kp * dt**2, drift.Kd * dt
    return np.linalg.eigvals([[1 - p, 1 - d], [-p, 1 - d]])


def test_gains():
    dt = 1e-3
    rule = cp.Baumgarte(1 / dt, 1 / dt)
    assert np.abs(eigenvalues(rule, dt)).max() == pytest.approx((1 + np.sqrt(5)) / 2)
    with pytest.raises(cp.InvalidArgument, match=r"1\.62 times a step"):
        held(rule, 0.01, dt, cp.SemiImplicitEuler())
    half = cp.Baumgarte.deadbeat(dt)
    assert half.Kd == pytest.approx(rule.Kd / 2)
    assert np.abs(held(half, 0.01, dt, cp.SemiImplicitEuler()).q[2:, 0]).max() < 1e-12


def test_sqrt2():
    dt = 1e-3
    rule = cp.Baumgarte(1 / dt, np.sqrt(2) / dt)
    assert np.abs(eigenvalues(rule, dt)).max() == pytest.approx(1 + np.sqrt(2))
    with pytest.raises(cp.InvalidArgument, match=r"2\.41 times a step"):
        held(rule, 0.01, dt, cp.SemiImplicitEuler())
    assert abs(held(rule, 0.02, dt, cp.RungeKutta4()).q[-1, 0]) < 1e-6


def test_pyramid():
    mu, inner = 0.7, cp.contact.FrictionCone(0.7)
    outer = cp.contact.FrictionCone(mu, pyramid="outer")
    for angle in np.radians([0.0, 45.0]):
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        # of each pyramid the largest t that it allows along f_t beside a normal force of 1
        most = {}
        for cone in (inner, outer):
            sides = cone.rows().A[1:]
            facing = sides[sides @ along > 1e-9]
            most[cone.pyramid] = (-facing[:, 2] / (facing @ along)).min()
        on_diagonal = angle > 0
        assert most["outer"] == pytest.approx(mu * (np.sqrt(2) if on_diagonal else 1))
        assert most["inner"] == pytest.approx(mu * (1 if on_diagonal else 1 / np.sqrt(2)))
        # the cone itself has mu in every direction
        assert inner.margin(mu * along + [0, 0, 1]).slips == pytest.approx(0.0, abs=1e-12)


def test_cassie():
    cassie = robot("cassie")
    legs = cp.Scene(cassie, cassie.loops)
    assert (cassie.nv, legs.rows, legs.rank().rank) == (32, 12, 10)
    whole = cp.Scene(cassie, [*cassie.loops, *cassie.contacts])
    assert whole.robot.nv + whole.rows == 56


# --- figures -------------------------------------------------------------------------------------


def rows_of_page(name: str) -> list[str]:
    return [line for line in PAGE.split("\n") if line.startswith("|") and name in line]


def test_figures_are_those_of_the_bench():
    results = json.loads((ROOT / "benchmarks/results/bench.json").read_text(encoding="utf-8"))
    found = {
        (row["scene"], row["method"]): row for row in results["rows"] if row["origin"] == "C++"
    }
    names = {
        "constrainedABA": "constrainedABA", "LCABA": "lcaba", "Proximal": "constraintDynamics",
        "Dense KKT, Eigen LDLT": "dense KKT",
    }  # fmt: skip
    factors: dict[str, list[str]] = {"talos contacts": [], "solo12 contacts": []}
    for method, word in names.items():
        (line, *_) = [each for each in rows_of_page(word) if "| 5" in each or " us, " in each]
        cells = [cell.strip() for cell in line.split("|")[2:4]]
        for cell, scene in zip(cells, factors, strict=True):
            row = found[scene, method]
            assert f"{row['bare_us']:.1f} us" in cell
            error = float(re.findall(r"\de-\d+", cell)[0])
            assert error == pytest.approx(row["error"], rel=0.3)
            factors[scene].append(f"{row['to_dense']:.1f}")
    (line,) = rows_of_page("4 to 6 times")
    for cell, said in zip(line.split("|")[2:4], factors.values(), strict=True):
        assert re.findall(r"\d\.\d", cell) == said[:3]


def test_figures_are_those_of_the_peers():
    results = json.loads((ROOT / "benchmarks/results/peers.json").read_text(encoding="utf-8"))
    talos = [row for row in results["rows"] if row["scene"] == "talos, two feet"]

    def of(quantity, peer, *words):
        (row, *_) = [
            row for row in talos
            if row["quantity"] == quantity and row["peer"] == peer
            and all(word in row["method"] for word in words)
        ]  # fmt: skip
        return row

    (differences,) = rows_of_page("50 to 100 times")
    for words, said in (("one-sided", "17 times"), ("centred", "35 times")):
        ratio = of("derivatives", "MuJoCo", words, "0.9999")["ratio"]
        assert f"{round(ratio)} times" == said
        assert said in differences
    (automatic,) = rows_of_page("automatic differentiation")
    assert f"{of('derivatives', 'Drake', 'AutoDiff')['ratio']:.0f} times" in automatic
    (derivatives,) = rows_of_page("95 us")
    bare = of("derivatives", "Pinocchio", "Derivatives")["min_us"]
    ours = [row for row in talos if row["quantity"] == "derivatives"
            and row["peer"] == "condyn_pin" and row["pinocchio"] == "4.1.0"]  # fmt: skip
    assert f"{bare:.0f} us by Pinocchio" in derivatives
    assert f"{min(row['min_us'] for row in ours):.0f} us here" in derivatives
    calls = bare / of("acceleration", "Pinocchio", "settings of condyn_pin")["min_us"]
    assert round(6 * 38 / calls) == 46
    assert round(2 * 38 / calls) == 15
    (evaluations,) = rows_of_page("400 000")
    forward = of("acceleration", "MuJoCo", "mj_forward", "Newton", "0.9999")["min_us"]
    assert f"{forward:.0f} us on one core" in evaluations
