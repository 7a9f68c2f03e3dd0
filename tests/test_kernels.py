"""What may not hang on rounding: the same on every kernel of OpenBLAS that this processor runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import kernels
import numpy as np
import pytest
from shared import all_scenes, states

import condyn_pin as cp
from condyn_pin._core.linalg import pivots, redundant_rows
from condyn_pin.mechanism.closed_chains import chains_of, independent_columns
from condyn_pin.mechanism.suggestions import _axes
from condyn_pin.simulation.stability import _fastest

# The kernels are those of numpy and SciPy; Pinocchio has its own products.
pytestmark = pytest.mark.once

HELD_TWICE = tuple(f"again.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))

LABELS = (
    "cassie loops", "talos corners", "talos foot held twice", "bricard loops", "stewart loops",
)  # fmt: skip


def facts() -> dict[str, object]:
    """Names, counts and statuses; and bits of many states against one, where they are promised."""
    import test_bridge
    from test_nonholonomic import cart

    found: dict[str, object] = {}
    for label, scene in {**{name: all_scenes()[name] for name in LABELS}, "cart": cart()}.items():
        found[f"{label}: names"] = [
            scene.nominal.redundant, scene.rank().redundant, chains_of(scene).redundant,
            chains_of(scene).dependent.tolist(), sorted(chains_of(scene).assembly_mode.items()),
        ]  # fmt: skip
    workspace = cp.Workspace(all_scenes()["cassie loops"])
    answers = [workspace.solve(*state) for state in states("cassie loops", 60)]
    found["most iterations"] = max(answer.iterations for answer in answers)
    robot = test_bridge.every_joint()
    bridge = cp.study.MujocoBridge(robot, test_bridge.mujoco_of(robot))
    Q, V = test_bridge.states(robot, 20)
    many, one = bridge.to_mujoco(Q, V), [bridge.to_mujoco(q, v) for q, v in zip(Q, V, strict=True)]
    found["rows are those of one"] = all(
        np.array_equal(many[k][i], one[i][k]) for i in range(len(Q)) for k in (0, 1)
    )
    return found


@pytest.fixture(scope="module")
def here() -> dict[str, object]:
    return json.loads(json.dumps(facts()))


def test_names_and_counts_are_the_same_on_other_kernels(here):
    code = "import json, test_kernels; print(json.dumps(test_kernels.facts()))"
    runnable = len(kernels.kernels()) - 1
    for environment in kernels.others(min(2, runnable)):
        found = subprocess.run(
            [sys.executable, "-c", code], cwd=Path(__file__).parent,
            env=environment.applied() | {"PYTHONPATH": os.pathsep.join(["..", *sys.path])},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert found.returncode == 0, found.stderr
        assert json.loads(found.stdout.splitlines()[-1]) == here, environment.label


@pytest.mark.long
def test_iterations_end_above_the_noise_of_redundant_rows(here):
    """Six are all there are by the default weight: to meet them is not to have converged."""
    assert here["most iterations"] <= 4
    assert here["rows are those of one"]


@pytest.mark.long
def test_the_last_of_equal_rows_are_redundant(here):
    assert here["talos foot held twice: names"][0] == list(HELD_TWICE)
    assert here["cart: names"][0] == ["right_wheel.lateral"]


def test_rounding_chooses_no_row_and_no_joint():
    rng = np.random.default_rng(0)
    rows = [f"{k}" for k in range(6)]
    basis = np.linalg.qr(np.vstack([np.eye(3), -np.eye(3)]))[0]  # rows 3 to 5 are those before
    J = np.hstack([np.eye(3), np.eye(3)])
    for _ in range(50):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        noise = 1e-14 * rng.normal(size=basis.shape)
        assert redundant_rows(basis @ turn + noise, rows) == ("3", "4", "5")
        assert redundant_rows(basis @ turn + noise, rows, ("1",)) == ("1", "3", "5")
        noisy = J + 1e-14 * rng.normal(size=J.shape)
        assert independent_columns(noisy, (np.arange(6),)).tolist() == [0, 1, 2]
        assert independent_columns(noisy, (np.arange(3, 6), np.arange(3))).tolist() == [3, 4, 5]


@pytest.mark.long
def test_axes_of_a_plane_are_the_same_whatever_rounding_says():
    """The singular vector across a plane has either sign, and its zeros are any rounding."""
    rng = np.random.default_rng(0)
    for normal in ([0, 0, 1], [0, 1, 0], [0.6, 0, -0.8], np.full(3, 1 / np.sqrt(3))):
        wanted = _axes(np.array(normal, float))
        for sign in (1, -1):
            for _ in range(10):
                found = _axes(sign * (np.array(normal) + 1e-15 * rng.normal(size=3)))
                assert np.abs(found - wanted).max() < 1e-12


@pytest.mark.long
def test_of_equally_damped_joints_the_first_is_named():
    """Any mixture of their modes is one: of two legs, rounding would choose."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        M = np.diag([1.0, 1.0, 1.0, 5.0]) + 1e-15 * np.ones((4, 4))
        passive = SimpleNamespace(d=2.0 + 1e-15 * rng.normal(size=4), between=None)
        system = SimpleNamespace(
            model=None,
            mass=lambda q, M=M: M,
            equations=SimpleNamespace(consistent_jacobian=lambda q: np.zeros((0, 4))),
            scene=SimpleNamespace(rows=0),
            passive=passive,
        )
        rate, joint = _fastest(system, np.zeros(4))
        assert joint == 0
        assert abs(rate - 2.0) < 1e-12


