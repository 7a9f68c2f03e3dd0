"""Derivatives of every kind of constraint, against central differences and Pinocchio's own."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest
from motions import body
from shared import BLOCKS, DERIVATIVES, all_scenes, central, each_row, each_scene, robot, states

import condyn_pin as cp
from condyn_pin.dynamics.derivatives import METHODS
from condyn_pin.dynamics.derivatives.others import check_derivatives

ROOTS = {
    "revolute": pin.JointModelRY,
    "prismatic": pin.JointModelPX,
    "spherical": pin.JointModelSpherical,
    "free_flyer": pin.JointModelFreeFlyer,
}

CONSTRAINTS = {
    "point": cp.PointContact("a", offset=(0.1, 0.0, 0.2)),
    "anchored point": cp.PointContact("a", anchor=(0.2, 0.1, 0.3)),
    "surface": cp.SurfaceContact("a"),
    "anchored surface": cp.SurfaceContact("a", anchor=(0.2, 0.1, 0.3, 0.1, 0.2, 0.3, 0.9)),
    "line": cp.constraints.LineContact("a", "y"),
    "anchored line": cp.constraints.LineContact("a", anchor=(0.2, 0.1, 0.3, 0.1, 0.2, 0.3, 0.9)),
    "plane": cp.constraints.PlanarContact("a", normal=(0.1, 0.2, 1.0)),
    "anchored plane": cp.constraints.PlanarContact("a", normal=(0.1, 0.2, 1.0), height=0.4),
    "ball": cp.Loop("a", "b"),
    "ball on the world": cp.Loop("place", "b"),
    "weld": cp.Loop("a", "b", "weld"),
    "weld on the world": cp.Loop("place", "a", "weld"),
    "hinge": cp.Loop("a", "b", "hinge", axis="x"),
    "hinge on the world": cp.Loop("place", "a", "hinge", axis="z"),
    "slider": cp.Loop("a", "b", "slider", axis="y"),
    "slider on the world": cp.Loop("place", "b", "slider", axis="z"),
    "planar": cp.Loop("a", "b", "planar", axis="z"),
    "rod": cp.Loop("a", "b", "rod", length=0.9),
    "rod on the world": cp.Loop("place", "b", "rod", length=0.9),
    "coupling": cp.constraints.Coupling("a2", "b1", 0.7, 0.1),
}


@functools.cache
def two_arms(root: str) -> cp.Robot:
    """Two arms of six hinges, in three dimensions, on one body."""
    model, rng = pin.Model(), np.random.default_rng(0)
    body = model.addJoint(0, ROOTS[root](), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(body, pin.Inertia.FromBox(3.0, 0.3, 0.4, 0.2), pin.SE3.Identity())
    for arm in "ab":
        parent = body
        for i in range(6):
            placed = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.4, 0.4, 3))
            parent = model.addJoint(parent, pin.JointModelRZ(), placed, f"{arm}{i}")
            off = pin.SE3(np.eye(3), rng.uniform(-0.1, 0.1, 3))
            model.appendBodyToJoint(parent, pin.Inertia.FromBox(1.0, 0.1, 0.2, 0.3), off)
        tip = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.3, 0.3, 3))
        model.addFrame(pin.Frame(arm, parent, 0, tip, pin.FrameType.OP_FRAME))
    made = cp.Robot(f"two_arms_{root}", model)
    return made.with_frame("place", "world", (0.3, 0.2, 0.4), pin.rpy.rpyToMatrix(0.1, 0.2, 0.3))


PULLED = cp.Baumgarte(3.0, 5.0)


@pytest.mark.pairs
@pytest.mark.parametrize(
    ("closed", "moving", "drift"),
    [
        (True, True, None),
        (True, False, None),
        (False, True, None),
        (False, False, None),
        (False, True, PULLED),
        (True, True, PULLED),
    ],
)
@pytest.mark.parametrize("kind", list(CONSTRAINTS))
@pytest.mark.parametrize("root", list(ROOTS))
def test_every_block_of_every_kind(root, kind, closed, moving, drift):
    """To 1e-8 of the largest entry, on the constraints and off them."""
    scene = cp.Scene(two_arms(root), [CONSTRAINTS[kind]])
    rng = np.random.default_rng(1)
    if closed:
        q, v = scene.sample(rng)
    else:
        q = pin.integrate(
            scene.robot.model, cp.dynamics.described_posture(scene), rng.normal(size=scene.robot.nv)
        )
        v = rng.normal(size=scene.robot.nv)
    v, tau = moving * v, rng.normal(size=scene.robot.nv)
    workspace = cp.Workspace(scene, cp.dynamics.Reference(refinements=0), drift=drift)
    found = workspace.derivatives(q, v, tau)
    model, zero = scene.robot.model, np.zeros(scene.robot.nv)

    def answer(dq, dv, dtau):
        moved = pin.integrate(model, q, dq)
        solution = workspace.solve(moved, v + dv, tau + dtau, throw=False)
        return np.concatenate([solution.a, solution.lam])

    for block in range(3):  # by q, v and tau
        step = [zero, zero, zero]
        step[block] = rng.normal(size=scene.robot.nv)
        assert_along(answer, step, found.jvp(*step), 1e-8)


def assert_along(answer, step, found, within):
    """Compare (da, dlam) along a direction with differences of (a, lam), at one of three steps."""
    cut = len(found[0])
    left = [*zip(found, (slice(cut), slice(cut, None)), strict=True)]
    for h in (1e-3, 3e-4, 1e-4):  # others are asked only where one does not do
        wanted = central(lambda t: answer(*(t * x for x in step)), h)
        left = [
            (had, part) for had, part in left
            if not np.abs(had - wanted[part]).max() < within * max(np.abs(had).max(), 1.0)
        ]  # fmt: skip
        if not left:
            return
    raise AssertionError([np.abs(had - wanted[part]).max() for had, part in left])


@pytest.mark.parametrize("kind", list(CONSTRAINTS))
def test_rows_turn_as_differences_say(kind):
    """J w by q at a fixed w: what the smallest lam of redundant rows needs."""
    scene, rng = cp.Scene(two_arms("free_flyer"), [CONSTRAINTS[kind]]), np.random.default_rng(2)
    workspace, model = cp.Workspace(scene, cp.dynamics.Reference()), scene.robot.model
    q = pin.integrate(model, cp.dynamics.described_posture(scene), rng.normal(size=model.nv))
    w, step = rng.normal(size=(2, model.nv))
    had = workspace.linearisation.turning(q, w) @ step
    J = workspace.equations.jacobian
    wanted = central(lambda t: J(pin.integrate(model, q, t * step)) @ w, 3e-4)
    assert np.abs(had - wanted).max() < 1e-9 * max(np.abs(had).max(), 1.0)


@pytest.mark.long
@pytest.mark.parametrize("label", ["cassie loops + contacts", "four_bar hinge"])
def test_forces_of_the_last_proof_are_not_those_of_another_place(label):
    """The same arrays, written over; and the same forces elsewhere."""
    scene, ((q, v, tau), *_) = all_scenes()[label], states(label)
    workspace, fresh = cp.Workspace(scene), cp.Workspace(scene)
    q = q.copy()
    found = workspace.solve(q, v, tau)
    lam = found.lam.copy()
    q[:] = pin.integrate(scene.robot.model, q, np.full(scene.robot.nv, 0.1))
    for at in (q, found.q):
        had = workspace.linearisation.at(at, v, found.a, lam).rhs
        assert np.array_equal(had, fresh.linearisation.at(at, v, found.a, lam).rhs)
        lam *= 2.0


@pytest.mark.long
@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
def test_differences_by_torques_know_how_heavy_joints_are(mass):
    """A step of 1e-3 N m on an excavator moves nothing."""
    scene = cp.Scene(cp.model.chain(4, length=100.0, mass=mass))
    q, v = scene.sample(np.random.default_rng(1))
    found = cp.derivatives(scene, q, v, 0 * v, method="differences")
    inverse = np.linalg.inv(cp.Workspace(scene).terms(q, v).M)
    assert np.abs(found.da_dtau - inverse).max() < 1e-9 * np.abs(inverse).max()


@each_scene
def test_scenes_agree_with_differences(label):
    """With redundant rows too: along the constraints; a check that fails raises."""
    found = cp.derivatives(all_scenes()[label], *states(label)[0], check=True)
    assert all(np.isfinite(getattr(found, name)).all() for name in BLOCKS)


@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar loops"])
def test_drift_control_is_differentiated_too(label):
    scene, state = all_scenes()[label], states(label)[0]
    options = {"drift": PULLED, "check": True}
    pulled = cp.derivatives(scene, *state, **options).da_dq
    assert np.abs(pulled - cp.derivatives(scene, *state).da_dq).max() > 1e-3
    found = cp.derivatives(scene, *state, method="pinocchio", **options)
    assert np.isfinite(found.da_dq).all()


def takes_pinocchio(scene: cp.Scene) -> bool:
    return all(getattr(b, "is_plain", False) for b in scene.bounds)


@each_scene
def test_agrees_with_pinocchio_or_is_refused(label):
    scene, state = all_scenes()[label], states(label)[1]
    if not takes_pinocchio(scene):
        with pytest.raises(
            (cp.errors.UnsupportedConstraint, cp.InvalidArgument), match="method='kkt'"
        ):
            cp.derivatives(scene, *state, method="pinocchio")
        return
    ours, theirs = (cp.derivatives(scene, *state, method=m) for m in ("kkt", "pinocchio"))
    for block in BLOCKS:
        had, wanted = getattr(ours, block), getattr(theirs, block)
        size = max(np.abs(wanted).max(initial=0.0), 1.0)
        assert np.abs(had - wanted).max(initial=0.0) < 1e-9 * size, block


@pytest.mark.long
@pytest.mark.parametrize("distance", [1e-1, 1e-3])
def test_pinocchios_are_of_the_forces_of_the_scene(distance):
    """Points that are nearly one are handed to it at other places of the same foot."""
    talos, rng = robot("talos"), np.random.default_rng(0)
    foot = "left_sole_link"
    points = [cp.PointContact(foot), cp.PointContact(foot, (distance, 0, 0), name="there")]
    scene = cp.Scene(talos, points)
    state = (*scene.sample(rng), rng.normal(size=talos.nv))
    ours, theirs = (cp.derivatives(scene, *state, method=m) for m in ("kkt", "pinocchio"))
    for block in BLOCKS:
        wanted, found = (getattr(d, block) for d in (ours, theirs))
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max(), block


@pytest.mark.parametrize("method", list(METHODS))
@pytest.mark.parametrize("label", ["talos contacts", "cassie loops", "four_bar hinge"])
def test_products_are_those_of_the_matrices(label, method):
    scene, state = all_scenes()[label], states(label)[0]
    if method == "pinocchio" and not takes_pinocchio(scene):
        return
    d = cp.derivatives(scene, *state, method=method)
    rng = np.random.default_rng(2)
    dq, dv, dtau, da = rng.normal(size=(4, scene.robot.nv))
    dlam = rng.normal(size=scene.rows)
    size = np.abs(d.matrix).max() * scene.robot.nv
    moved, pulled = np.hstack(d.jvp(dq, dv, dtau)), np.hstack(d.vjp(da, dlam))
    assert np.abs(moved - d.matrix @ np.hstack((dq, dv, dtau))).max() < 1e-13 * size
    assert np.abs(pulled - np.hstack((da, dlam)) @ d.matrix).max() < 1e-13 * size
    assert np.array_equal(d.by("v"), np.vstack((d.da_dv, d.dlam_dv)))
    with pytest.raises(cp.errors.UnknownName, match="friction"):
        d.by("friction")


@pytest.mark.long
@pytest.mark.parametrize("seed", [38, 88, 131, 226])
def test_a_redundant_row_is_found_whatever_rounding_leaves_of_it(seed):
    """A point on a body that an edge holds: of its pivot more than 1e-7 was left in some states."""
    cassie, foot = robot("cassie"), "left-foot"
    scene = cp.Scene(
        cassie,
        [
            cp.PointContact(foot, (0.03, 0.05, -0.02), name="point"),
            cp.constraints.LineContact(foot),
        ],
    )
    still = np.zeros(cassie.nv)
    step = 0.3 * np.random.default_rng(seed).normal(size=cassie.nv)
    q = pin.integrate(cassie.model, cp.dynamics.described_posture(scene), step)
    found = cp.derivatives(scene, q, still, still)
    terms = cp.Workspace(scene).terms(q, still)
    L_inv = np.linalg.inv(np.linalg.cholesky(terms.M))
    smallest = -np.linalg.pinv(L_inv @ terms.J.T, rcond=1e-9) @ L_inv  # of lam by tau
    assert np.abs(found.dlam_dtau - smallest).max() < 1e-8 * np.abs(smallest).max()


@pytest.mark.parametrize(
    "how",
    [{"method": "kkt"}, {"method": "differences"}, {"solver": cp.dynamics.Soft()}],
    ids=["kkt", "differences", "soft"],
)
def test_what_is_formed_later_is_of_the_state_that_was_asked_about(how):
    """A loop that went on in the same arrays changed derivatives that it had not looked at yet."""
    scene = all_scenes()["cassie loops"]
    q, v, tau = states("cassie loops")[1]
    arrays = [x.copy() for x in (q, v, tau)]
    wanted = cp.derivatives(scene, q, v, tau, **how)
    found = cp.derivatives(scene, *arrays, **how)
    for x in arrays:
        x += 0.1
    for name in BLOCKS:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    if how.get("method") != "differences":  # has none by inertias
        for one, other in zip(found.by_inertias(), wanted.by_inertias(), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.long
def test_a_pendulum_by_hand():
    """theta'' = -(g/l) sin(theta) + tau / (m l^2)."""
    pendulum = cp.model.pendulum(length=0.5, mass=2.0)
    d = cp.derivatives(cp.Scene(pendulum), [0.7], [0.3], [0.1])
    assert d.da_dq[0, 0] == pytest.approx(-9.81 / 0.5 * np.cos(0.7), rel=1e-12)
    assert d.da_dv[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert d.da_dtau[0, 0] == pytest.approx(1 / (2.0 * 0.25), rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("drift", [None, PULLED])
@pytest.mark.parametrize("kind", [cp.PointContact, cp.SurfaceContact, cp.constraints.LineContact])
def test_a_machine_that_cannot_move_is_differentiated_and_checked(kind, drift):
    """There is no direction along the constraints, and rows are redundant."""
    crank, rng = cp.model.pendulum(), np.random.default_rng(0)
    scene = cp.Scene(crank, [kind(crank.frames[-1])])
    assert scene.nominal.redundant
    assert scene.nominal.mobility == 0
    state = (rng.normal(size=1), np.zeros(1), rng.normal(size=1))
    found = cp.derivatives(scene, *state, drift=drift, check=True)
    numeric = cp.derivatives(scene, *state, drift=drift, method="differences")
    assert not numeric.da_dq.any()
    assert np.abs(found.da_dtau).max() < 1e-12


@pytest.mark.long
def test_pinocchios_of_a_single_joint_are_columns():
    pendulum = cp.model.pendulum()
    scene = cp.Scene(pendulum, [cp.PointContact(pendulum.frames[-1])])
    state = ([0.7], [0.0], [0.1])
    ours, theirs = (cp.derivatives(scene, *state, method=m) for m in ("kkt", "pinocchio"))
    for block in BLOCKS:
        wanted, found = (getattr(d, block) for d in (ours, theirs))
        assert found.shape == wanted.shape
        assert np.abs(found - wanted).max() < 1e-9 * max(1.0, np.abs(wanted).max()), block


def test_check_finds_a_wrong_entry():
    scene, (q, v, tau) = all_scenes()["solo12 contacts"], states("solo12 contacts")[0]
    workspace = cp.Workspace(scene)
    good = workspace.derivatives(q, v, tau, check=True)
    numeric = workspace.derivatives(q, v, tau, method="differences")
    good._blocks[0][3, 5] += 1e-3 * np.abs(good.da_dq).max()
    with pytest.raises(cp.errors.DerivativesDisagree, match=r"da_dq\[3, 5\] = "):
        check_derivatives(good, numeric)


def test_trap_1_column_0_of_a_loop_on_a_turning_root():
    """Pinocchio's own is wrong there by as much as it is; both of ours agree with differences."""
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    state = states("four_bar loops")[0]
    for method in ("kkt", "pinocchio"):
        cp.derivatives(scene, *state, method=method, check=True)
    workspace = cp.Workspace(scene)
    workspace.solve(*state)
    raw = pin.computeConstraintDynamicsDerivatives(
        workspace.model,
        workspace.data,
        workspace.constraint_models,
        workspace.constraint_datas,
        workspace.proximal_settings,
    )[0]
    right = cp.derivatives(scene, *state).da_dq
    assert np.abs(raw[:, 0] - right[:, 0]).max() > 0.1 * np.abs(right).max()
    assert np.abs(raw[:, 1:] - right[:, 1:]).max() < 1e-8 * np.abs(right).max()


