"""Soft contacts against MuJoCo's own compliance, reference acceleration and forces."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin.constraints import Box, FrictionalContact
from condyn_pin.contact import (
    ADMM,
    SAP,
    ContactProblem,
    SemismoothNewton,
    natural_residual,
    soft_contact,
    solve_contact,
)
from condyn_pin.dynamics.solvers.soft import DEFAULT_SOLIMP
from condyn_pin.errors import InvalidArgument
from condyn_pin.model import free_box
from condyn_pin.stepping import SoftStep

BOX_IN_MUJOCO = """<mujoco>
<option timestep="2e-3" cone="elliptic" solver="Newton" tolerance="1e-16" iterations="200"
  impratio="{impratio}"/>
<default><geom friction=".5 0 0" condim="3" solref="{solref}" solimp="{solimp}"/></default>
<worldbody><geom type="plane" size="5 5 .1"/><body pos="0 0 .0497" euler="1 .7 0"><freejoint/>
<geom type="box" size=".1 .08 .05" mass="2"/></body></worldbody></mujoco>"""

BOX_AT_REST = """<mujoco><option timestep="1e-3" cone="elliptic"/>
<default><geom friction=".5 0 0" condim="3"/></default>
<worldbody><geom type="plane" size="5 5 .1"/><body pos="0 0 .05"><freejoint/>
<geom type="box" size=".1 .08 .05" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.pairs
@pytest.mark.parametrize("solver", [ADMM(tolerance=1e-11), SAP(), SemismoothNewton()], ids=repr)
@pytest.mark.parametrize("impratio", [1.0, 10.0])
@pytest.mark.parametrize(
    ("solref", "solimp"),
    [
        ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)),
        ((0.005, 0.7), (0.8, 0.99, 0.002, 0.3, 3.0)),
        ((-1e4, -100.0), (0.9, 0.95, 0.001, 0.5, 2.0)),
    ],
)
@pytest.mark.parametrize("v", [(0.3, 0.1, -0.05, 0, 0, 0), (1.0, 0, 0, 0.1, 0.2, 0.3)])
def test_soft_contacts_push_as_in_mujoco(solver, impratio, solref, solimp, v):
    ref, imp = (" ".join(map(str, each)) for each in (solref, solimp))
    text = BOX_IN_MUJOCO.format(impratio=impratio, solref=ref, solimp=imp)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = v
    mujoco.mj_forward(model, data)
    assert data.ncon == 3
    rows = np.concatenate([[i + 1, i + 2, i] for i in range(0, 3 * data.ncon, 3)])
    J = data.efc_J.reshape(-1, 6)[rows]
    M = np.array([_column(model, data, i) for i in range(6)])
    G = J @ np.linalg.solve(M, J.T)
    soft = soft_contact(
        [contact.dist for contact in data.contact],
        J @ data.qvel,
        np.full(data.ncon, model.body_invweight0[1, 0]),
        solref=solref,
        solimp=solimp,
        impratio=impratio,
    )
    assert pytest.approx(data.efc_R[rows], rel=1e-13) == soft.R
    assert soft.a_ref == pytest.approx(data.efc_aref[rows], rel=1e-13, abs=1e-12)
    problem = ContactProblem(
        (G + G.T) / 2, J @ data.qacc_smooth - soft.a_ref, np.full(data.ncon, 0.5), R=soft.R,
        law="ccp", level="acceleration",
    )  # fmt: skip
    forces = data.efc_force[rows]
    found = solve_contact(problem, solver)
    assert np.abs(found.lam - forces).max() < 1e-8 * np.abs(forces).max()
    assert natural_residual(problem, forces) < 1e-8
    assert "forces on the robot" in str(found)


def _column(model, data, i):
    """Return M e_i."""
    result = np.zeros(6)
    mujoco.mj_mulM(model, data, result, np.eye(6)[i])
    return result


def test_a_box_rests_as_deep_as_in_mujoco_with_the_same_compliance():
    """MuJoCo scales it by the body's inverse mass, and SoftStep by G_nn of the corner."""
    model = mujoco.MjModel.from_xml_string(BOX_AT_REST)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    deep = -min(contact.dist for contact in data.contact)
    corners = FrictionalContact("box", Box(0.1, 0.08, 0.05), friction=0.5)
    scene = cp.Scene(free_box(size=(0.2, 0.16, 0.1), mass=1.0), contacts=[corners])
    q, v = np.array([0, 0, 0.05, 0, 0, 0, 1.0]), np.zeros(6)
    G_nn = cp.stepping.contact_problem(scene, q, v, dt=1e-3).G[2, 2]
    share = model.body_invweight0[1, 0] / G_nn
    stiffer = tuple(d / (d + (1 - d) * share) for d in DEFAULT_SOLIMP[:2])
    for solimp, times in ((DEFAULT_SOLIMP, 4.25), ((*stiffer, *DEFAULT_SOLIMP[2:]), 1.0)):
        run = cp.simulate(scene, q, v, duration=1.0, integrator=SoftStep(solimp=solimp))
        deepest = -min(gap[-1] for gap in run.gaps.values())
        assert deepest == pytest.approx(times * deep, rel=5e-3)


def test_bad_softness():
    for change in (
        {"solref": (1.0, -1.0)},
        {"solimp": (0.9, 0.95, 0.0, 0.5, 2.0)},
        {"impratio": 0.0},
        {"gaps": [np.nan]},
        {"velocities": [0.0]},
        {"diagonal": [1.0, 1.0]},
    ):
        with pytest.raises(InvalidArgument):
            soft_contact(**{"gaps": [0.0], "velocities": np.zeros(3), "diagonal": [1.0], **change})
