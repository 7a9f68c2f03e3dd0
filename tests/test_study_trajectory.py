"""Motions in a study: step, integrator and drift scheme beside the solver."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from shared import all_scenes, each_row

import condyn_pin as cp
from condyn_pin.simulation import INTEGRATORS, GeneralisedAlpha, NoDrift, RungeKutta4
from condyn_pin.study import TrajectoryMeasure
from condyn_pin.study.fresh import measured_as

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

BAR = all_scenes()["four_bar loops"]


PLAIN = (cp.Proximal(),)


def study(measures, scene=BAR, solvers=PLAIN, **options) -> cp.Study:
    return cp.Study(scene, solvers, measure=measures, **{"states": 2} | options)


def test_the_error_falls_with_the_step_as_the_order_says():
    measures = cp.study.sweep(
        TrajectoryMeasure(integrator=RungeKutta4(), drift=NoDrift()), dt=[1e-2, 5e-3, 2.5e-3]
    )
    rows = study(measures).run(timed=False).rows
    errors = [row.error_median for row in rows]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.abs(orders - 4).max() < 0.4
    assert [row.iterations for row in rows] == [10, 20, 40]
    gaps = [row.constraint_error for row in rows]
    assert gaps == sorted(gaps, reverse=True)


@pytest.mark.long
def test_steps_integrators_and_schemes_are_rows_of_one_question():
    measures = cp.study.sweep(
        TrajectoryMeasure(duration=0.02), dt=[1e-2, 5e-3], drift=[None, NoDrift()]
    )
    table = study(measures, effort=cp.study.TimingEffort(rounds=2, repeats=1)).run()
    assert {row.measure for row in table.rows} == {"trajectory(duration=0.02)"}
    assert [(row.how["dt"], row.how["drift"]) for row in table.rows] == [
        (1e-2, None), (1e-2, "NoDrift()"), (5e-3, None), (5e-3, "NoDrift()")
    ]  # fmt: skip
    assert len({row.key for row in table.rows}) == 4
    assert len({row.timed for row in table.rows}) == 1  # in one interleaved run
    assert all(row.median_us > 0 and row.build_us > 0 for row in table.rows)


def test_the_cheapest_motion_is_tried_as_it_was_measured():
    measures = [
        TrajectoryMeasure(duration=0.02, dt=5e-3, integrator=integrator, drift=drift)
        for integrator in (RungeKutta4(), GeneralisedAlpha(rho=0.5))
        for drift in (None, NoDrift())
    ]
    table = study(measures, effort=cp.study.TimingEffort(rounds=2, repeats=1)).run()
    for row, measure in zip(table.rows, measures, strict=True):
        assert measured_as(row) == measure
    choice = table.cheapest(1e-2, measure="trajectory(duration=0.02)", states=20)
    assert choice.row in table.rows
    broken = dataclasses.replace(table.rows[0], how={"dt": 5e-3, "integrator": "Sundial()"})
    with pytest.raises(cp.InvalidArgument, match="Sundial"):
        measured_as(broken)


@pytest.mark.long
def test_a_study_of_motions_is_resumed(tmp_path):
    measures = cp.study.sweep(TrajectoryMeasure(duration=0.02), dt=[1e-2, 5e-3])
    path = tmp_path / "rows.jsonl"
    table = study(measures).run(timed=False, results=path)
    assert study(measures).run(timed=False, results=path).rows == table.rows
    assert len(path.read_text().splitlines()) == 2


@pytest.mark.long
def test_every_integrator_is_swept():
    swept = {
        type(measure.integrator).__name__.lower() for measure in cp.study.sweep(TrajectoryMeasure())
    }
    assert set(INTEGRATORS) <= swept


def test_a_motion_that_a_solver_cannot_have_is_refused_with_the_reason():
    measures = [TrajectoryMeasure(duration=0.01)]
    (row,) = (
        study(measures, solvers=[cp.dynamics.Soft(solimp=(0.9, 0.9, 0.001, 0.5, 2.0))])
        .run(timed=False)
        .rows
    )
    assert row.statuses == {"ok": 2}  # it has a spring of its own, and no drift scheme
    assert row.error_worst > 1e-4
    measures = [TrajectoryMeasure(duration=0.01, integrator=3)]
    (row,) = study(measures).run(timed=False).rows
    assert row.statuses == {"refused": 2}
    assert "an integrator is needed" in row.note


@each_row("parameters", [{"duration": 0.0}, {"dt": -1.0}, {"dt": "small"}])
def test_times_that_are_none_are_refused(parameters):
    with pytest.raises(cp.InvalidArgument, match="a number > 0"):
        TrajectoryMeasure(**parameters)


def test_bricard_after_one_iteration_is_off_by_mu():
    """1 s in steps of 1 ms: by less than 3.7 mu, its share of the steps that hold all rows."""
    from study import CONVERGED, motions

    mus = [1e-8, 1e-6, 1e-4]
    once = cp.study.sweep(cp.Proximal(max_iterations=1), mu=mus)
    rows = motions([*once, *cp.study.sweep(CONVERGED, mu=[1e-8, 1e-2])]).rows
    for mu, row in zip(mus, rows, strict=False):
        assert 1e-3 * mu < row.error_worst < 3.7 * mu
    for row in rows[len(mus) :]:
        assert 1e-13 < row.error_worst < 3e-13