@pytest.mark.long
def test_results_are_owned():
    scene, (first, second, *_) = all_scenes()["talos contacts"], states("talos contacts")
    for method in ("kkt", "pinocchio"):
        workspace = cp.Workspace(scene)
        d = workspace.derivatives(*first, method=method)
        kept = [getattr(d, block).copy() for block in BLOCKS]
        workspace.derivatives(*second, method=method)
        workspace.acceleration(*second)
        for block, before in zip(BLOCKS, kept, strict=True):
            assert np.array_equal(getattr(d, block), before)


@each_row("what", ["method", "solver", "q", "dq", "dlam"])
def test_refuses(what):
    scene, (q, v, tau) = all_scenes()["talos contacts"], states("talos contacts")[0]
    if what == "method":
        with pytest.raises(cp.errors.UnknownName, match="did you mean 'pinocchio'"):
            cp.derivatives(scene, q, v, tau, method="pinochio")
        with pytest.raises(cp.errors.UnknownName, match="no method named"):
            cp.derivatives(scene, q, v, tau, method=["kkt"])
    elif what == "solver":
        with pytest.raises(cp.InvalidArgument, match=r"differentiates Proximal\(\)"):
            cp.derivatives(scene, q, v, tau, solver=cp.dynamics.Reference(), method="pinocchio")
    elif what == "q":
        with pytest.raises(cp.InvalidArgument, match="q has shape"):
            cp.derivatives(scene, q[1:], v, tau)
    else:
        d = cp.derivatives(scene, q, v, tau)
        with pytest.raises(cp.InvalidArgument, match=what):
            d.jvp(v[1:], v, tau) if what == "dq" else d.vjp(v, np.full(12, np.nan))


