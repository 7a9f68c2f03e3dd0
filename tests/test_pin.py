"""The one file that knows which Pinocchio is installed: each difference, by what it does."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, states

import condyn_pin as cp
from condyn_pin._core import _pin


def test_version_is_read_as_numbers():
    assert _pin.VERSION_TEXT.startswith("{}.{}".format(*_pin.VERSION))
    assert (3, 9) <= _pin.VERSION < (5, 0)


@pytest.mark.parametrize("label", ["talos contacts", "solo12 contacts", "cassie loops"])
def test_cholesky_is_that_of_the_damped_kkt_matrix(label):
    scene = all_scenes()[label]
    workspace = cp.Workspace(scene, cp.Proximal(mu=1e-5))
    q, v, tau = states(label)[0]
    workspace.acceleration(q, v, tau)
    terms = workspace.terms(q, v)
    m = scene.rows
    expected = np.block([[-1e-5 * np.eye(m), terms.J], [terms.J.T, terms.M]])
    found = _pin.constraint_cholesky(workspace.data).matrix()
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("kind", ["point", "surface"])
def test_baumgarte_gains_pull_by_error_and_velocity(kind):
    """J a + gamma = -Kp c - Kd J v, for Pinocchio's own call with its own objects."""
    solo = cp.load_robot("solo12")
    q, v, tau = states("solo12 contacts")[0]
    rng = np.random.default_rng(1)
    v = v + 0.1 * rng.normal(size=solo.nv)  # off the constraint
    if kind == "point":
        scene = cp.Scene(solo, [cp.PointContact("FL_FOOT", anchor=(0.2, 0.1, 0.02))])
    else:
        anchor = (0.2, 0.1, 0.02, 0, 0, 0, 1)
        scene = cp.Scene(solo, [cp.SurfaceContact("FL_FOOT", anchor=anchor)])
    workspace = cp.Workspace(scene)
    _pin.set_baumgarte(workspace.constraint_models[0], 50.0, 12.0)
    a = pin.constraintDynamics(
        workspace.model,
        workspace.data,
        q,
        v,
        tau,
        workspace.constraint_models,
        workspace.constraint_datas,
        workspace.proximal_settings,
    )
    terms = workspace.terms(q, v)
    wanted = -50.0 * workspace.violation(q) - 12.0 * (terms.J @ v)
    assert np.abs(wanted).max() > 1.0
    assert np.abs(terms.J @ a + terms.gamma - wanted).max() < 1e-8


def test_lcaba_is_there_or_refused_with_the_line_that_installs_it():
    if _pin.HAS_LCABA:
        assert _pin.lcaba() is pin.lcaba
        return
    with pytest.raises(cp.errors.UnsupportedBackend, match="pip install"):
        _pin.lcaba()
    with pytest.raises(cp.errors.UnsupportedBackend, match="Pinocchio 4"):
        _pin.order_joints_for_lcaba(None, None, None)


@pytest.mark.parametrize("version", ["3.8.0", "5.0.0"])
def test_another_version_is_refused_at_import(version):
    code = f"import pinocchio; pinocchio.__version__ = {version!r}; import condyn_pin._core._pin"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 1
    assert f"Pinocchio {version} is installed; 3.9 or 4.x is needed" in result.stderr
