"""ConstrainedABA and PV: compiled, for bodies that are held at the world."""

from __future__ import annotations

import sys

import numpy as np
import pinocchio as pin
import pytest
from shared import SOLVED, all_scenes, each_of, relative, states, truth, unsupported_constraints

import condyn_pin as cp
from condyn_pin._core.compiled import constrained_aba, missing_constrained_aba
from condyn_pin.dynamics import PV, ConstrainedABA
from condyn_pin.dynamics.compiled import CompiledMethod

each_kind = pytest.mark.parametrize("kind", [ConstrainedABA, PV])
HELD = [
    label
    for label, scene in all_scenes().items()
    if not unsupported_constraints(scene, ConstrainedABA())
]


@each_kind
def test_without_the_module_the_line_that_installs_it_is_named(kind, monkeypatch):
    monkeypatch.setitem(sys.modules, "condyn_pin_native._constrained_aba", None)
    for asked in (constrained_aba, missing_constrained_aba):
        monkeypatch.setattr(f"condyn_pin._core.compiled.{asked.__name__}", asked.__wrapped__)
        asked.cache_clear()
    try:
        assert "pip install ./native" in kind.missing()
        with pytest.raises(cp.errors.MissingExtra, match=r"pip install \./native"):
            cp.Workspace(all_scenes()["talos contacts"], kind())
    finally:
        for asked in (constrained_aba, missing_constrained_aba):
            asked.cache_clear()


@each_kind
@pytest.mark.parametrize(
    ("label", "name"),
    [("cassie loops", "left-"), ("talos foot to foot, welded", "left_sole_link-right_sole_link")],
)
def test_loops_are_refused_by_name(kind, label, name):
    with pytest.raises(cp.errors.UnsupportedConstraint, match="joins moving bodies") as refused:
        cp.Workspace(all_scenes()[label], kind())
    assert f"{kind.__name__} takes" in str(refused.value)
    assert all(
        loop in str(refused.value) for loop in unsupported_constraints(all_scenes()[label], kind())
    )
    assert "LCABA()" in str(refused.value)


# --- every joint that is compiled


def chain(rng: np.random.Generator) -> pin.Model:
    """A tree with every kind of joint that Python can make, three branches, on a floating base."""
    unit = np.array([1.0, 2.0, -2.0]) / 3.0
    joints = [
        pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(),
        pin.JointModelPX(), pin.JointModelPY(), pin.JointModelPZ(), pin.JointModelRUBX(),
        pin.JointModelRUBY(), pin.JointModelRUBZ(), pin.JointModelRevoluteUnaligned(unit),
        pin.JointModelPrismaticUnaligned(unit), pin.JointModelSpherical(),
        pin.JointModelSphericalZYX(), pin.JointModelPlanar(), pin.JointModelTranslation(),
        pin.JointModelHX(0.1), pin.JointModelHY(-0.2), pin.JointModelHZ(0.3),
        pin.JointModelHelicalUnaligned(unit, 0.15),
        pin.JointModelUniversal(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])),
    ]  # fmt: skip
    model, branches = pin.Model(), {7: 3, 14: 10}
    for i, joint in enumerate(joints):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.2, size=3))
        number = model.addJoint(branches.get(i, i), joint, place, f"joint {i}")
        moments = np.diag(rng.uniform(0.01, 0.02, size=3))
        model.appendBodyToJoint(
            number,
            pin.Inertia(rng.uniform(0.5, 2.0), rng.normal(scale=0.1, size=3), moments),
            place,
        )
        model.addFrame(pin.Frame(f"frame {i}", number, place, pin.FrameType.OP_FRAME))
    model.armature = rng.uniform(0.01, 0.1, size=model.nv)
    model.armature[:6] = 0.0
    return model