def close(found, numeric):
    found = np.concatenate(found)
    return np.abs(found - numeric).max() < 1e-7 * max(np.abs(numeric).max(), 1.0)


def parameters_of(kind: str, drift: cp.Baumgarte | None):
    """A robot, the state, and (a, lam) with any model of it in its place."""
    made, rng = two_arms("free_flyer"), np.random.default_rng(5)
    q = pin.integrate(made.model, pin.neutral(made.model), rng.normal(size=made.nv))
    v, tau = rng.normal(size=(2, made.nv))

    def answer(model):
        robot = cp.Robot("changed", model)
        scene = cp.Scene(robot, [CONSTRAINTS[kind]])
        solution = cp.solve(
            scene, q, v, tau, solver=cp.dynamics.Reference(refinements=0), drift=drift, throw=False
        )
        return np.concatenate([solution.a, solution.lam])

    scene = cp.Scene(made, [CONSTRAINTS[kind]])
    d = cp.derivatives(scene, q, v, tau, solver=cp.dynamics.Reference(), drift=drift)
    return made.model, answer, d, rng


@pytest.mark.values
@pytest.mark.parametrize("drift", [None, PULLED])
@pytest.mark.parametrize("kind", [kind for kind in CONSTRAINTS if kind != "coupling"])
def test_by_the_placement_of_a_frame(kind, drift):
    """A frame moved on its body, in a model made anew."""
    model, answer, d, rng = parameters_of(kind, drift)
    constraint = CONSTRAINTS[kind]
    names = (
        (constraint.frame,)
        if hasattr(constraint, "frame")
        else (constraint.frame_a, constraint.frame_b)
    )
    for which, name in zip(("first", "second"), names, strict=False):
        if name == "world":
            continue
        twist, i = rng.normal(size=6), model.getFrameId(name)
        # an offset is part of the frame that moves
        offset = pin.SE3(np.eye(3), np.array(getattr(constraint, "offset", np.zeros(3))))

        def moved(t, twist=twist, i=i, offset=offset):
            changed = pin.Model(model)
            placed = changed.frames[i].placement * offset * pin.exp6(t * twist) * offset.inverse()
            changed.frames[i].placement = placed
            return answer(changed)

        da, dlam = d.by_placement(constraint.name, which)
        assert close((da @ twist, dlam @ twist), central(moved)), which


