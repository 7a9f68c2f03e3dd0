"""Every kind of joint in a floating tree: derivatives against those in 50 digits.

    da ~ (a(q + h dq, v + h dv) - a(q - h dq, v - h dv)) / 2 h,    h = 1e-15

The oracle shares neither formulas nor code with the library or with Pinocchio. What it finds is in
`turning.json`, written by `python tests/test_turning.py`; with --long it is found anew.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from oracle import Oracle, exact, mp, of_quaternion
from shared import each_row

import condyn_pin as cp
from condyn_pin._core.models import joints_with_turning_axes

FOUND = Path(__file__).with_name("turning.json")
OBLIQUE = np.array([0.6, 0.0, 0.8])
PLACE = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.2, 0.1, -0.3]))

CONTINUOUS = """<robot name="one"><link name="a"/><link name="b"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0.6 0 0.8"/></joint>
</robot>"""


def composite(*parts):
    made = pin.JointModelComposite()
    for part in parts:
        made.addJoint(part, PLACE)
    return made


def made(name: str):
    """One of Pinocchio's joints by its name, or one that is made of them."""
    kind = getattr(pin, f"JointModel{name}", None)
    if name == "RevoluteUnboundedUnaligned":  # only a description can say its axis
        return pin.buildModelFromXML(CONTINUOUS).joints[1]
    if name in ("RevoluteUnaligned", "PrismaticUnaligned"):
        return kind(*OBLIQUE.tolist())
    if name == "HelicalUnaligned":
        return kind(*OBLIQUE.tolist(), 0.3)
    if name in ("HX", "HY", "HZ"):
        return kind(0.3)
    if name == "Universal":
        return kind(OBLIQUE, np.array([0.0, 1.0, 0.0]))
    if name == "Ellipsoid":
        return kind(0.3, 0.5, 0.7)
    if name == "Composite":
        return composite(pin.JointModelRY(), pin.JointModelPX(), made("SphericalZYX"))
    if name == "composite of composites":
        inner = composite(made("Ellipsoid"), made("Universal"))
        return composite(pin.JointModelRZ(), inner, made("HX"))
    if name == "composite of one":
        return composite(made("HY"))
    return kind()


# whatever kinds this Pinocchio has; a mimic joint is refused when a robot is made
NAMES = {name.removeprefix("JointModel") for name in dir(pin) if name.startswith("JointModel")}
KINDS = [*sorted(NAMES - {"", "Mimic"}), "composite of composites", "composite of one"]

QUESTIONS = {
    f"{name}-{closure}": (name, closure == "loop") for name in KINDS for closure in ("tree", "loop")
}
each_question = pytest.mark.parametrize("label", QUESTIONS)

TURNING = {"SphericalZYX", "Universal", "Ellipsoid", "Composite", "composite of composites"}


def floating(name: str, root=None) -> cp.Robot:
    """A free body with one joint of a kind and a hinge behind it, and another arm."""
    model, rng = pin.Model(), np.random.default_rng(5)

    def add(parent, joint, name):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), 0.5 * rng.normal(size=3))
        number = model.addJoint(parent, joint, place, name)
        body = pin.Inertia.FromBox(1.0 + rng.random(), 0.3, 0.4, 0.5)
        model.appendBodyToJoint(number, body, place)
        return number

    base = add(0, root or pin.JointModelFreeFlyer(), "base")
    arm = add(add(base, made(name), "odd"), pin.JointModelRX(), "last")
    other = add(base, pin.JointModelRZ(), "other")
    for frame, joint in (("hand", arm), ("foot", other)):
        model.addFrame(pin.Frame(frame, joint, 0, PLACE, pin.FrameType.OP_FRAME))
    model.armature = rng.uniform(0.01, 0.1, model.nv)
    return cp.Robot(name, model)


def state(model, seed: int = 0):
    rng = np.random.default_rng(seed)
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    return q, rng.normal(size=model.nv), rng.normal(size=model.nv)


def moved(model, q, step) -> np.ndarray:
    """q moved along a tiny step, right to its first order and symmetric in it, in 50 digits."""
    q, out = exact(q), exact(q)
    for joint in list(model.joints)[1:]:
        kind = joint.shortname().removeprefix("JointModel")
        at, by = joint.idx_q, step[joint.idx_v : joint.idx_v + joint.nv]
        if kind in ("FreeFlyer", "Spherical"):
            start = at + 3 * (kind == "FreeFlyer")
            x, y, z, w = q[start : start + 4]
            a, b, c = by[-3:] / 2
            out[start : start + 4] = (
                x + w * a + y * c - z * b, y + w * b + z * a - x * c,
                z + w * c + x * b - y * a, w - x * a - y * b - z * c,
            )  # fmt: skip
            if kind == "FreeFlyer":
                out[at : at + 3] = q[at : at + 3] + of_quaternion(q[start : start + 4]) @ by[:3]
        elif kind == "Planar":
            c, s = q[at + 2 : at + 4]
            out[at : at + 2] += np.array([c * by[0] - s * by[1], s * by[0] + c * by[1]])
            out[at + 2 : at + 4] = c - s * by[2], s + c * by[2]
        elif joint.nq == 2 and joint.nv == 1:
            c, s = q[at : at + 2]
            out[at : at + 2] = c - s * by[0], s + c * by[0]
        else:
            out[at : at + joint.nq] += by
    return out


