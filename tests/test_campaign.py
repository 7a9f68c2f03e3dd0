"""The campaign: its oracle against another one, and against Pinocchio; its problems; its judge."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle as decimals
import pinocchio as pin
import pytest
from shared import all_scenes, each_row, relative, states

import condyn_pin as cp

# Seeds without external forces, with constraints of every kind among them.
SEEDS = range(60)


@pytest.fixture(autouse=True)
def benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent.parent / "benchmarks"))


def quiet(seed):
    """The problem of a seed without its external forces, or None if its model is refused."""
    from judges.trees import problem

    try:
        return replace(problem(seed), forces=())
    except cp.errors.InvalidModel:
        return None


@pytest.mark.parametrize(
    "label", ["four_bar loops", "cassie loops", "talos on edges and planes", "four_bar geared"]
)
def test_two_oracles_agree(label):
    """One has 50 digits and velocities; the other positions, and their derivatives."""
    from judges.oracle import Oracle, rows, solve

    scene, (q, v, tau) = all_scenes()[label], states(label)[1]
    oracle = Oracle(scene.robot.model, q, v)
    J, gamma = rows(oracle, scene)
    found = solve(oracle.M, tau - oracle.h, J, gamma)
    wanted, _ = decimals.Oracle(scene).solve(q, v, tau)
    assert relative(np.asarray(found.a, float), np.asarray(wanted, float)) < 1e-11


@pytest.mark.long
def test_every_joint_type_is_there_and_known():
    """M and h by positions alone, of every type that Pinocchio lets a robot have."""
    from judges.oracle import Oracle

    seen = set()
    for seed in SEEDS:
        p = quiet(seed)
        if p is None:
            continue
        model = p.scene.robot.model
        seen |= {joint.shortname() for joint in model.joints[1:]}
        oracle, data = Oracle(model, p.q, p.v), model.createData()
        M = pin.crba(model, data, p.q)
        h = pin.nonLinearEffects(model, data, p.q, p.v)
        assert np.abs(M - oracle.M).max() < 1e-12 * np.abs(M).max()
        assert np.abs(h - oracle.h).max() < 1e-11 * max(np.abs(h).max(), np.abs(M).max())
    every = {name for name in dir(pin) if name.startswith("JointModel")}
    several = {"JointModel", "JointModelMimic"}  # of none, and of what a robot may not have
    assert seen == every - several


@pytest.mark.long
def test_problems_are_closed_moving_and_repeat_themselves():
    from judges.trees import problem

    kinds = set()
    for seed in SEEDS:
        p = quiet(seed)
        if p is None:
            continue
        kinds |= {getattr(c, "kind", type(c).__name__) for c in p.scene.constraints}
        assert p.scene.check(p.q, p.v).ok
        again = problem(seed)
        assert np.array_equal(p.q, again.q)
        assert np.array_equal(p.v, again.v)
        assert np.array_equal(p.tau, again.tau)
    assert {"ball", "weld", "hinge", "slider", "planar", "rod", "Coupling", "KnifeEdge"} <= kinds
    assert {"PointContact", "SurfaceContact", "LineContact", "PlanarContact"} <= kinds


def test_answers_are_right_and_a_wrong_one_is_seen():
    from campaign import SOLVERS, Right

    for seed in SEEDS[:20]:
        p = quiet(seed)
        right = Right(p)
        for solver in SOLVERS:
            try:
                workspace = cp.Workspace(p.scene, solver)
            except (cp.errors.UnsupportedConstraint, cp.errors.UnsupportedBackend):
                continue
            found = workspace.solve(p.q, p.v, p.tau, throw=False)
            if found.status.ok:
                assert right.error(found.a) < 1e-8
                assert right.force_error(found) < 1e-7
                off = found.a + 1e-6 * right.scale
                assert right.error(off) > 1e-7


@pytest.mark.parametrize("kind", ["universal", "cylindrical"])
def test_answers_of_loops_of_four_rows_are_right(kind, monkeypatch):
    """By Python, and by the compiled core if there is one."""
    monkeypatch.delenv("CONDYN_ENGINE")
    from campaign import Right
    from judges.trees import problem

    seen = 0
    for seed in SEEDS[:12]:
        try:
            p = replace(problem(seed, kinds=(kind,)), forces=())
        except cp.errors.InvalidModel:
            continue
        if not any(getattr(c, "kind", "") == kind for c in p.scene.constraints):
            continue
        right = Right(p)
        for engine in ("python", "auto"):
            found = cp.Workspace(p.scene, engine=engine).solve(p.q, p.v, p.tau, throw=False)
            if found.status.ok:
                seen += 1
                assert right.error(found.a) < 1e-8
                assert right.force_error(found) < 1e-7
    assert seen >= 8  # by each engine, four of the first twelve


def test_derivatives_are_right_along_the_constraints():
    from campaign import STEP, Right

    seen = 0
    for seed in SEEDS[:20]:
        p = quiet(seed)
        if "JointModelEllipsoid" in {j.shortname() for j in p.scene.robot.model.joints}:
            continue
        right, workspace = Right(p), cp.Workspace(p.scene)
        d = workspace.derivatives(p.q, p.v, p.tau)
        for dq, dv, dtau in right.directions(np.random.default_rng(seed)):
            had = d.da_dq @ dq + d.da_dv @ dv + d.da_dtau @ dtau
            wanted = np.asarray(right.derivative(dq, dv, dtau, STEP), float)
            size = max(np.abs(wanted).max(), right.scale)
            assert np.abs(had - wanted).max() < 1e-6 * size
            seen += 1
    assert seen > 20


@pytest.mark.long
@pytest.mark.parametrize("seed", [774, 10720])
def test_derivatives_keep_what_cancels(seed):
    """Masses over six decades: torques of tons by q, times the inverse inertia of grams."""
    from campaign import STEP, Right

    p = quiet(seed)
    right, workspace = Right(p), cp.Workspace(p.scene)
    d = workspace.derivatives(p.q, p.v, p.tau)
    *_, (dq, dv, dtau) = right.directions(np.random.default_rng([1, seed]))
    wanted = np.asarray(right.derivative(dq, dv, dtau, STEP), float)
    size = max(np.abs(d.da_dq).max(), right.scale / 1e3)
    for had in (
        d.da_dq @ dq + d.da_dv @ dv,
        workspace.derivatives(p.q, p.v, p.tau).jvp(dq, dv, dtau)[0],
    ):
        assert np.abs(had - wanted).max() < 1e-6 * size
    weights = np.random.default_rng(0).normal(size=len(wanted))
    by_q, by_v, _ = workspace.derivatives(p.q, p.v, p.tau).vjp(weights, np.zeros(p.scene.rows))
    assert abs(by_q @ dq + by_v @ dv - weights @ wanted) < 1e-5 * size


@each_row("seed", [288, 1472, 10318])
def test_pinocchios_own_derivatives_are_not_those_of_a_damped_matrix(seed):
    """With redundant rows, where mu is a millionth of G and not next to nothing."""
    p = quiet(seed)
    workspace = cp.Workspace(p.scene)
    ours, theirs = (workspace.derivatives(p.q, p.v, p.tau, method=m) for m in ("kkt", "pinocchio"))
    for name in ("da_dv", "da_dtau"):
        wanted = getattr(ours, name)
        size = max(np.abs(ours.da_dtau).max(), 1.0)  # some of them cannot move
        assert np.abs(getattr(theirs, name) - wanted).max() < 1e-7 * size


@pytest.mark.long
def test_the_report_counts_and_lists(tmp_path, capsys, monkeypatch):
    import script
    from campaign import report

    written = []
    monkeypatch.setattr(script, "fill", written.append)

    def line(seed, **solved):
        made = {"solver": "Proximal", "status": "ok", "error": 1e-12, "bound": 1e-11} | solved
        return {"seed": seed, "rows": 3, "rank": 2, "forces": 1, "solves": [made]}

    assert report({"4-Haswell": [line(0), {"seed": 1, "refused": "InvalidModel"}]}, tmp_path) == 0
    page = written[0]["docs/results.md"]["campaign"]
    assert "| 4-Haswell | 1 | 1 | 1 | 1e-12 | 0 | 0 | 0 |" in page
    (summary,) = json.loads((tmp_path / "campaign_trees.json").read_text()).values()
    assert summary["solves"] == summary["problems"] == summary["with_redundant_rows"] == 1
    for wrong in (
        {"error": 1e-7}, {"error": float("nan")}, {"force_error": 1e-3},
        {"status": "raised", "said": "ZeroDivisionError"},
    ):  # fmt: skip
        assert report({"4-Haswell": [line(0), line(7, **wrong)]}, None) == 1
        assert "seed 7, Proximal" in capsys.readouterr().out


@pytest.mark.long
def test_a_run_goes_on_where_it_was_cut(tmp_path, monkeypatch):
    import campaign

    done = []
    monkeypatch.setattr(campaign, "line", lambda seed, _: done.append(seed) or {"seed": seed})
    campaign.run(range(3), tmp_path, 1)
    (path,) = tmp_path.iterdir()
    with path.open("a") as out:
        out.write('{"seed": 3, "rows"')
    campaign.run(range(5), tmp_path, 1)
    assert done == [0, 1, 2, 3, 4]


def test_pinocchios_own_derivatives_are_refused_where_mu_is_not_small():
    """Two welds of one pair, nearly singular: da_dtau with mu and with 2 mu differ by half."""
    from campaign import _asked
    from judges.trees import problem

    p = problem(40879)
    tau, forces = _asked(p)
    workspace = cp.Workspace(p.scene)
    with pytest.raises(cp.errors.DerivativesDisagree, match="take method='kkt'"):
        workspace.derivatives(p.q, p.v, tau, method="pinocchio", **forces)
    workspace.derivatives(p.q, p.v, tau, **forces)
