"""Layers of torch and jax: gradients of `solve` against differences, and against `derivatives`."""

from __future__ import annotations

import copy
import functools
import importlib.util
import pickle
import subprocess
import sys
import types
import warnings
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
import torch
from jax.test_util import check_grads
from shared import central, robot

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.gradients import trajectory_derivatives
from condyn_pin.layers.maps import Configurations
from condyn_pin.model import CoupledMotor

CURVED = {
    "free flyer": pin.JointModelFreeFlyer,
    "spherical": pin.JointModelSpherical,
    "planar": pin.JointModelPlanar,
    "unbounded": pin.JointModelRUBY,
    "euler angles": pin.JointModelSphericalZYX,
}


@pytest.fixture(autouse=True)
def _sixty_four_bits():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.fixture
def once(monkeypatch):
    """Each step is taken and differentiated once.

    Checks of gradients ask for the same derivatives for every number of the answers and of the
    inputs, in both modes and twice, and for the same differences in each mode.
    """
    for route in cp.gradients.ROUTES.values():
        for verb in ("step", "at"):
            monkeypatch.setattr(route, verb, remembered(getattr(route, verb)))


def remembered(of):
    """A verb of a route that takes each step of a state and its torques once."""
    found = {}

    def verb(route, steps, t, q, v):
        torques = steps.system.applied.constant
        key = (route, steps, t, *(x.tobytes() for x in (q, v, torques)))
        if key not in found:
            found[key] = of(route, steps, t, q, v)
        return found[key]

    return verb


@functools.cache
def limb(root: str) -> cp.Robot:
    """Two hinges on a joint of some kind, with a frame at the tip."""
    model, rng = pin.Model(), np.random.default_rng(0)

    def placed():
        return pin.SE3(pin.rpy.rpyToMatrix(*rng.uniform(-1, 1, 3)), rng.uniform(-0.4, 0.4, 3))

    first = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "first")
    body = model.addJoint(first, CURVED[root](), placed(), "curved")
    last = model.addJoint(body, pin.JointModelRZ(), placed(), "last")
    for joint in (first, body, last):
        off = pin.SE3(np.eye(3), rng.uniform(-0.1, 0.1, 3))
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.1, 0.2, 0.3), off)
    tip = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
    model.addFrame(pin.Frame("tip", last, 0, tip, pin.FrameType.OP_FRAME))
    return cp.Robot(f"limb_{root}", model)


@functools.cache
def scenes() -> dict[str, cp.Scene]:
    four_bar, cassie, solo = robot("four_bar"), robot("cassie"), robot("solo12")
    return {
        "four-bar": cp.Scene(four_bar, four_bar.loops),
        "cassie, loops": cp.Scene(cassie, cassie.loops),
        "solo12, feet": cp.Scene(solo, solo.contacts),
        "free body": cp.Scene(limb("free flyer")),
        "planar, held": cp.Scene(limb("planar"), [cp.PointContact("tip")]),
    }