@pytest.mark.long
def test_pivots_are_independent_and_no_more_than_there_are():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(7, 3)) @ rng.normal(size=(3, 9))
    chosen, basis = pivots(A, 1e-9)
    assert len(chosen) == 3
    assert np.linalg.matrix_rank(A[:, chosen]) == 3
    assert np.abs(basis @ (basis.T @ A) - A).max() < 1e-12
    assert pivots(np.zeros((4, 5)), 0.0)[0] == []
    assert pivots(np.zeros((0, 5)), 0.0)[0] == []


def test_environments_are_those_that_run():
    """Their own kernel comes first, each kernel once, and two that are not its own are found."""
    own, *more = kernels.kernels()
    assert "OPENBLAS_CORETYPE" not in own.variables
    architectures = [each.architecture() for each in (own, *more)]
    assert len(set(architectures)) == len(architectures)
    assert all(each.label in kernels.KERNELS for each in more)
    with pytest.raises(SystemExit, match="kernels that are not its own"):
        kernels.others(len(more) + 1)


def test_pytest_is_run_in_each_and_a_failure_is_its_exit_code(tmp_path, monkeypatch, capfd):
    test, first = tmp_path / "test_it.py", kernels.others(1)[0].label
    test.write_text(
        f"import os\ndef test_it(): assert os.environ['OPENBLAS_CORETYPE'] == {first!r}\n"
    )
    # here, where it is known which kernels run, and as the program that it is
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["kernels.py", "--others", "1", "--", str(test)])
    assert kernels.main() == 0
    assert capfd.readouterr().out.splitlines()[-1] == f"passed: {first}"
    done = subprocess.run(
        [sys.executable, kernels.__file__, "--others", "2", "--", str(test)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    passed, failed = done.stdout.splitlines()[-2:]
    assert passed == f"passed: {first}"
    assert failed.startswith("failed: ")
    assert done.returncode == 1


@pytest.mark.long
def test_two_kernels_can_be_asked_for_one_by_one(monkeypatch, capsys):
    for word, which in (("--older", 0), ("--newer", 1)):
        monkeypatch.setattr(sys, "argv", ["kernels.py", word])
        assert kernels.main() == 0
        assert capsys.readouterr().out.startswith(f"== {kernels.others(2)[which].label}: ")