@pytest.mark.parametrize("kind", ["surface", "ball", "rod"])
def test_by_gravity_and_inertias(kind):
    model, answer, d, rng = parameters_of(kind, None)
    direction = rng.normal(size=3)

    def pulled(t):
        changed = pin.Model(model)
        changed.gravity = pin.Motion(model.gravity.linear + t * direction, np.zeros(3))
        return answer(changed)

    da, dlam = d.by_gravity()
    assert close((da @ direction, dlam @ direction), central(pulled))
    own = [np.array(Y.toDynamicParameters()) for Y in list(model.inertias)[1:]]
    step = np.concatenate([0.1 * rng.uniform(size=1) * pi for pi in own])

    def heavier(t):
        changed = pin.Model(model)
        for i, pi in enumerate(own):
            changed.inertias[i + 1] = pin.Inertia.FromDynamicParameters(
                pi + t * step[10 * i : 10 * i + 10]
            )
        return answer(changed)

    da, dlam = d.by_inertias()
    assert close((da @ step, dlam @ step), central(heavier, 1e-3))


@pytest.mark.long
def test_one_slider_by_its_mass():
    """A = tau / m - g; of one joint Pinocchio returns a vector for the matrix of one row."""
    scene = cp.Scene(body(pin.JointModelPZ(), mass=2.0))
    da, _ = cp.derivatives(scene, [0.1], [0.3], [5.0]).by_inertias()
    assert np.allclose(da, [[-5.0 / 2.0**2, *np.zeros(9)]], rtol=0, atol=1e-14)


