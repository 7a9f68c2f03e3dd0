"""Round friction cones in whole-body control, and notices of forces on the edge of theirs."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone, RoundCone, WrenchCone
from condyn_pin.control import CenterOfMass, Controller, Hierarchy, Orientation, Posture

pytest.importorskip("proxsuite")

MU = 0.5


@functools.cache
def solo() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    made = robot("solo12")
    scene = cp.Scene(made, made.contacts)
    return (scene, *scene.state("standing"))


def pushing(acceleration, weight: float = 100.0) -> list:
    """Tasks of a robot whose centre of mass is to accelerate."""
    still = np.zeros(3)
    return [
        CenterOfMass(
            kp=0.0, kd=0.0, weight=weight,
            reference=lambda t: (still, still, np.array(acceleration, dtype=float)),
        ),
        Orientation("base_link", weight=50.0),
        Posture(weight=0.1),
    ]  # fmt: skip


def answer_of(cone, acceleration):
    scene, q, v = solo()
    return Controller(scene, pushing(acceleration), cones=cone).solve(q, v)


def cost(answer) -> float:
    """What the program makes least, the regularisation included [m^2/s^4]."""
    weights = {"CenterOfMass": 100.0, "Orientation": 50.0, "Posture": 0.1}
    tasks = pushing((0, 0, 0))
    named = {task.name: weights[type(task).__name__] for task in tasks}
    found = sum(named[name] * error @ error for name, error in answer.errors.items())
    mass = answer.scene.robot.mass
    least = answer.a @ answer.a + answer.lam @ answer.lam / mass**2
    return float(found + 1e-5 * least)


PUSHES = {"along": (7.0, 0.0, 0.0), "diagonal": (6.0, 6.0, 0.0), "between": (8.0, 3.0, 0.0)}


@pytest.mark.parametrize("push", PUSHES.values(), ids=list(PUSHES))
def test_a_round_cone_is_between_its_pyramids(push):
    """Pyramids of k sides within and around it are off by 1 - cos(pi / k): cost by 1 / k^2."""
    pytest.importorskip("clarabel")
    exact = answer_of(RoundCone(MU), push)
    assert exact.status.ok
    assert exact.residuals.kkt < 1e-10
    gaps = []
    for sides in (32, 64):
        inner, outer = (
            cost(answer_of(FrictionCone(MU, sides=sides, pyramid=kind), push))
            for kind in ("inner", "outer")
        )
        assert outer * (1 - 1e-9) <= cost(exact) <= inner * (1 + 1e-9)
        gaps.append(inner - outer)
    assert gaps[1] < gaps[0] / 3
    # on its surface to rounding: a foot that slides next is named
    margins = [margin.slips / exact.scene.robot.mass for margin in exact.margins.values()]
    assert min(margins) == pytest.approx(0.0, abs=1e-9)
    assert any(row.endswith(": slips") for row in exact.active)
    # and the machine moves so under these torques
    scene, q, v = solo()
    forward = cp.solve(scene, q, v, exact.tau)
    assert forward.a == pytest.approx(exact.a, abs=1e-6)


def test_friction_has_no_direction():
    """Axes of the floor turn with the world: a pyramid answers otherwise, a round cone does not."""
    pytest.importorskip("clarabel")
    lengths = {}
    for cone in (RoundCone(MU), FrictionCone(MU)):
        found = []
        for angle in (0.0, 45.0):
            turned = np.radians(angle)
            push = 20 * np.array([np.cos(turned), np.sin(turned), 0.0])
            answer = answer_of(cone, push)
            forces = np.array([force.in_world() for force in answer.forces.values()])
            tangential = np.hypot(*forces[:, :2].sum(axis=0))
            found.append(tangential / forces[:, 2].sum())
        lengths[type(cone).__name__] = found
    assert lengths["RoundCone"] == pytest.approx([MU, MU], rel=1e-3)  # feet differ a little
    # a pyramid within it has mu / sqrt(2) along its axes
    assert lengths["FrictionCone"] == pytest.approx([MU / np.sqrt(2), MU], rel=1e-3)


def test_ticks_begin_from_the_cones_of_the_last_one():
    pytest.importorskip("clarabel")
    scene, q, v = solo()
    controller = Controller(scene, pushing((6.0, 6.0, 0.0)), cones=RoundCone(MU))
    first, again = controller.solve(q, v), controller.solve(q, v)
    assert first.path[0] == "clarabel"
    assert again.path[0] == "last cones"
    assert "clarabel" not in again.path
    assert again.tau == pytest.approx(first.tau, abs=1e-9)
    moved = controller.solve(q, 0.01 * np.ones(scene.robot.nv))
    assert moved.status.ok


def test_what_round_cones_contradict_is_named():
    pytest.importorskip("clarabel")
    scene, q, v = solo()
    pulled = Controller(scene, pushing((0, 0, -11.0), weight=np.inf), cones=RoundCone(MU))
    found = pulled.solve(q, v)
    assert found.status == cp.control.ControlStatus.INFEASIBLE
    assert found.infeasible is not None
    assert any("CenterOfMass" in each.row for each in found.infeasible.gives)


def test_round_cones_are_refused_where_programs_are_quadratic():
    pytest.importorskip("clarabel")
    scene, q, v = solo()
    tasks, cone = pushing((0, 0, 0)), RoundCone(MU)
    stands = Controller(scene, tasks, cones=cone)
    refused = [
        ("Hierarchy", lambda: Controller(scene, Hierarchy(tasks[:1], tasks[1:]), cones=cone)),
        ("second-order", lambda: stands.program(q, v)),
        ("RoundCone", lambda: cp.control.support_polygon(scene, q, cone)),
        ("RoundCone", lambda: cp.control.push_bound(scene, q, (1, 0, 0), cones=cone)),
    ]
    for text, call in refused:
        with pytest.raises(cp.InvalidArgument, match=text):
            call()
    with pytest.raises(cp.InvalidArgument, match="WrenchCone"):
        cone.fitted(robot("talos").contacts[0])
    without = Controller(scene, tasks, cones=RoundCone(0.0)).solve(q, v)
    forces = np.array([force.in_world() for force in without.forces.values()])
    assert np.abs(forces[:, :2]).max() < 1e-9


# --- notices of edges ----------------------------------------------------------------------------


def test_feet_on_the_edge_of_friction_are_named():
    inside = answer_of(FrictionCone(MU, sides=8), (0.0, 0.0, 0.0))
    assert inside.notices == ()
    sliding = answer_of(FrictionCone(MU, sides=8), (20.0, 0.0, 0.0))
    (notice, *_) = sliding.notices
    assert notice.startswith("forces on the edge of their cones: ")
    assert "FL_FOOT nearly slips at 0 deg" in notice


@pytest.mark.native(optional=True)
def test_a_robot_on_its_toes_has_its_zmp_on_the_edge(monkeypatch):
    """Thrown ahead more than its feet are long, Talos presses with the front edge of its soles."""
    monkeypatch.delenv("CONDYN_ENGINE")
    talos = robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state()
    still = np.zeros(3)
    tasks = [
        CenterOfMass(kp=0.0, kd=0.0, weight=100.0,
                     reference=lambda t: (still, still, np.array([-4.0, 0.0, 0.0]))),
        Orientation("base_link", weight=50.0),
        Posture(weight=0.1),
    ]  # fmt: skip
    for engine in ("python", "auto"):
        answer = Controller(scene, tasks, cones=WrenchCone(0.8), engine=engine).solve(q, v)
        assert answer.status.ok
        notices = "\n".join(answer.notices)
        assert "tips over" in notices
        assert "the centre of pressure (ZMP) is on the edge of the support" in notices
        state = cp.control.balance(scene, q, v, answer.a, lam=answer.lam)
        assert state.zmp_margin == pytest.approx(0.0, abs=1e-3)  # its soles lean by 2e-3 rad
