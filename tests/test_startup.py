"""To solve is not to analyse: a first solve does no work that only other questions need."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from shared import each_of, imported_by_a_solve, robot, standard_scenes

import condyn_pin as cp

SCENES = {
    label: scene
    for name in cp.io.available_robots()
    for label, scene in standard_scenes(robot(name)).items()
}
# What analyses a scene, and never a solve of it.
ANALYSIS = (
    ("mechanism.closed_chains", "_chains"),
    ("mechanism.assembling", "assemble"),
    ("mechanism.closing", "LoopCloser.close"),
    ("dynamics.nominal", "nominal_states"),
    ("dynamics.nominal", "redundant_rows"),
    ("dynamics.solvers.reference", "Reference.solve"),
)
# What a first solve does, each at most once.
NEEDED = (
    ("dynamics.nominal", "factorise_rows"),
    ("dynamics.nominal", "_idle_rows"),
    ("constraints.rows.equations", "Equations.__init__"),
)

# Modules of this library that a first solve of a four-bar imports: each costs every user its time.
MODULES = 74


@pytest.fixture
def calls(monkeypatch) -> Counter[str]:
    """How often each of these functions was called."""
    counted: Counter[str] = Counter()

    def count(module: str, path: str) -> None:
        *kinds, name = path.split(".")
        place = import_module(f"condyn_pin.{module}")
        for kind in kinds:
            place = getattr(place, kind)
        function = getattr(place, name)

        def wrapper(*args, **options):
            counted[name if name != "__init__" else kinds[-1]] += 1
            return function(*args, **options)

        monkeypatch.setattr(place, name, wrapper)

    for place in (*ANALYSIS, *NEEDED):
        count(*place)
    return counted


def at_rest(scene: cp.Scene) -> tuple[np.ndarray, ...]:
    return cp.dynamics.described_posture(scene), np.zeros(scene.robot.nv), np.zeros(scene.robot.nv)


@each_of(SCENES)
def test_a_first_solve_assembles_nothing_and_factorises_once(label, calls):
    scene = cp.Scene(SCENES[label].robot, SCENES[label].constraints)
    workspace = cp.Workspace(scene)
    built = Counter(calls)
    workspace.solve(*at_rest(scene), throw=False)
    assert not {path.split(".")[-1] for _, path in ANALYSIS} & calls.keys()
    assert built["factorise_rows"] == 1
    if scene.nominal.independent and scene.nominal.rank == scene.rows:
        assert not built["_idle_rows"]
    assert calls["Equations"] == 1
    cp.Workspace(scene).solve(*at_rest(scene), throw=False)
    assert calls["factorise_rows"] == built["factorise_rows"]
    assert calls["_idle_rows"] == built["_idle_rows"] <= 1


@pytest.mark.long
@pytest.mark.parametrize("label", ["go2 contacts", "talos contacts", "four_bar loops"])
def test_the_condition_of_the_mass_matrix_is_read_off_its_norms(label, calls, monkeypatch):
    """One matrix of a first solve has its condition number computed, the one of the error bound.

    It belongs to the robot at its posture: other scenes of the same robot compute none.
    """
    found, cond = [], np.linalg.cond
    monkeypatch.setattr(np.linalg, "cond", lambda A: found.append(A.shape) or cond(A))
    fresh = replace(SCENES[label].robot)
    for _ in range(2):
        scene = cp.Scene(fresh, SCENES[label].constraints)
        cp.solve(scene, *at_rest(scene))
        assert len(found) == 1
    assert scene.nominal.condition <= 1 / np.finfo(float).eps


@pytest.mark.long
def test_an_open_posture_is_closed_before_the_scene_is_measured(calls):
    """Redundant rows of an open loop have singular values of the size of the gap."""
    bar = robot("four_bar")
    model, loops = bar.model, bar.loops
    rough = cp.Robot("rough", model, {"rough": next(iter(bar.postures.values())) + 0.05}, loops)
    scene = cp.Scene(rough, loops)
    cp.Workspace(scene)
    assert calls["assemble"]
    assert scene.nominal.closed
    np.testing.assert_array_equal(scene.nominal.q, scene.state()[0])


def test_a_solve_imports_nothing_that_analyses():
    found = {name for name in imported_by_a_solve() if name.startswith("condyn_pin.mechanism")}
    assert not found, f"a first solve imports {found}: import it in the function that needs it"


@pytest.mark.long
def test_a_solve_imports_no_other_question():
    """Derivatives, files and other solvers are imported by those who ask for them."""
    found = imported_by_a_solve()
    others = ("dynamics.derivatives", "constraints.partials", "io", "dynamics.solvers.soft")
    early = {f"condyn_pin.{name}" for name in others} & found
    assert not early, f"a first solve imports {early}: import it in the function that needs it"
    assert len(found) <= MODULES, (
        f"a first solve imports {len(found)} modules, at most {MODULES} may be. A file that all "
        "solves need, like a kind in constraints/kinds.py, raises MODULES by one. Import anything "
        f"else in the function that needs it. Imported: {sorted(found)}"
    )


@pytest.mark.long
def test_the_former_name_of_the_analysis_warns():
    with pytest.warns(DeprecationWarning, match="Audit is condyn_pin.dynamics.NominalAnalysis now"):
        assert cp.Audit is cp.dynamics.NominalAnalysis