@each_row(
    ("name", "frame", "error", "match"),
    [
        ("a-b", "first", cp.errors.UnknownName, "did you mean 'a~b'"),
        ("a~b", "third", cp.InvalidArgument, "one of first, second"),
        ("held", "second", cp.InvalidArgument, "without an anchor"),
        ("gear", "first", cp.InvalidArgument, "has no frames"),
    ],
)
def test_by_placement_refuses(name, frame, error, match):
    constraints = [
        cp.Loop("a", "b"),
        cp.PointContact("a", name="held"),
        cp.constraints.Coupling("a2", "b1", name="gear"),
    ]
    scene = cp.Scene(two_arms("revolute"), constraints)
    d = cp.derivatives(scene, *scene.sample(np.random.default_rng(0)), np.zeros(scene.robot.nv))
    with pytest.raises(error, match=match):
        d.by_placement(name, frame)


def turning(name: str):
    """A joint whose axes turn with its own q."""
    if name != "Composite":
        axes = [np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])]
        return (
            pin.JointModelUniversal(*axes) if name == "Universal" else pin.JointModelSphericalZYX()
        )
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelRY())
    joint.addJoint(pin.JointModelPZ(), pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.ones(3)))
    joint.addJoint(pin.JointModelSphericalZYX(), pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3])))
    return joint