def in_many_digits(scene, q, v, tau, steps):
    """The change of (a, lam) along steps of q, v and tau."""
    oracle, h = Oracle(scene), mp.mpf(10) ** -15
    dq, dv, dtau = (h * exact(step) for step in steps)
    q, v, tau = exact(q), exact(v), exact(tau)
    ends = [
        np.concatenate(
            oracle.solve(moved(scene.robot.model, q, s * dq), v + s * dv, tau + s * dtau)
        )
        for s in (1, -1)
    ]
    return ((ends[0] - ends[1]) / (2 * h)).astype(float)


@pytest.mark.long
@pytest.mark.parametrize("name", KINDS)
def test_which_joints_turn_is_read_off_their_axes(name):
    model = floating(name).model
    assert joints_with_turning_axes(model) == ((2,) if name in TURNING else ())


def question(label: str):
    """A scene, a state of it, and a step of q, v and tau."""
    name, looped = QUESTIONS[label]
    scene = cp.Scene(floating(name), [cp.Loop("hand", "foot")] if looped else [])
    steps = np.random.default_rng(1).normal(size=(3, scene.robot.nv))
    return scene, state(scene.robot.model), steps


def oracle_answer(label: str) -> np.ndarray:
    scene, (q, v, tau), steps = question(label)
    return in_many_digits(scene, q, v, tau, steps)


@functools.cache
def found_before() -> dict[str, list[float]]:
    return json.loads(FOUND.read_text())


@each_question
def test_derivatives_of_every_kind_are_those_in_50_digits(label):
    scene, (q, v, tau), steps = question(label)
    wanted = np.array(found_before()[label])
    found = cp.Workspace(scene).derivatives(q, v, tau).jvp(*steps)
    assert np.abs(np.concatenate(found) - wanted).max() < 1e-10 * np.abs(wanted).max()


@pytest.mark.long
@each_question
def test_the_oracle_still_finds_them(label):
    """To the rounding of the state, which may be another one on another processor."""
    wanted = np.array(found_before()[label])
    assert np.abs(oracle_answer(label) - wanted).max() < 1e-12 * np.abs(wanted).max()


@each_row("name", sorted(TURNING))
def test_pinocchios_own_derivatives_are_refused_where_axes_turn(name):
    scene = cp.Scene(floating(name))
    with pytest.raises(cp.errors.UnsupportedConstraint, match=r"'odd'.*axes turn"):
        cp.derivatives(scene, *state(scene.robot.model), method="pinocchio")


def held(name: str):
    """The same tree with one hand on the ground, and a state that keeps it there."""
    scene = cp.Scene(floating(name), [cp.PointContact("hand")])
    q, v, _ = state(scene.robot.model, seed=3)
    return scene, q, cp.mechanism.project_velocity(scene, q, 0.3 * v)


@pytest.mark.values
@pytest.mark.parametrize(
    "integrator", [cp.simulation.Rattle(), cp.simulation.Shake()], ids=lambda each: each.title
)
@pytest.mark.parametrize("name", KINDS)
def test_momentum_is_that_of_every_kind_of_joint(name, integrator):
    """Half the step, a quarter of the error, against Dormand and Prince's method."""
    scene, q, v = held(name)
    wanted = cp.simulate(
        scene, q, v, duration=0.02, dt=0.02, integrator=cp.simulation.DormandPrince()
    )
    errors = []
    for dt in (0.002, 0.001):
        found = cp.simulate(scene, q, v, duration=0.02, dt=dt, integrator=integrator)
        assert found.status.ok
        assert found.violation.max() < 1e-11
        gap = pin.difference(scene.robot.model, wanted.q[-1], found.q[-1])
        errors.append([np.linalg.norm(gap), np.linalg.norm(found.v[-1] - wanted.v[-1])])
    (q_error, v_error), (q_half, v_half) = errors
    assert 3.5 < q_error / q_half < 4.5
    assert (
        v_half < (1 if integrator == cp.simulation.Shake() else 0.3) * v_error
    )  # one has no projection
    assert q_half < 2e-3


@pytest.mark.parametrize("name", ["Universal", "SphericalZYX", "Ellipsoid", "Composite"])
def test_energy_of_turning_axes_is_kept_to_the_order_of_the_method(name):
    """Where nothing but one such joint moves, without weight."""
    model = pin.Model()
    joint = model.addJoint(0, made(name), PLACE, "joint")
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.2, 0.3, 0.5), PLACE)
    scene = cp.Scene(cp.Robot("one", model))
    q, v = np.full(model.nq, 0.3), np.full(model.nv, 0.5)
    errors = []
    for dt in (4e-3, 2e-3):
        found = cp.simulate(
            scene, q, v, duration=1.0, dt=dt, integrator=cp.simulation.Rattle(), gravity=False
        )
        errors.append(np.abs(found.energy.error).max() / found.energy.kinetic[0])
    assert errors[0] < 1e-4
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("integrator", sorted(cp.simulation.INTEGRATORS))
@pytest.mark.parametrize("name", sorted(TURNING))
def test_every_integrator_goes_where_the_others_go(name, integrator):
    scene, q, v = held(name)
    wanted = cp.simulate(
        scene, q, v, duration=0.02, dt=0.02, integrator=cp.simulation.DormandPrince()
    )
    found = cp.simulate(
        scene, q, v, duration=0.02, integrator=cp.simulation.INTEGRATORS[integrator]()
    )
    assert found.status.ok
    gap = pin.difference(scene.robot.model, wanted.q[-1], found.q[-1])
    assert np.abs(gap).max() < 1e-3
    assert np.abs(found.v[-1] - wanted.v[-1]).max() < 2e-2


if __name__ == "__main__":
    lines = [f"{json.dumps(label)}: {oracle_answer(label).tolist()}" for label in QUESTIONS]
    FOUND.write_text("{\n" + ",\n".join(lines) + "\n}\n")