@pytest.mark.native
@each_kind
def test_every_joint_that_is_compiled(kind):
    """Points and welds on leaves and on a body between, two on one body, in motion."""
    rng = np.random.default_rng(2)
    model = chain(rng)
    kinds = {joint.shortname() for joint in list(model.joints)[1:]}
    assert set(constrained_aba().joints) - kinds == {"JointModelRevoluteUnboundedUnaligned"}
    robot = cp.Robot("all joints", model)
    scene = cp.Scene(
        robot,
        [
            cp.PointContact("frame 20"),
            cp.PointContact("frame 20", offset=(0.1, 0.0, 0.0), name="more"),
            cp.SurfaceContact("frame 13"),
            cp.PointContact("frame 5"),
        ],
    )
    q = pin.integrate(model, pin.neutral(model), rng.normal(scale=0.5, size=model.nv))
    v = cp.mechanism.project_velocity(scene, q, rng.normal(size=model.nv))
    tau = rng.normal(size=model.nv)
    right = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference())
    found = cp.solve(scene, q, v, tau, solver=kind())
    assert relative(found.a, right.a) < 1e-9
    assert relative(found.lam, right.lam) < 1e-7


@pytest.mark.long
@pytest.mark.native
@each_kind
def test_a_joint_that_is_not_compiled_is_refused_by_name(kind):
    model, composite = pin.Model(), pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX(), pin.SE3.Identity())
    composite.addJoint(pin.JointModelRY(), pin.SE3.Identity())
    number = model.addJoint(0, composite, pin.SE3.Identity(), "wrist")
    model.appendBodyToJoint(number, pin.Inertia.Random(), pin.SE3.Identity())
    scene = cp.Scene(cp.Robot("one", model), [])
    with pytest.raises(cp.errors.UnsupportedBackend, match=r"'wrist'.*JointModelComposite"):
        cp.Workspace(scene, kind())


# --- hard numbers


@pytest.mark.pairs
@pytest.mark.native
@each_kind
@each_of(HELD)
@pytest.mark.parametrize("exponent", [-16, -8, -4, 0, 3])
def test_what_says_ok_is_right_whatever_mu_is(kind, label, exponent):
    for sweeps in (1, 3, 20):
        solver = kind(mu=10.0**exponent, max_iterations=sweeps)
        workspace = cp.Workspace(all_scenes()[label], solver)
        for state, right in zip(states(label), truth(label), strict=True):
            found = workspace.solve(*state, throw=False)
            assert not found.status.ok or relative(found.a, right.a) < SOLVED


@pytest.mark.long
@pytest.mark.native
def test_without_mu_redundant_rows_are_singular():
    label = "talos foot held twice"
    found = cp.solve(all_scenes()[label], *states(label)[0], solver=PV(mu=0.0), throw=False)
    assert found.status in (cp.Status.SINGULAR, cp.Status.INACCURATE)
    independent = all_scenes()["talos contacts"]
    exact = cp.solve(independent, *states("talos contacts")[0], solver=PV(mu=0.0))
    assert relative(exact.a, truth("talos contacts")[0].a) < 1e-11
    with pytest.raises(cp.InvalidArgument, match="mu = 0"):
        ConstrainedABA(mu=0.0)


@pytest.mark.native
@pytest.mark.parametrize("decades", [2.0, 4.0, 6.0, 8.0])
@each_kind
def test_wide_masses_are_right_or_not_ok(kind, decades):
    """A leg of links that are ever lighter, or ever heavier, on a weld and a point."""
    for sign in (-1.0, 1.0):
        model, place = pin.Model(), pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.2]))
        joint, made = 0, (pin.JointModelFreeFlyer, *[pin.JointModelRX, pin.JointModelRY] * 3)
        for i, joint_kind in enumerate(made):
            mass = 10.0 ** (sign * decades * (i / (len(made) - 1) - 0.5))
            joint = model.addJoint(joint, joint_kind(), place, f"joint {i}")
            ball = pin.Inertia.FromSphere(mass, 0.05)
            model.appendBodyToJoint(joint, ball, pin.SE3.Identity())
            model.addFrame(pin.Frame(f"frame {i}", joint, place, pin.FrameType.OP_FRAME))
        robot = cp.Robot("leg", model)
        scene = cp.Scene(robot, [cp.SurfaceContact("frame 6"), cp.PointContact("frame 0")])
        rng = np.random.default_rng(3)
        workspace = cp.Workspace(scene, kind())
        reference = cp.Workspace(scene, cp.dynamics.Reference())
        for _ in range(3):
            q, v = scene.sample(rng)
            tau = workspace.terms(q, v).M @ rng.normal(size=model.nv)
            found = workspace.solve(q, v, tau, throw=False)
            right = reference.solve(q, v, tau, throw=False)
            if found.status.ok and right.status.ok:
                assert relative(found.a, right.a) < SOLVED