@pytest.mark.values
@pytest.mark.parametrize(
    "constraint",
    [
        cp.PointContact("tip"), cp.Loop("tip", "hand", "ball"),
        cp.Loop("tip", "hand", "hinge", axis="x"), cp.Loop("hand", "tip", "rod", length=0.9),
        cp.constraints.RollingBall("tip", 0.1), cp.constraints.Coupling("first", "last", 0.7),
    ],
    ids=lambda constraint: f"{type(constraint).__name__} {getattr(constraint, 'kind', '')}".strip(),
)  # fmt: skip
@pytest.mark.parametrize("name", ["SphericalZYX", "Universal", "Composite", "Ellipsoid", "nested"])
def test_joints_whose_axes_turn_with_their_own_q(name, constraint):
    """Pinocchio's own derivatives are wrong for them, those of Newton-Euler too."""
    model, rng, parent = pin.Model(), np.random.default_rng(3), 0
    for k, joint in enumerate((pin.JointModelRX(), turning(name), pin.JointModelRY())):
        placed = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.4, 0.4, 3))
        parent = model.addJoint(parent, joint, placed, ("first", "turning", "last")[k])
        model.appendBodyToJoint(parent, pin.Inertia.FromBox(2.0, 0.3, 0.4, 0.2), placed)
        model.addFrame(
            pin.Frame(("arm", "hand", "tip")[k], parent, 0, placed, pin.FrameType.OP_FRAME)
        )
    hand = model.addJoint(0, turning(name), pin.SE3.Identity(), "other")
    model.appendBodyToJoint(hand, pin.Inertia.FromBox(1.0, 0.3, 0.4, 0.2), pin.SE3.Identity())
    model.frames[model.getFrameId("hand")].parentJoint = hand
    model.armature = rng.uniform(0.01, 0.1, model.nv)
    scene = cp.Scene(cp.Robot("arm", model), [constraint])
    workspace = cp.Workspace(scene, cp.dynamics.Reference(), drift=PULLED)
    q, v, tau, *step = rng.normal(size=(6, model.nv))

    def answer(dq, dv, dtau):
        solution = workspace.solve(q + dq, v + dv, tau + dtau, throw=False)
        return np.concatenate([solution.a, solution.lam])

    assert_along(answer, step, workspace.derivatives(q, v, tau).jvp(*step), 1e-7)
    struck = cp.impact(scene, q, v)
    moved = [cp.impact(scene, q + h * step[0], v).v for h in (-1e-5, 1e-5)]
    by_q = (moved[1] - moved[0]) / 2e-5
    assert np.abs(struck.dv_dq @ step[0] - by_q).max() < 1e-7 * max(np.abs(by_q).max(), 1.0)


