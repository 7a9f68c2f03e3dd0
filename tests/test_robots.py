"""Every robot that ships, against a table: sizes, masses, loops and postures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from shared import CLOSED, calls, robot

import condyn_pin as cp
from condyn_pin.io.description import example_robot_data


class Figures(NamedTuple):
    """What a robot is; rows, rank and mobility are those of its loops alone."""

    nq: int
    nv: int
    mass: float  # of what moves [kg]
    loops: int
    rows: int
    rank: int
    mobility: int


# Sizes and masses by two engines; rank and mobility counted by hand.
ROBOTS = {
    "talos": Figures(39, 38, 90.2722, 0, 0, 0, 38),
    "talos_full": Figures(51, 50, 93.3357, 0, 0, 0, 50),
    "g1": Figures(36, 35, 33.3411, 0, 0, 0, 35),
    "cassie": Figures(35, 32, 32.94, 4, 12, 10, 22),
    "solo12": Figures(19, 18, 2.5, 0, 0, 0, 18),
    "anymal_c": Figures(19, 18, 52.13485, 0, 0, 0, 18),
    "go2": Figures(19, 18, 16.085, 0, 0, 0, 18),
    "hyq": Figures(19, 18, 86.774, 0, 0, 0, 18),
    "panda": Figures(9, 9, 16.8221, 0, 0, 0, 9),
    "stewart": Figures(22, 21, 14.3, 5, 15, 15, 6),
    "delta": Figures(19, 18, 2.22, 5, 15, 15, 3),
    "five_bar": Figures(4, 4, 1.4, 1, 3, 2, 2),
    "parallelogram": Figures(3, 3, 2.2, 1, 3, 2, 1),
    "bricard": Figures(5, 5, 5.0, 2, 6, 4, 1),
    "andrews": Figures(7, 7, 0.21023, 3, 9, 6, 1),
    "four_bar": Figures(3, 3, 4.25, 1, 3, 2, 1),
    "n_four_bar": Figures(5, 5, 5.0, 2, 6, 4, 1),
    "chain": Figures(10, 10, 10.0, 0, 0, 0, 10),
    "pendulum": Figures(1, 1, 1.0, 0, 0, 0, 1),
    "sleigh": Figures(4, 3, 1.0, 0, 0, 0, 3),
    "unicycle": Figures(4, 4, 2.0, 0, 0, 0, 4),
    "rolling_disc": Figures(7, 6, 0.5, 0, 0, 0, 6),
    "rolling_ball": Figures(7, 6, 0.5, 0, 0, 0, 6),
    "free_ball": Figures(7, 6, 1.0, 0, 0, 0, 6),
    "free_box": Figures(7, 6, 1.0, 0, 0, 0, 6),
    "painleve_rod": Figures(3, 3, 1.0, 0, 0, 0, 3),
}

# Height of the contact frames at each posture: a sole is on the ground, a ball its radius above [m]
GROUND = {
    "talos": 0.0, "talos_full": 0.0, "g1": 0.0, "anymal_c": 0.03, "hyq": 0.02175, "go2": 0.0227,
    "cassie": 0.02,
}  # fmt: skip

# Mass that is fixed to the world: the base of an arm [kg]
FIXED = {"panda": 0.6298}

# Joints without a motor, beside the floating base: springs, rods, and what mimics another joint
PASSIVE = {"talos_full": 12, "cassie": 16}

each_robot = pytest.mark.parametrize("name", ROBOTS)


def test_every_robot_has_figures_here():
    assert set(ROBOTS) == set(cp.io.available_robots())


@each_robot
def test_size_mass_and_card(name):
    loaded, figures = robot(name), ROBOTS[name]
    assert (loaded.nq, loaded.nv, len(loaded.loops)) == (figures.nq, figures.nv, figures.loops)
    moving = sum(inertia.mass for inertia in loaded.model.inertias[1:])
    assert moving == pytest.approx(figures.mass, abs=5e-5)
    assert loaded.mass - moving == pytest.approx(FIXED.get(name, 0.0), abs=5e-5)
    assert loaded.name == name
    assert loaded.source
    assert loaded.licence
    assert loaded.postures
    assert set(loaded.actuated) <= set(loaded.joints)
    for contact in loaded.contacts:
        assert contact.frame in loaded.frames


@each_robot
def test_loops_close_at_the_first_posture(name):
    loaded, figures = robot(name), ROBOTS[name]
    scene = cp.Scene(loaded, loaded.loops)
    q, _ = scene.state()
    equations = cp.Workspace(scene).equations
    assert np.abs(equations.violation(q)).max(initial=0.0) <= CLOSED
    nominal = scene.nominal
    assert (scene.rows, nominal.rank, nominal.mobility) == (
        figures.rows, figures.rank, figures.mobility,
    )  # fmt: skip
    assert np.linalg.matrix_rank(equations.jacobian(q), tol=1e-9) == figures.rank


@pytest.mark.long
@pytest.mark.parametrize("name", ["talos_full", "g1", "cassie", "stewart", "andrews"])
def test_loading_takes_few_calls(name):
    """A tenth of a second: most have 60 000 calls, of a microsecond or two."""
    assert calls(lambda: cp.load_robot(name)) < 100_000


def test_robots_compare():
    assert robot("talos") == cp.load_robot("talos")
    assert robot("talos") != robot("solo12")
    assert robot("talos") != "talos"


def feet(loaded: cp.Robot, q: np.ndarray) -> list[pin.SE3]:
    """Return the points or surfaces of the ready-made contacts, in the world."""
    data = loaded.model.createData()
    pin.forwardKinematics(loaded.model, data, q)
    found = []
    for contact in loaded.contacts:
        joint, placement = loaded.frame(contact.frame)
        offset = np.array(getattr(contact, "offset", (0, 0, 0)), dtype=float)
        found.append(data.oMi[joint] * placement * pin.SE3(np.eye(3), offset))
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", GROUND)
def test_feet_stand_on_the_ground(name):
    loaded = robot(name)
    scene = cp.Scene(loaded, (*loaded.loops, *loaded.contacts))
    for posture in loaded.postures:
        heights = [foot.translation[2] for foot in feet(loaded, scene.state(posture)[0])]
        assert np.allclose(heights, GROUND[name], rtol=0, atol=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("name", GROUND)
def test_every_foot_pushes_at_the_first_posture(name):
    """The smallest forces that balance the weight are all upwards: none has to hold it down."""
    loaded = robot(name)
    scene = cp.Scene(loaded, loaded.contacts)
    q, v = scene.state()
    terms = cp.Workspace(scene).terms(q, v)
    lam = np.linalg.lstsq(terms.J[:, :6].T, terms.h[:6], rcond=None)[0]
    solution = cp.solve(scene, q, v, terms.h - terms.J.T @ lam)
    assert np.abs(solution.a).max() < 1e-8
    forces = np.array([force[:3] for force in solution.world_forces.values()])
    assert (forces[:, 2] > 0.15 * 9.81 * loaded.mass / len(forces)).all()
    assert np.allclose(forces.sum(axis=0), [0, 0, 9.81 * loaded.mass], atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("name", GROUND)
def test_every_joint_but_the_base_has_a_motor(name):
    loaded = robot(name)
    passive = loaded.nv - 6 - len(loaded.actuated)
    assert passive == PASSIVE.get(name, 0)


@pytest.mark.long
def test_fingers_of_the_panda_can_be_coupled():
    panda = robot("panda")
    fingers = cp.constraints.Coupling("panda_finger_joint2", "panda_finger_joint1")
    scene = cp.Scene(panda, [fingers, *panda.contacts])
    q, v = scene.state()
    assert scene.nominal.mobility == 2
    a = cp.solve(scene, q, v, np.r_[np.zeros(7), 1.0, 0.0], solver=cp.DenseKKT()).a
    assert a[-1] == pytest.approx(a[-2], rel=1e-12)
    assert a[-1] > 1


@pytest.mark.long
def test_g1_stands_over_its_feet():
    g1 = robot("g1")
    q = g1.postures["standing"]
    com = pin.centerOfMass(g1.model, g1.model.createData(), q)
    for foot, contact in zip(feet(g1, q), g1.contacts, strict=True):
        assert abs(com[0] - foot.translation[0]) < contact.half_length / 4
        assert np.allclose(foot.rotation, np.eye(3), atol=1e-9)


def test_a_robot_with_massless_fingers_is_refused():
    romeo = example_robot_data() / "romeo_description" / "urdf" / "romeo.urdf"
    with pytest.raises(cp.errors.InvalidModel, match="no inertia moves with LFinger"):
        cp.load_robot(romeo, root_joint="free_flyer")