# --- Pinocchio's own driver, and what is cured of it


def compiled(name: str, label: str, **settings: float) -> CompiledMethod:
    workspace = cp.Workspace(all_scenes()[label])
    constraints = workspace.pinocchio_constraints.constraints
    return CompiledMethod(name, workspace.model, constraints, None, **settings)


@pytest.mark.native
def test_trap_constrained_aba_of_pinocchio_lives_on_the_call_before():
    """Two sweeps from what another call left are not those from another; NaN stays for good."""
    first, second, *_ = states("talos contacts")
    settings = {"mu": 1e-5, "accuracy": 0.0, "limit": 3}
    shipped = compiled("pinocchio::constrainedABA", "talos contacts", **settings)
    shipped.acceleration(*second)
    one = shipped.acceleration(*first)
    two = shipped.acceleration(*first)
    assert np.abs(one - two).max() > 1e-12
    shipped.acceleration(first[0], first[1], np.nan * first[2])
    assert np.isnan(shipped.acceleration(*first)).all()
    ours = compiled("ConstrainedABA", "talos contacts", **settings)
    ours.acceleration(*second)
    fresh = ours.acceleration(*first)
    ours.acceleration(first[0], first[1], np.nan * first[2])
    assert np.array_equal(ours.acceleration(*first), fresh)


@pytest.mark.native
@pytest.mark.parametrize("label", ["talos contacts", "talos corners", "solo12 contacts"])
def test_all_that_is_compiled_agrees_with_reference(label):
    redundant = bool(all_scenes()[label].nominal.redundant)
    for name in constrained_aba().methods:
        if name == "pinocchio::aba":
            continue
        dense = name.startswith("Dense")
        mu = (1e-9 if redundant else 0.0) if dense else 1e-5
        method = compiled(name, label, mu=mu, accuracy=1e-12, limit=50)
        for state, right in zip(states(label), truth(label), strict=True):
            assert relative(method.acceleration(*state), right.a) < 1e-6, name


@pytest.mark.long
@pytest.mark.native
def test_the_border_refuses_what_does_not_fit():
    method = compiled("PV", "talos contacts", mu=1e-9, accuracy=1e-9, limit=5)
    q, v, tau = states("talos contacts")[0]
    a = np.empty(len(v))
    for wrong in ((q[:-1], v, tau, a), (q, v[:5], tau, a), (q, v, tau[:0], a), (q, v, tau, a[1:])):
        with pytest.raises(ValueError, match="of another size"):
            method.bound.solve(*wrong)
    with pytest.raises(ValueError, match="one number for each row"):
        method.bound.lam(np.empty(11))
    with pytest.raises(ValueError, match="no such method"):
        compiled("Fastest", "talos contacts", mu=1e-9, accuracy=1e-9, limit=5)
    strided = np.repeat(q, 2)[::2]
    assert np.array_equal(method.acceleration(strided, v, tau), method.acceleration(q, v, tau))


@pytest.mark.long
@pytest.mark.native
def test_many_states_are_each_answered_as_one():
    method = compiled("ConstrainedABA", "talos contacts", mu=1e-5, accuracy=1e-10, limit=50)
    Q, V, TAU = (np.array(x) for x in zip(*states("talos contacts"), strict=True))
    A = method.many(Q, V, TAU)
    for a, state in zip(A, states("talos contacts"), strict=True):
        assert np.array_equal(a, method.acceleration(*state))