@pytest.mark.long
@pytest.mark.parametrize("drift", [None, PULLED])
def test_one_answer_is_linearised_twice_alike(drift):
    """What its proof has left of the loops is read, not used up; they slip, so both ends differ."""
    scene = all_scenes()["four_bar loops"]
    q, _, tau = states("four_bar loops")[0]
    v = np.array([1.0, -0.5, 2.0])
    workspace = cp.Workspace(scene, drift=drift)
    solution = workspace.solve(q, v, tau, throw=False)
    first, again = (workspace.linearisation.at(q, v, solution.a, solution.lam) for _ in range(2))
    assert (first.rhs == again.rhs).all()
    assert (first.J == again.J).all()


def test_a_light_body_that_carries_a_heavy_one_keeps_the_digits():
    """23 g on a hinge carry 4.7 kg: Pinocchio's inverse of M is off by 1e-7 there, and so was dlam.

    Against the dense system, whose condition leaves ten digits.
    """
    model, parent, rng = pin.Model(), 0, np.random.default_rng(314)
    kinds = (pin.JointModelRX(), pin.JointModelPlanar(), pin.JointModelFreeFlyer())
    for i, (joint, mass) in enumerate(zip(kinds, (0.0234, 0.02, 4.7), strict=True)):
        placed = pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-3, 3, 3)), rng.uniform(-1, 1, 3))
        parent = model.addJoint(parent, joint, placed, f"j{i}")
        box = pin.Inertia.FromBox(mass, *rng.uniform(0.05, 0.5, 3))
        model.appendBodyToJoint(parent, box, placed)
    made = cp.Robot("light", model)
    for _ in range(20):
        q = np.array(pin.integrate(model, pin.neutral(model), rng.uniform(-1, 1, made.nv)))
        workspace = cp.Workspace(cp.Scene(made))
        still = np.zeros(made.nv)
        M_inv = workspace.derivatives(q, still, still).da_dtau
        M = workspace.terms(q, still).M
        loss = np.abs(M_inv @ M - np.eye(made.nv)).max()
        assert loss <= 10 * np.finfo(float).eps * np.linalg.cond(M)


def two_held_arms(light: float) -> cp.Scene:
    """Two arms of four hinges, of bodies of 1 kg and of lighter ones, held twice at their tips."""
    model, contacts = pin.Model(), []
    hinges = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelRX)
    for arm, mass in enumerate((1.0, light)):
        parent = 0
        for k, hinge in enumerate(hinges):
            place = np.array([0.3, 0.1 * k, 0.2]) if k else np.array([float(arm), 0.0, 0.0])
            parent = model.addJoint(parent, hinge(), pin.SE3(np.eye(3), place), f"{arm}{k}")
            moments = 0.04 * mass * np.diag([1.0, 1.3, 0.8])
            inertia = pin.Inertia(mass, np.array([0.1, 0.2, 0.05]), moments)
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        tip = pin.SE3(np.eye(3), np.array([0.3, 0.2, 0.1]))
        model.addFrame(pin.Frame(f"tip{arm}", parent, 0, tip, pin.FrameType.OP_FRAME))
        contacts += [
            cp.PointContact(f"tip{arm}", name=f"{name}{arm}") for name in ("once", "twice")
        ]
    return cp.Scene(cp.Robot("arms", model), contacts)