def state(scene: cp.Scene, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return (*scene.sample(rng), rng.normal(size=scene.robot.nv))


def tensors(arrays, grad: bool = True):
    return [torch.tensor(each, requires_grad=grad) for each in arrays]


@pytest.mark.long
@pytest.mark.parametrize("root", list(CURVED))
def test_numbers_of_q_move_as_the_rates_say(root):
    """D against differences of pin.integrate, and back: T D = 1."""
    body = limb(root)
    space, model = Configurations(body), body.model
    start, step = np.random.default_rng(1).normal(size=(2, model.nv))
    q = np.array(pin.integrate(model, pin.neutral(model), start))
    moved = central(lambda t: np.array(pin.integrate(model, q, t * step)), 1e-3)
    D = space.rates(q)
    assert np.abs(D @ step - moved).max() < 1e-9
    assert np.abs(space.steps(q, np.ones(model.nq)) @ D - np.eye(model.nv)).max() < 1e-14


@pytest.mark.parametrize("label", ["four-bar", "solo12, feet", "free body", "planar, held"])
def test_torch_gradients_are_those_of_differences(label):
    """Both modes, by every number of q too; rows that are redundant off the loops are below."""
    scene = scenes()[label]
    layer = cp.layers.torch_solve(scene)
    inputs = tensors(state(scene))
    size = max(float(each.detach().abs().max()) for each in layer(*inputs) if each.numel())
    assert torch.autograd.gradcheck(
        layer,
        inputs,
        atol=1e-6 * size,
        rtol=1e-5,
        check_forward_ad=True,
        check_undefined_grad=False,
    )


@pytest.mark.parametrize("label", ["four-bar", "solo12, feet", "planar, held"])
def test_jax_gradients_are_those_of_differences(label):
    scene = scenes()[label]
    layer = cp.layers.jax_solve(scene)
    of = state(scene)
    size = max(float(np.abs(each).max()) for each in layer(*of))
    check_grads(lambda *at: [x / size for x in layer(*at)], of, 1, ["fwd", "rev"], 1e-5, 1e-5)


@pytest.mark.parametrize("label", list(scenes()))
def test_gradients_are_those_of_the_library(label):
    """To rounding, in the tangent, of both libraries."""
    scene, rng = scenes()[label], np.random.default_rng(3)
    of, space = state(scene), Configurations(scene.robot)
    d = cp.derivatives(scene, *of)
    da, dlam = rng.normal(size=scene.robot.nv), rng.normal(size=scene.rows)
    wanted = d.vjp(da, dlam)

    inputs = tensors(of)
    a, lam = cp.layers.torch_solve(scene)(*inputs)
    (a @ torch.tensor(da) + lam @ torch.tensor(dlam)).backward()
    in_torch = [each.grad.numpy() for each in inputs]

    def cost(*at):
        a, lam = cp.layers.jax_solve(scene)(*at)
        return a @ da + lam @ dlam

    in_jax = [np.asarray(each) for each in jax.grad(cost, (0, 1, 2))(*of)]
    assert np.array_equal(a.detach().numpy(), d.solution.a)
    for by_q, *rest in (in_torch, in_jax):
        found = [cp.layers.tangent_gradient(scene.robot, of[0], by_q), *rest]
        for had, want in zip(found, wanted, strict=True):
            assert np.abs(had - want).max() < 1e-11 * max(1.0, np.abs(want).max())
        for part in scene.robot.arguments.units:  # none along what is normalised away
            assert abs(by_q[part] @ of[0][part]) < 1e-11 * max(1.0, np.abs(by_q).max())
    assert np.abs(space.rates(of[0]).T @ in_torch[0] - wanted[0]).max() < 1e-11 * max(
        1.0, np.abs(wanted[0]).max()
    )


@pytest.mark.long
def test_along_a_closed_motion_of_cassie():
    """The slope of a along a path that keeps the loops closed, whose rows are redundant."""
    scene = scenes()["cassie, loops"]
    q, v, tau = state(scene)
    workspace, model = cp.Workspace(scene), scene.robot.model

    def path(t):
        moved = np.array(pin.integrate(model, q, t * v))
        for _ in range(3):
            c, J = workspace.violation(moved), workspace.jacobian(moved)
            moved = np.array(pin.integrate(model, moved, -np.linalg.lstsq(J, c, rcond=1e-9)[0]))
        return moved

    wanted = central(lambda t: workspace.solve(path(t), v, tau).a, 1e-4)
    dq = central(path, 1e-4)
    still = np.zeros_like(v)
    layer = cp.layers.torch_solve(scene)
    _, (da, _) = torch.func.jvp(layer, tuple(tensors((q, v, tau), False)),
                                tuple(tensors((dq, still, still), False)))  # fmt: skip
    assert np.abs(da.numpy() - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_batches_and_maps_are_the_states_one_by_one():
    scene = scenes()["solo12, feet"]
    many = [np.stack(each) for each in zip(*(state(scene, i) for i in range(4)), strict=True)]
    one_by_one = [cp.solve(scene, *at) for at in zip(*many, strict=True)]
    Q, V, _ = many
    tau = many[2][0]  # one for all: it broadcasts
    a, lam = cp.layers.torch_solve(scene)(*tensors(many, False))
    assert np.array_equal(a.numpy(), np.stack([each.a for each in one_by_one]))
    assert np.array_equal(lam.numpy(), np.stack([each.lam for each in one_by_one]))
    layer, jax_layer = cp.layers.torch_solve(scene), cp.layers.jax_solve(scene)
    grid = layer(*tensors((Q.reshape(2, 2, -1), V.reshape(2, 2, -1), tau), False))[0]
    mapped = torch.func.vmap(layer, in_dims=(0, 0, None))(*tensors((Q, V, tau), False))[0]
    in_jax = jax.jit(jax.vmap(jax_layer, (0, 0, None)))(Q, V, tau)[0]
    assert grid.shape == (2, 2, scene.robot.nv)
    assert torch.equal(grid.reshape(4, -1), mapped)
    assert np.array_equal(np.asarray(in_jax), mapped.numpy())

    def cost(q, v, u):
        return (layer(q, v, u)[0] ** 2).sum()

    by_torch = torch.func.vmap(torch.func.grad(cost, (0, 1, 2)), in_dims=(0, 0, None))
    by_jax = jax.vmap(jax.grad(lambda *at: (jax_layer(*at)[0] ** 2).sum(), (0, 1, 2)), (0, 0, None))
    inputs = tensors((Q, V, tau))
    cost(*inputs).backward()
    parts = by_torch(*tensors((Q, V, tau), False))
    for leaf, part, other in zip(inputs, parts, by_jax(Q, V, tau), strict=True):
        summed = part.sum(0) if leaf.ndim == 1 else part
        size = float(leaf.grad.abs().max())
        assert float((leaf.grad - summed).abs().max()) < 1e-12 * size
        assert np.abs(np.asarray(other) - part.numpy()).max() < 1e-10 * size


@pytest.mark.long
def test_a_batch_of_no_states_has_a_gradient_of_zero():
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    none, v = np.zeros((0, 3)), scene.state()[1]
    layer = cp.layers.jax_solve(scene)
    assert not np.any(jax.grad(lambda tau: layer(none, v, tau)[0].sum())(np.ones(3)))
    tau = torch.ones(3, dtype=torch.double, requires_grad=True)
    cp.layers.torch_solve(scene)(torch.tensor(none), torch.tensor(v), tau)[0].sum().backward()
    assert not tau.grad.any()


@pytest.mark.once  # torch's part, not Pinocchio's
@pytest.mark.filterwarnings("ignore:The .grad attribute:UserWarning")  # its own
def test_a_layer_within_what_torch_compiles_is_called_as_it_is():
    """Its compiler cannot look into Pinocchio: it ended in an error of its own."""
    bar = robot("four_bar")
    solve = cp.layers.torch_solve(cp.Scene(bar, bar.loops))
    q, v = map(torch.tensor, cp.Scene(bar, bar.loops).state())
    found = []
    for how in (lambda f: f, lambda f: torch.compile(f, backend="eager")):
        tau = torch.ones(3, dtype=torch.double, requires_grad=True)
        value = how(lambda u: (solve(q, v, 2 * u)[0] ** 2).sum())(tau)
        value.backward()
        found.append((value.item(), *tau.grad.tolist()))
    assert found[0] == found[1]


@pytest.mark.long
def test_a_quaternion_of_any_length_is_the_rotation_it_stands_for():
    scene = scenes()["free body"]
    q, v, tau = state(scene)
    unit, long = tensors((q, v, tau)), tensors((q, v, tau))
    (part,) = scene.robot.arguments.units
    with torch.no_grad():
        long[0][part] *= 3.0
    layer = cp.layers.torch_solve(scene)
    for inputs in (unit, long):
        layer(*inputs)[0].sum().backward()
    assert torch.allclose(layer(*unit)[0], layer(*long)[0], rtol=1e-13, atol=1e-13)
    assert torch.allclose(unit[0].grad[part], 3.0 * long[0].grad[part], rtol=1e-10, atol=1e-10)


def test_what_no_layer_takes_is_named():
    scene = scenes()["four-bar"]
    layer, (q, v, tau) = cp.layers.torch_solve(scene), tensors(state(scene))
    with pytest.raises(cp.InvalidArgument, match=r"v is float32.*v\.double\(\)"):
        layer(q, v.float(), tau)
    with pytest.raises(cp.InvalidArgument, match="tau is on meta"):
        layer(q, v, tau.to("meta"))
    with pytest.raises(cp.InvalidArgument, match="q is a ndarray"):
        layer(q.detach().numpy(), v, tau)
    with pytest.raises(cp.InvalidArgument, match=r"q has shape \(2,\): the last axis.* 3 long"):
        layer(q[:2], v, tau)
    with pytest.raises(cp.InvalidArgument, match="leading axes that broadcast"):
        layer(q.expand(2, 3), v.expand(3, 3), tau)
    a, _ = layer(q, v, tau)
    (by_q,) = torch.autograd.grad(a.sum(), q, create_graph=True)
    with pytest.raises(cp.InvalidArgument, match="first derivatives only"):
        by_q.sum().backward()
    with pytest.raises(cp.InvalidArgument, match=r"v is sparse: v\.to_dense\(\)"):
        layer(q, v.detach().to_sparse(), tau)
    with pytest.raises(cp.InvalidArgument, match=r"is_grads_batched .* take torch\.func\.jacrev"):
        torch.autograd.grad(layer(q, v, tau)[0], q, torch.eye(3).double(), is_grads_batched=True)
    with pytest.raises(cp.InvalidArgument, match="jax_enable_x64"):
        cp.layers.jax_solve(scene)(*(np.float32(each) for each in state(scene)))
    with pytest.raises(cp.InvalidArgument, match="the last axis has to be 3 long"):
        cp.layers.jax_solve(scene)(np.zeros(2), np.zeros(3), np.zeros(3))
    with pytest.raises(cp.InvalidArgument, match="zero has no direction"):
        cp.layers.tangent_gradient(limb("spherical"), np.zeros(6), np.zeros(6))


@pytest.mark.long
def test_a_view_that_torch_negates_when_it_is_read():
    layer, (q, v, tau) = cp.layers.torch_solve(scenes()["four-bar"]), state(scenes()["four-bar"])
    negated = torch.complex(torch.tensor(q), -torch.tensor(v)).conj().imag
    assert negated.is_neg()
    found, (q, v, tau) = layer(torch.tensor(q), negated, torch.tensor(tau)), tensors((q, v, tau))
    assert torch.equal(found[0], layer(q, v, tau)[0])


@functools.cache
def stepping() -> tuple[cp.Scene, tuple[np.ndarray, ...]]:
    """Solo12 slides on its feet, a tenth of a millimetre in the floor: off all kinks."""
    solo = robot("solo12")
    scene = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    q, v = scene.state()
    q = cp.mechanism.place_on_ground(scene, q)
    q[2] -= 1e-4
    v[:3] = 0.4, 0.15, 0.0
    v[6:] = 0.1 * np.random.default_rng(0).normal(size=12)
    return scene, (q, v, np.r_[np.zeros(6), np.random.default_rng(1).normal(size=12)])


def test_steps_in_torch_and_jax():
    """Of both libraries, and two steps in a row: what `step` finds, and its derivatives."""
    (scene, (q, v, tau)), rng = stepping(), np.random.default_rng(2)
    dt, route = 1e-3, cp.gradients.ActiveSet()
    g_q, g_v = rng.normal(size=19), rng.normal(size=18)
    one = cp.step(scene, q, v, tau, dt=dt).derivatives(route=route)
    two = cp.step(scene, one.q, one.v, tau, dt=dt).derivatives(route=route)
    space = Configurations(scene.robot)
    back = two.vjp(g_q @ space.rates(two.q), g_v)
    first = one.vjp(*back[:2])
    wanted = [*first[:2], first[2] + back[2]]

    step, in_jax = (make(scene, dt=dt) for make in (cp.layers.torch_step, cp.layers.jax_step))
    inputs = tensors((q, v, tau))
    end = step(*step(*inputs), inputs[2])
    (end[0] @ torch.tensor(g_q) + end[1] @ torch.tensor(g_v)).backward()

    def cost(q, v, tau):
        q2, v2 = in_jax(*in_jax(q, v, tau), tau)
        return q2 @ g_q + v2 @ g_v

    by_jax = [np.asarray(each) for each in jax.grad(cost, (0, 1, 2))(q, v, tau)]
    assert np.abs(end[0].detach().numpy() - two.q).max() < 1e-12
    for by_q, *rest in ([each.grad.numpy() for each in inputs], by_jax):
        found = [cp.layers.tangent_gradient(scene.robot, q, by_q), *rest]
        for had, want in zip(found, wanted, strict=True):
            assert np.abs(had - want).max() < 1e-7 * np.abs(want).max()


def sliding(kind: str) -> tuple[cp.Scene, tuple[np.ndarray, ...]]:
    """Small scenes of each kind of row and contact, away from all kinks."""
    rng = np.random.default_rng(3)
    if kind == "four-bar with dry friction":
        bar = robot("four_bar")
        crank = list(bar.model.names)[1]
        scene = cp.Scene(bar, bar.loops, contacts=[cp.constraints.JointFriction(crank, torque=0.2)])
        q, v = scene.sample(rng)
        return scene, (q, v, rng.normal(size=3))
    if kind == "solo12":
        return stepping()
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    above = kind == "ball above it"  # that comes down within the step, and leaves again
    floor = cp.FrictionalContact(
        "ball", cp.constraints.Ball(0.05), friction=0.1, restitution=0.4 * above
    )
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()[0].copy(), np.array([1.5, 0.1, -0.2, 1.0, 2.0, 0.5])
    q[2] = 0.0505 if above else 0.0499
    return scene, (q, v, rng.normal(size=6))


STEPPED = [
    *(
        (kind, route)
        for kind in ("ball in the floor", "four-bar with dry friction", "solo12")
        for route in ("activeset", "kappa", "softened", "eventlocated")
        if (kind, route) != ("solo12", "eventlocated")
    ),
    pytest.param("solo12", "eventlocated", marks=pytest.mark.long),
    ("ball above it", "eventlocated"),
    ("ball in the floor", "randomised"),
    ("four-bar with dry friction", "randomised"),
]


@pytest.mark.once  # routes and adjoints are compared on both
@pytest.mark.usefixtures("once")
@pytest.mark.parametrize(("kind", "name"), STEPPED)
def test_torch_gradients_of_steps_are_those_of_differences(kind, name):
    """Of each route, in both modes; noise finds the slope of a smooth step."""
    scene, inputs = sliding(kind)
    noisy, above = name == "randomised", kind == "ball above it"
    route = cp.gradients.Randomised(20, 1e-6) if noisy else cp.gradients.ROUTES[name]()
    scheme, dt = (cp.Moreau(), 5e-3) if above else (cp.StewartTrinkle(), 1e-3)
    step = cp.layers.torch_step(scene, dt=dt, integrator=scheme, route=route)
    closed, given = tensors(inputs), slice(0, 3)
    if scene.rows:  # a step of q alone would open the loop
        given = slice(1, 3)
    q, *_ = closed

    def end(*at):
        return step(*(at if len(at) == 3 else (q.detach(), *at)))

    assert torch.autograd.gradcheck(
        end, closed[given], eps=1e-6, atol=1e-2 if noisy else 1e-4, rtol=1e-4,
        check_forward_ad=True, check_undefined_grad=False,
    )  # fmt: skip


def test_a_step_is_differentiated_by_every_number():
    """Against differences of the layer itself, sliding feet and a floating base."""
    scene, (q, v, tau) = stepping()
    step = cp.layers.torch_step(scene, dt=1e-3)
    at = tensors((q, v, tau), False)
    rng = np.random.default_rng(4)
    along = tensors((0.1 * rng.normal(size=19), rng.normal(size=18), rng.normal(size=18)), False)
    _, (dq, dv) = torch.func.jvp(step, tuple(at), tuple(along))

    def end(t):
        return torch.cat(step(*(x + t * d for x, d in zip(at, along, strict=True)))).numpy()

    wanted, found = central(end, 1e-6), torch.cat((dq, dv)).numpy()
    assert np.abs(found - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_without_crocoddyl_it_is_said_how_to_have_it(monkeypatch):
    scene, _ = stepping()
    monkeypatch.setitem(sys.modules, "crocoddyl", None)
    monkeypatch.delitem(sys.modules, "condyn_pin.layers.crocoddyl", raising=False)
    with pytest.raises(cp.errors.MissingExtra, match="--no-deps crocoddyl"):
        cp.layers.crocoddyl_action(cp.layers.Action(scene, dt=1e-3), None)


def test_a_step_without_an_answer_is_nan_to_crocoddyl(monkeypatch):
    """Its solvers go on behind NaN by a shorter step, and an exception of Python ends them."""
    model, (scene, (q, v, _)) = loaded_beside_a_stand_in(monkeypatch), stepping()
    action = cp.layers.Action(scene, dt=1e-3)
    of_state = types.SimpleNamespace(pinocchio=scene.robot.model, nq=len(q))
    costs = types.SimpleNamespace(
        state=of_state, nu=12, calc=lambda *_: None,
        createData=lambda _: types.SimpleNamespace(cost=1.0),
    )  # fmt: skip
    step, u, x = model.ActionModel(action, costs), np.zeros(12), np.r_[q, v]
    data = step.createData()
    step.calc(data, x, u)
    assert np.array_equal(data.xnext, action.step(x, u))
    x[-1] = 1e200
    with pytest.raises(cp.SolveFailed):
        action.step(x, u)
    step.calc(data, x, u)
    assert np.isnan(data.xnext).all()
    with pytest.raises(cp.InvalidArgument, match="x"):  # and nothing begins there
        step.calc(data, data.xnext, u)


def loaded_beside_a_stand_in(monkeypatch):
    """The file that imports crocoddyl, with two classes and a function in its place."""
    stand_in = types.ModuleType("crocoddyl")
    stand_in.ActionModelAbstract = type(
        "ActionModelAbstract", (),
        {"__init__": lambda self, state, nu: vars(self).update(state=state, nu=nu)},
    )  # fmt: skip
    stand_in.ActionDataAbstract = type(
        "ActionDataAbstract", (), {"__init__": lambda self, model: None}
    )
    stand_in.DataCollectorMultibody = lambda data: data
    monkeypatch.setitem(sys.modules, "crocoddyl", stand_in)
    path = Path(cp.layers.__file__).parent / "crocoddyl_model.py"
    spec = importlib.util.spec_from_file_location("beside_a_stand_in", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_action_is_a_step_in_the_tangent():
    scene, (q, v, tau) = stepping()
    model, nv = scene.robot.model, scene.robot.nv
    action = cp.layers.Action(scene, dt=1e-3)
    x, u = np.concatenate([q, v]), tau[6:]
    end, (Fx, Fu) = action.step(x, u), action.derivatives(x, u)
    now = cp.step(scene, q, v, tau, dt=1e-3)
    assert np.abs(end - np.concatenate([now.q, now.v])).max() < 1e-7
    assert Fx.shape == (2 * nv, 2 * nv)
    rng = np.random.default_rng(5)
    dq, dv, du = 0.1 * rng.normal(size=nv), rng.normal(size=nv), rng.normal(size=12)

    def moved(t):
        there = np.concatenate([pin.integrate(model, q, t * dq), v + t * dv])
        after = action.step(there, u + t * du)
        return np.concatenate([pin.difference(model, end[:19], after[:19]), after[19:] - end[19:]])

    wanted = central(moved, 1e-6)
    found = Fx @ np.concatenate([dq, dv]) + Fu @ du
    assert np.abs(found - wanted).max() < 1e-5 * np.abs(wanted).max()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(cp.SolveFailed, match="is not finite"):
            action.step(x, 1e300 * u)
    with pytest.raises(cp.InvalidArgument, match="dt = 0"):
        cp.layers.Action(scene, dt=0)
    with pytest.raises(cp.InvalidArgument, match="route = 'kappa'"):
        cp.layers.Action(scene, dt=1e-3, route="kappa")
    with pytest.raises(cp.InvalidArgument, match="StewartTrinkle"):
        cp.layers.torch_step(scene, dt=1e-3, integrator=cp.RungeKutta4())


@pytest.mark.long
def test_an_action_takes_motors_on_several_joints():
    """tau = B u, and dx+/du = dx+/dtau B."""
    arm = cp.model.chain(2)
    weights = dict(zip(arm.joints, (2.0, -3.0), strict=True))
    motors = [CoupledMotor("belt", weights), arm.joints[1]]
    action = cp.layers.Action(cp.Scene(arm), dt=1e-2, motors=motors)
    plain = cp.layers.Action(cp.Scene(arm), dt=1e-2, motors=arm.joints)
    B, x, u = np.array([[2.0, 0.0], [-3.0, 1.0]]), np.array([0.1, 0.2, 0.3, 0.4]), [0.5, 0.7]
    assert np.array_equal(action.B, B)
    assert np.allclose(action.step(x, u), plain.step(x, B @ u), rtol=1e-14)
    assert np.allclose(action.derivatives(x, u)[1], plain.derivatives(x, B @ u)[1] @ B, rtol=1e-12)
    of_robot = cp.layers.Action(cp.Scene(arm.with_motors(arm.joints[1], motors[0])), dt=1e-2)
    assert np.array_equal(of_robot.B, B[:, ::-1])


def test_an_action_is_differentiated_where_a_step_opens_its_loop():
    """Along motions that keep it: by the torque of the step before."""
    bar = robot("four_bar")
    action = cp.layers.Action(cp.Scene(bar, bar.loops), dt=1e-2)
    x, u = np.append(action.scene.state("open")[0], np.zeros(3)), np.array([4.0])
    for _ in range(45):
        x = action.step(x, u)
    assert 5.0 < x[3] < 20.0  # [rad/s]

    def end(t):
        return action.step(action.step(x, u + t), u)

    wanted = central(end, 1e-4)
    found = action.derivatives(action.step(x, u), u)[0] @ action.derivatives(x, u)[1]
    assert np.abs(found[:, 0] - wanted).max() < 1e-7 * np.abs(wanted).max()


@pytest.mark.long
@pytest.mark.once  # torch's part, not Pinocchio's
@pytest.mark.parametrize("library", ["torch", "jax"])
def test_without_the_library_the_extra_is_named(library):
    program = f"""
import sys
from dataclasses import replace
sys.modules["{library}"] = None
import condyn_pin as cp
bar = cp.model.four_bar()
try:
    cp.layers.{library}_solve(cp.Scene(bar, bar.loops))
except cp.errors.MissingExtra as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert f"condyn_pin[{library}]" in done.stdout, done.stderr


def weights(machine: cp.Robot) -> np.ndarray:
    """What its bodies weigh, ten numbers a joint."""
    return np.array([Y.toDynamicParameters() for Y in list(machine.model.inertias)[1:]])


@functools.cache
def motions() -> dict:
    """Scenes with how they are stepped, what else there is to vary, and where they begin."""
    bar = robot("four_bar")
    swing = cp.Scene(bar, bar.loops)
    ball = cp.model.free_ball(mass=1.0, radius=0.05)
    floor = cp.FrictionalContact("ball", cp.constraints.Ball(0.05), friction=0.1, restitution=0.4)
    lands, soft = cp.Scene(ball, contacts=[floor]), replace(floor, restitution=0.0)
    sinks = cp.Scene(ball, contacts=[soft])
    q, v = lands.state()
    q = pin.integrate(ball.model, q, np.array([0, 0, 0.0535, 0.3, 0.2, 0.1]))
    q[2] = 0.0535
    v[:] = 1.5, 0.1, -0.6, 1.0, 2.0, 0.5
    below = q.copy()
    below[2] = 0.0496
    return {
        "loops": (swing, {"integrator": cp.Moreau(), "wrt": ["inertias"]},
                  (*swing.sample(np.random.default_rng(0)),), (weights(bar),)),
        "lands": (lands, {"integrator": cp.Moreau(), "wrt": ["friction", "restitution"]}, (q, v),
                  (np.array([0.1]), np.array([0.4]))),
        "sinks": (sinks, {"integrator": cp.stepping.SoftStep(), "wrt": ["solref", "inertias"]},
                  (below, v), (np.array([0.02, 1.0]), weights(ball))),
        "smooth": (sinks, {"route": cp.gradients.Kappa(1e-2), "wrt": ["friction"]}, (below, v),
                   (np.array([0.3]),)),
        "slides": (sinks, {"route": cp.gradients.ActiveSet(), "wrt": ["friction", "inertias"]},
                   (below, v), (np.array([0.3]), weights(ball))),
        "softened": (sinks, {"route": cp.gradients.Softened(), "wrt": ["friction", "solref"]},
                     (below, v), (np.array([0.3]), np.array([0.02, 1.0]))),
        "located": (lands, {"integrator": cp.Moreau(), "route": cp.gradients.EventLocated(),
                            "wrt": ["friction", "restitution"]},
                    (q, v), (np.array([0.1]), np.array([0.4]))),
        "noisy": (sinks, {"route": cp.gradients.Randomised(20, 1e-6), "wrt": ["friction"]},
                  (below, v), (np.array([0.3]),)),
    }  # fmt: skip


def moving(label: str, steps: int, make, **more):
    """A layer of a whole motion, and what to call it with."""
    scene, how, (q, v), parameters = motions()[label]
    tau = np.random.default_rng(4).normal(size=(steps, scene.robot.nv))
    return make(scene, dt=2e-3, **how, **more), (q, v, tau, *parameters)


def by_shares(layer, of, times):
    """The layer as a function of q, v, tau and of shares by which parameters change."""
    start, values = of[:3], of[3:]

    def call(q, v, tau, *shares):
        changed = (times(x, 1.0 + share) for x, share in zip(values, shares, strict=True))
        return layer(q, v, tau, *changed)

    return call, (*start, *(np.zeros_like(x) for x in values))


MOTIONS = ("loops", "lands", "sinks", "smooth")
ROUTED = (*MOTIONS, "slides", "softened", "located", "noisy")  # by every route


@pytest.mark.once  # routes and adjoints are compared on both
@pytest.mark.usefixtures("once")
@pytest.mark.parametrize("label", ROUTED)
def test_torch_gradients_of_motions_are_those_of_differences(label):
    """By the start, the torques of each step and parameters; on the way and at the end."""
    layer, of = moving(label, 2, cp.layers.torch_simulate, every=1)
    call, of = by_shares(layer, of, lambda x, y: torch.tensor(x) * y)
    inputs = tensors(of)
    q, v = call(*inputs)
    assert q.shape == (2, len(of[0]))
    assert v.shape == (2, len(of[1]))
    share = 1e-2 if label == "noisy" else 1e-5
    assert torch.autograd.gradcheck(
        call, inputs, eps=1e-5, atol=share, rtol=share, check_forward_ad=True
    )


@pytest.mark.once  # routes and adjoints are compared on both
@pytest.mark.usefixtures("once")
@pytest.mark.parametrize("label", ROUTED)
def test_jax_gradients_of_motions_are_those_of_differences(label):
    layer, of = moving(label, 2, cp.layers.jax_simulate, every=1)
    call, of = by_shares(layer, of, lambda x, y: x * y)
    share = 1e-2 if label == "noisy" else 1e-5
    check_grads(call, of, 1, ["rev"], share, share, eps=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("label", MOTIONS)
def test_torch_and_jax_have_one_motion(label):
    """To the bits, and their gradients; jitted, and that of `simulate` at its end."""
    scene, how, _, _ = motions()[label]
    layer, of = moving(label, 5, cp.layers.torch_simulate)
    in_jax, _ = moving(label, 5, cp.layers.jax_simulate)
    inputs = tensors(of)
    end = layer(*inputs)
    sum(each.sum() for each in end).backward()
    found = jax.jit(jax.value_and_grad(lambda *at: sum(x.sum() for x in in_jax(*at)), (0, 1, 2)))
    value, gradients = found(*of)
    assert float(value) == pytest.approx(sum(x.detach().sum().item() for x in end), rel=1e-13)
    for by_torch, by_jax in zip(inputs, gradients, strict=False):
        assert np.abs(by_torch.grad.numpy() - np.asarray(by_jax)).max() < 1e-12
    if "route" in how:  # which has steps of its own
        return

    def held(t, q, v):
        return of[2][min(int(t / 2e-3 + 1e-6), 4)]

    run = cp.simulate(scene, *of[:2], held, duration=1e-2, dt=2e-3, integrator=how["integrator"],
                      close_start=scene.rows > 0)  # fmt: skip
    # contacts are solved to 1e-8 there, and polished here
    assert np.abs(end[0].detach().numpy() - run.q[-1]).max() < 1e-9
    assert np.abs(end[1].detach().numpy() - run.v[-1]).max() < 1e-7


@pytest.mark.long
def test_a_motion_is_the_sweep_of_trajectory_derivatives():
    """Of Solo12 as it slides, with parameters: in one sweep back."""
    scene, (q, v, tau) = stepping()
    feet, rng = np.full(4, 0.7), np.random.default_rng(2)
    layer = cp.layers.torch_simulate(scene, dt=1e-3, wrt=["friction", "inertias"])
    inputs = tensors((q, v, np.tile(tau, (12, 1)), feet, weights(scene.robot)))
    g_q, g_v = rng.normal(size=19), rng.normal(size=18)
    end = layer(*inputs)
    (end[0] @ torch.tensor(g_q) + end[1] @ torch.tensor(g_v)).backward()
    run = cp.simulate(scene, q, v, tau, duration=0.012, dt=1e-3, close_start=False)
    of = trajectory_derivatives(run, tau, wrt=["inertias"])
    wanted = of.vjp(g_q @ Configurations(scene.robot).rates(of.q), g_v)
    by_q = cp.layers.tangent_gradient(scene.robot, q, inputs[0].grad)
    found = [by_q, *(each.grad.numpy() for each in inputs[1:])]
    order = (wanted.q, wanted.v, wanted.tau, wanted.friction, wanted.inertias.reshape(12 + 1, 10))
    for had, want in zip(found, order, strict=True):
        assert np.abs(had - want).max() < 1e-7 * np.abs(want).max()


@pytest.mark.long
def test_batches_of_motions_are_the_motions_one_by_one():
    layer, (q, v, tau, _, e) = moving("lands", 3, cp.layers.torch_simulate)
    in_jax, _ = moving("lands", 3, cp.layers.jax_simulate)
    some, taus = np.array([[0.05], [0.1], [0.3]]), np.stack([tau, 2 * tau])[:, None]
    batch = layer(*tensors((q, v, taus, some, e)))
    assert batch[0].shape == (2, 3, 7)
    for i, j in np.ndindex(2, 3):
        one = layer(*tensors((q, v, taus[i, 0], some[j], e)))
        assert all(torch.equal(x[i, j], y) for x, y in zip(batch, one, strict=True))
    mapped = torch.func.vmap(lambda mu: layer(*tensors((q, v, tau)), mu, torch.tensor(e))[1])
    assert torch.equal(mapped(torch.tensor(some)), batch[1][0])
    by_jax = jax.vmap(jax.grad(lambda mu: in_jax(q, v, tau, mu, e)[1].sum()))(some)
    leaf = torch.tensor(some, requires_grad=True)
    layer(*tensors((q, v, tau), False), leaf, torch.tensor(e))[1].sum().backward()
    assert np.abs(np.asarray(by_jax) - leaf.grad.numpy()).max() < 1e-14
    assert float(leaf.grad.abs().min()) > 1e-2


def test_what_no_motion_takes_is_named():
    layer, (q, v, tau, mu, e) = moving("lands", 4, cp.layers.torch_simulate, every=3)
    q, v, tau, mu, e = tensors((q, v, tau, mu, e))
    scene, refused = motions()["lands"][0], pytest.raises
    with refused(cp.InvalidArgument, match=r"4 steps: a multiple of every = 3"):
        layer(q, v, tau, mu, e)
    with refused(cp.InvalidArgument, match=r"tau has shape \(6,\): the last 2 axes .*\(steps, 6\)"):
        layer(q, v, tau[0], mu, e)
    with refused(cp.InvalidArgument, match="tau has no steps"):
        layer(q, v, tau[:0], mu, e)
    with refused(cp.InvalidArgument, match=r"friction is float32.*friction\.double\(\)"):
        layer(q, v, tau, mu.float(), e)
    with refused(cp.InvalidArgument, match="4 arrays: 5 are needed, q, v, tau, friction, rest"):
        layer(q, v, tau, mu)
    with refused(cp.InvalidArgument, match="friction = -0.1"):
        layer(q, v, tau[:3], -mu, e)
    with refused(cp.InvalidArgument, match="every = 0"):
        cp.layers.torch_simulate(scene, dt=1e-3, integrator=cp.Moreau(), every=0)
    with refused(cp.InvalidArgument, match="wrt: 'solref': a step by ActiveSet.. has none by it"):
        cp.layers.torch_simulate(scene, dt=1e-3, integrator=cp.Moreau(), wrt=["solref"])
    with refused(cp.InvalidArgument, match="wrt: 'mass': unknown"):
        cp.layers.jax_step(scene, dt=1e-3, integrator=cp.Moreau(), wrt=["mass"])
    with refused(cp.InvalidArgument, match=r"wrt = 'friction': a list"):
        cp.layers.jax_step(scene, dt=1e-3, integrator=cp.Moreau(), wrt="friction")
    heavy, of = moving("sinks", 2, cp.layers.torch_simulate)
    with refused(cp.errors.InvalidModel, match="the mass on floating is negative"):
        heavy(*tensors((*of[:-1], -of[-1])))
    end, _ = layer(q, v, tau[:3], mu, e)
    (by_v,) = torch.autograd.grad(end.sum(), v, create_graph=True)
    with refused(cp.InvalidArgument, match="first derivatives only"):
        by_v.sum().backward()
    in_jax, of = moving("lands", 2, cp.layers.jax_simulate)
    with refused(cp.InvalidArgument, match="first derivatives only"):
        jax.hessian(lambda v: in_jax(of[0], v, *of[2:])[1].sum())(of[1])


def of_every_map() -> dict:
    """Layers' arguments and inputs: of solves, steps and motions, with what may vary."""
    bar, tau = scenes()["four-bar"], np.zeros(6)
    scene, how, (q, v), p = motions()["sinks"]
    rough = {"route": cp.gradients.Randomised(12, 1e-6, seed=5), "wrt": ["inertias"]}
    return {
        "solve": ((bar,), {"solver": cp.dynamics.NullSpace(), "drift": cp.Baumgarte(20.0, 1.0),
                           "wrt": ["inertias"]}, (*state(bar), weights(bar.robot))),
        "step": ((scene,), {"dt": 2e-3, **how}, (q, v, tau, *p)),
        "simulate": ((scene,), {"dt": 2e-3, "every": 2, **rough}, (q, v, np.zeros((4, 6)), p[1])),
    }  # fmt: skip


@pytest.mark.once  # pickled is what Python hands on
@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
@pytest.mark.parametrize("make", list(of_every_map()))
def test_copies_of_layers_have_their_answers_and_gradients(make, again):
    """To the bit, also behind a call with other parameters."""
    of, how, inputs = of_every_map()[make]
    layer = getattr(cp.layers, f"torch_{make}")(*of, **how)
    layer(*tensors((*inputs[:-1], 1.5 * inputs[-1]), False))
    found = []
    for each in (layer, again({"layer": layer})["layer"]):
        leaves = tensors(inputs)
        answer = each(*leaves)
        sum((x**2).sum() for x in answer).backward()
        found.append([*answer, *(leaf.grad for leaf in leaves)])
    assert all(torch.equal(x, y) for x, y in zip(*found, strict=True))
    assert all(x.any() for x in found[0])
    in_jax = getattr(cp.layers, f"jax_{make}")(*of, **how)
    k = range(len(inputs))
    by, other = (
        jax.value_and_grad(lambda *at, f=f: sum((x**2).sum() for x in f(*at)), k)(*inputs)
        for f in (in_jax, again(in_jax))
    )
    assert jax.tree.all(jax.tree.map(np.array_equal, by, other))


@pytest.mark.long
def test_a_module_with_a_layer_in_it_is_copied_and_saved(tmp_path):
    class Motor(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.solve, self.gain = (
                cp.layers.torch_solve(scenes()["four-bar"]),
                torch.nn.Linear(3, 3),
            )

        def forward(self, q, v):
            return self.solve(q, v, self.gain(v))[0]

    motor, (q, v, _) = Motor().double(), tensors(state(scenes()["four-bar"]), False)
    assert torch.equal(copy.deepcopy(motor)(q, v), motor(q, v))
    torch.save(motor.solve, tmp_path / "layer.pt")
    again = torch.load(tmp_path / "layer.pt", weights_only=False)
    assert torch.equal(again(q, v, v)[1], motor.solve(q, v, v)[1])


@pytest.mark.long
def test_what_jax_calls_within_raises_what_there_is_to_say():
    """As it is where Python calls; the last line of jax's own error where its program does."""
    scene = scenes()["four-bar"]
    layer, (q, v, tau) = cp.layers.jax_solve(scene), state(scene)
    nothing = np.full(3, np.nan)

    def cost(v):
        return layer(q, v, tau)[0].sum()

    for call in (cost, jax.grad(cost), jax.jacfwd(cost), jax.value_and_grad(cost)):
        with pytest.raises(cp.InvalidArgument, match=r"^v\[0\] = nan: finite numbers are needed"):
            call(nothing)
    with pytest.raises(cp.SolveFailed):
        layer(q, 1e200 * v, tau)
    many, jit = nothing[None], jax.jit
    for call, v_ in ((jit(cost), nothing), (jit(jax.grad(cost)), nothing), (jax.vmap(cost), many)):
        with pytest.raises(Exception, match="InvalidArgument") as caught:
            jax.block_until_ready(call(v_))
        assert str(caught.value).splitlines()[-1].endswith("= nan: finite numbers are needed")
    # shapes and dtypes are known when it traces
    for bad in (np.zeros(2), np.zeros(3, np.float32)):
        with pytest.raises(cp.InvalidArgument, match=r"^v (has shape|is float32)"):
            jax.jit(cost)(bad)


@pytest.mark.long
@pytest.mark.parametrize("make", ["step", "simulate"])
def test_numbers_that_are_none_are_named(make):
    scene, how, (q, v), p = motions()["lands"]
    tau = np.zeros((2, 6)) if make == "simulate" else np.zeros(6)
    layer = getattr(cp.layers, f"torch_{make}")(scene, dt=2e-3, **how)
    for i, name in enumerate(("q", "v", "tau", "friction", "restitution")):
        inputs = tensors((q, v, tau, *p), False)
        inputs[i][..., 0] = float("nan")
        with pytest.raises(cp.InvalidArgument, match=rf"{name}\[.*0\] = nan"):
            layer(*inputs)


@pytest.mark.parametrize("root", [*CURVED, "cassie"])
def test_motions_of_curved_joints_and_loops(root):
    """By torques and inertias, and by every number of q where no loop has to be closed."""
    rng, free = np.random.default_rng(0), root != "cassie"
    scene = cp.Scene(limb(root)) if free else scenes()["cassie, loops"]
    layer = cp.layers.torch_simulate(scene, dt=1e-3, wrt=["inertias"])
    nv, pi = scene.robot.nv, weights(scene.robot)
    at = tensors((*scene.sample(rng), rng.normal(size=(3, nv)), pi), False)
    along = [rng.normal(size=x.shape) for x in at]
    along[3] = 0.01 * pi * along[3]
    if not free:
        along[0], along[1] = 0 * along[0], 0 * along[1]
    along = tensors(along, False)
    _, found = torch.func.jvp(layer, tuple(at), tuple(along))

    def end(t):
        return torch.cat(layer(*(x + t * d for x, d in zip(at, along, strict=True)))).numpy()

    wanted = central(end, 1e-5)
    assert np.abs(torch.cat(found).numpy() - wanted).max() < 1e-6 * np.abs(wanted).max()


@pytest.mark.parametrize("label", ["four-bar", "solo12, feet"])
def test_solves_by_what_bodies_weigh(label):
    """Of both libraries and both modes, against differences."""
    scene = scenes()[label]
    of, pi = state(scene), weights(scene.robot)
    layer = cp.layers.torch_solve(scene, wrt=["inertias"])
    in_jax = cp.layers.jax_solve(scene, wrt=["inertias"])
    along = 0.01 * pi * np.random.default_rng(5).normal(size=pi.shape)
    steps = [*(np.zeros_like(x) for x in of), along]
    at, moved = (tuple(tensors(each, False)) for each in ((*of, pi), steps))
    _, found = torch.func.jvp(layer, at, moved)

    def end(t):
        return np.concatenate([x.numpy() for x in layer(*at[:3], at[3] + t * moved[3])])

    wanted, size = central(end, 1e-3), 1e-7
    assert np.abs(torch.cat(found).numpy() - wanted).max() < size * np.abs(wanted).max()
    _, by_jax = jax.jvp(in_jax, (*of, pi), tuple(steps))
    assert np.abs(np.concatenate(by_jax) - wanted).max() < size * np.abs(wanted).max()
    leaf = torch.tensor(pi, requires_grad=True)
    a, lam = layer(*at[:3], leaf)
    (a.sum() + lam.sum()).backward()
    assert float((leaf.grad * moved[3]).sum()) == pytest.approx(wanted.sum(), rel=1e-6)
    with pytest.raises(cp.InvalidArgument, match="inertias"):
        cp.layers.torch_solve(scene, wrt=["friction"])


def test_motors_are_a_list():
    bar = cp.model.four_bar()
    with pytest.raises(cp.InvalidArgument, match="joints = 'crank': a list of names"):
        cp.layers.Action(cp.Scene(bar, bar.loops), 0.01, motors="crank")