@pytest.mark.parametrize("decades", range(11))
def test_pinocchios_own_are_right_or_refused_however_light_a_part_is(decades):
    """G is 1 / mass: what a mu that the heavy part needs leaves of rounding is eps |G| / mu."""
    scene, rng = two_held_arms(10.0**-decades), np.random.default_rng(0)
    q, v = scene.sample(rng)
    workspace = cp.Workspace(scene)
    M = workspace.terms(q, v).M
    state = (q, v, M @ rng.normal(size=len(v)))
    felt = {"da_dq": 1.0, "da_dv": 1.0, "da_dtau": np.sqrt(np.diag(M))}
    if decades > 7:
        with pytest.raises(cp.errors.DerivativesDisagree, match="take method='kkt'"):
            workspace.derivatives(*state, method="pinocchio")
        return
    try:
        theirs = workspace.derivatives(*state, method="pinocchio")
    except cp.errors.DerivativesDisagree:
        if decades > 4:  # rounding decides
            return
        raise
    ours = workspace.derivatives(*state)
    for name, step in felt.items():
        wanted = getattr(ours, name) * step
        off = np.abs(getattr(theirs, name) * step - wanted).sum(axis=1).max()
        assert off < DERIVATIVES * np.abs(wanted).max()


def test_many_kinds_between_bodies_at_once():
    """Their slips are taken together: each is what it is alone, with its turning of J^T lam."""
    talos = robot("talos")
    arms = [(f"arm_left_{i}_link", f"arm_right_{i}_link") for i in (3, 5, 7)]
    loops = [
        cp.Loop(*arms[0], "hinge", axis="y"),
        cp.Loop(*arms[1][::-1], "slider", axis="x"),
        cp.Loop(*arms[2], "rod", length=0.7),
        cp.Loop("leg_left_6_link", "leg_right_6_link", "weld"),
        cp.Loop("world", "base_link", "hinge", axis="x"),
        cp.Loop("leg_left_4_link", "world", "planar", axis="x"),
    ]
    rng, n = np.random.default_rng(0), 38
    q = pin.integrate(talos.model, talos.postures["half_sitting"], 0.3 * rng.normal(size=n))
    v, a = rng.normal(size=(2, n))

    def linearised(*chosen, lam=()):
        scene = cp.Scene(talos, chosen)
        return cp.Workspace(scene).linearisation.at(q, v, a, np.array(lam)).rhs

    forces = [rng.normal(size=bound.size) for bound in cp.Scene(talos, loops).bounds]
    free, together = linearised(), linearised(*loops, lam=np.concatenate(forces))
    alone = [linearised(loop, lam=lam) for loop, lam in zip(loops, forces, strict=True)]
    wanted = np.vstack([free + sum(each[:n] - free for each in alone), *(x[n:] for x in alone)])
    assert np.abs(together - wanted).max() <= 1e-13 * np.abs(wanted).max()


@pytest.mark.long
@each_row("label", ["four_bar", "cassie", "solo12"])
def test_derivatives_share_no_state_with_what_was_asked_before(label):
    """What a proof has evaluated serves its own derivatives: not another state, lam or load."""
    machine = robot(label)
    scene = cp.Scene(machine, [*machine.loops, *machine.contacts][:4])
    rng = np.random.default_rng(3)
    q, v, tau = (*scene.sample(rng), rng.normal(size=machine.nv))
    last = machine.model.frames[len(machine.model.frames) - 1].name
    load = [cp.AppliedForce(last, force=(3.0, 2.0, 1.0))]
    asked = [
        (q, v, tau, ()), (q, v, tau, load), (q, 2 * v, tau, ()), (q, v, 2 * tau, ()),
        (scene.sample(rng)[0], v, tau, load), (q, v, tau, ()),
    ]  # fmt: skip
    used = cp.Workspace(scene)
    for q_, v_, tau_, forces in asked:
        found = used.derivatives(q_, v_, tau_, forces=forces)
        alone = cp.Workspace(scene).derivatives(q_, v_, tau_, forces=forces)
        for block in BLOCKS:  # dlam_dq of redundant rows turns them in the same memory
            assert (getattr(found, block) == getattr(alone, block)).all(), block
        at = found.solution
        later = METHODS["kkt"](used, at, v_, tau_)
        assert np.abs(later.da_dq - found.da_dq).max() < 1e-10 * np.abs(found.da_dq).max()
        used.solve(q_, 0.5 * v_, tau_)
