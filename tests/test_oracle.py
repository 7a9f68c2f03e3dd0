"""The oracle in 50 digits against Pinocchio's terms, against `Reference`, and against EXTREMES."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from oracle import Oracle, mp
from shared import all_scenes, axis_of, states

import condyn_pin as cp
from condyn_pin._core.tolerances import REFERENCE_RANK
from lab.extremes import EXTREMES
from lab.extremes.base import with_inertias
from lab.extremes.verdicts import right_answers

KINDS = {
    **{kind: (cp.Loop("hand", "foot", kind, axis=axis_of(kind, "y")),) for kind in
       ("ball", "weld", "hinge", "slider", "planar")},
    "rod": (cp.Loop("hand", "foot", "rod", length=0.7),),
    "to the world": (cp.Loop("world", "hand"), cp.Loop("foot", "world", "slider", axis="x")),
    "point": (cp.PointContact("foot", (0.1, 0.2, 0.3)),),
    "surface and line": (cp.SurfaceContact("hand"), cp.constraints.LineContact("foot", "x")),
    "anchored": (
        cp.SurfaceContact("hand", anchor=(0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5)),
        cp.PointContact("foot", anchor=(0.0, 0.1, 0.0)),
    ),
    "plane": (cp.constraints.PlanarContact("foot", (0.1, 0.0, 0.0), (1.0, 2.0, 3.0)),),
    "gear": (cp.constraints.Coupling("slide", "turn", 0.3, 0.1),),
}  # fmt: skip


def every_joint() -> cp.Robot:
    """A free body with two arms, of every kind of joint that the oracle knows."""
    rng = np.random.default_rng(1)
    model = pin.Model()

    def add(parent, joint, name):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        number = model.addJoint(parent, joint, place, name)
        root = rng.normal(size=(3, 3))
        body = pin.Inertia(1.0 + rng.random(), rng.normal(size=3), root @ root.T + np.eye(3))
        model.appendBodyToJoint(number, body, pin.SE3.Identity())
        return number

    base = add(0, pin.JointModelFreeFlyer(), "base")
    arm = add(base, pin.JointModelSpherical(), "shoulder")
    arm = add(arm, pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])), "turn")
    leg = add(base, pin.JointModelPX(), "slide")
    leg = add(leg, pin.JointModelRUBZ(), "wheel")
    leg = add(leg, pin.JointModelSphericalZYX(), "hip")
    for name, joint in (("hand", arm), ("foot", leg)):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME))
    model.armature = rng.random(model.nv)
    return cp.Robot("every joint", model)


def largest(found, wanted) -> float:
    """Largest difference, relative to the largest entry."""
    apart = np.abs(np.array(found - wanted, dtype=float)).max(initial=0.0)
    return float(apart / max(np.abs(wanted).max(initial=0.0), 1e-3))


@pytest.mark.parametrize("kind", KINDS)
def test_terms_of_every_kind_at_any_state(kind):
    """Off the constraints too, where each kind has its own gamma."""
    robot = every_joint()
    scene = cp.Scene(robot, KINDS[kind])
    rng = np.random.default_rng(2)
    q = pin.integrate(robot.model, pin.neutral(robot.model), rng.normal(size=robot.nv))
    v = rng.normal(size=robot.nv)
    terms = cp.Workspace(scene).terms(q, v)
    for found, wanted in zip(
        Oracle(scene).terms(q, v), (terms.M, terms.h, terms.J, terms.gamma), strict=True
    ):
        assert largest(found, wanted) < 1e-14


@pytest.mark.parametrize("label", ["four_bar loops", "cassie loops"])
def test_reference_is_right(label):
    """Rows of rank 2 of 3 and of 10 of 12 among them."""
    scene, (q, v, tau) = all_scenes()[label], states(label)[0]
    a, lam = Oracle(scene).solve(q, v, tau)
    found = cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference())
    assert largest(a, found.a) < 1e-13
    assert largest(lam, found.lam) < 1e-13


CASES = [
    ("parallelogram", 0.1), ("parallelogram", 1e-3), ("parallelogram", 1e-6),
    ("parallelogram", 0.0), ("dead_point", 1e-3), ("dead_point", 0.0), ("straight_knee", 1e-4),
    ("straight_knee", 1e-6), ("mass_ratio", 1e6), ("mass_ratio", 1e12), ("mass_ratio", 1e-9),
    ("light_rod", 0.1), ("gimbal", 1e-2), ("short_rod", 1e-3), ("short_rod", 1e-6),
    ("straight_chain", 10), ("bent_chain", 15), ("held_chain", 5), ("many_cells", 3),
    ("immobile", 1e3), ("empty_row", 1e-6), ("massless_coupler", 1.0), ("massless_coupler", 1e-13),
    ("massless_tip", 1e-12), ("massless_row", 1), ("massless_row", 2), ("near_edges", 1e-3),
    ("near_loops", 1e-5),
]  # fmt: skip


@pytest.mark.parametrize(("family", "severity"), CASES)
def test_what_extremes_call_right_is_right(family, severity):
    """To a tenth of what they judge by."""
    case = EXTREMES[family].case(severity, seed=3)
    a, _ = Oracle(case.scene).solve(case.q, case.v, case.tau, REFERENCE_RANK)
    scale = max(float(max(abs(a))), 9.81)
    right = right_answers(case)[0]
    assert float(max(abs(a - right))) < 1e-9 * scale


@pytest.mark.parametrize(
    "solver", [cp.dynamics.Reference(), cp.DenseKKT(), cp.Proximal(refinements=0)]
)
def test_where_reference_is_not_right_nothing_says_ok(solver):
    """A rod so thin that rounding of J^T lam spins it: the proof knows."""
    case = EXTREMES["light_rod"].case(1e-3, seed=3)
    a, _ = Oracle(case.scene).solve(case.q, case.v, case.tau, REFERENCE_RANK)
    found = cp.solve(case.scene, case.q, case.v, case.tau, solver=solver, throw=False)
    error = float(max(abs(a - found.a)) / max(abs(a)))
    assert error > 1e-9
    assert found.error_bound > error
    assert not found.status.ok


def test_proximal_corrects_what_rounding_spoils():
    """By default, where M is so badly conditioned that rounding alone would."""
    case = EXTREMES["light_rod"].case(1e-3, seed=3)
    a, _ = Oracle(case.scene).solve(case.q, case.v, case.tau, REFERENCE_RANK)
    found = cp.solve(case.scene, case.q, case.v, case.tau, solver=cp.Proximal(), throw=False)
    assert float(max(abs(a - found.a)) / max(abs(a))) < 1e-11


def test_the_oracle_has_its_digits():
    """A pendulum of 1 m and 1 kg, by its formula, to 45 digits."""
    scene = cp.Scene(cp.model.pendulum())
    q = np.array([0.3])
    a, _ = Oracle(scene).solve(q, np.array([2.0]), np.array([0.5]))
    wanted = mp.mpf(0.5) - mp.mpf(9.81) * mp.sin(mp.mpf(q[0]))
    assert abs(a[0] - wanted) < mp.mpf(10) ** -45


def light_cells(seed: int) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """Nearly flat parallelograms of bars with masses over decades, some of them fast."""
    rng = np.random.default_rng(seed)
    cells, angle = int(rng.integers(1, 4)), 10 ** rng.uniform(-7.2, -4)
    least, most = [(-1, 1), (-3, 3), (-4, 2)][seed % 3]
    linkage = cp.model.n_four_bar(cells)
    inertias = list(linkage.model.inertias)
    for joint, bar in enumerate(inertias[1:], start=1):
        share = 10 ** rng.uniform(least, most)
        inertias[joint] = pin.Inertia(share * bar.mass, bar.lever, share * bar.inertia)
    linkage = replace(linkage, model=with_inertias(linkage.model, inertias))
    along = np.ones(2 * cells + 1)
    along[1::2] = -1.0
    v = rng.normal() * along * 10 ** rng.uniform(-1, 2) * (seed % 2)
    tau = rng.normal(size=len(along))
    return cp.Scene(linkage, linkage.loops), angle * along, v, tau


@pytest.mark.parametrize("seed", [17, 31, 72, 75, 93, 99, 165, 207, 211])
def test_what_rounding_of_the_rows_spoils_is_not_ok(seed):
    """The residuals are those of rounded rows: they said 1e-14 of errors of 1e-8 to 1e-5."""
    scene, q, v, tau = light_cells(seed)
    right = [Oracle(scene).solve(q, v, tau, share)[0] for share in (1e-14, 1e-11, 2.2e-8)]
    for name in ("gaussprinciple", "nullspace", "reference", "proximal", "conjugategradient"):
        found = cp.solve(scene, q, v, tau, solver=cp.dynamics.SOLVERS[name](), throw=False)
        scale = max(float(np.abs(found.a).max()), 9.81)
        error = min(float(max(abs(a - found.a))) for a in right) / scale
        assert error < 1e-8 or not found.status.ok, name


# --- bounds


def rod_at(length: float, seed: int, beside: tuple[cp.constraints.Constraint, ...] = ()):
    """The machine of every joint at a state where a rod of some length has just that."""
    rng = np.random.default_rng(seed)
    model = pin.Model(every_joint().model)
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    along = rng.normal(size=3)
    end = data.oMf[model.getFrameId("hand")].translation + length * along / np.linalg.norm(along)
    foot = model.frames[model.getFrameId("foot")].parentJoint
    place = pin.SE3(np.eye(3), data.oMi[foot].actInv(end))
    model.addFrame(pin.Frame("near", foot, 0, place, pin.FrameType.OP_FRAME))
    robot = cp.Robot("rod", model, precision=0.0)  # what is beside it may be open
    scene = cp.Scene(robot, [cp.Loop("hand", "near", "rod", length=length), *beside])
    return scene, (q, rng.normal(size=model.nv), 10.0 * rng.normal(size=model.nv))


@pytest.mark.values
@pytest.mark.parametrize("length", [1e-1, 1e-3, 1e-5, 1e-7, 1e-11, 1e-16])
@pytest.mark.parametrize("beside", ["none", "point", "gear", "to the world"])
def test_bounds_know_that_rounding_turns_a_short_rod(length, beside):
    """Residuals have the same direction as the answer: they said 5e-15 of errors up to 2e-3."""
    scene, state = rod_at(length, 3, KINDS.get(beside, ()))
    right, _ = Oracle(scene).solve(*state)
    for solver in (cp.dynamics.NullSpace(), cp.dynamics.Reference()):
        solution = cp.solve(scene, *state, solver=solver, throw=False)
        error = float(max(abs(right - solution.a)))
        assert error <= solution.error_bound * max(float(np.abs(solution.a).max()), 9.81)
        assert solution.status.ok == (solution.error_bound <= 1e-8)
        assert solution.status.ok or length < 1e-5


def test_a_rod_that_its_state_leaves_open_is_as_long_as_it_is_there():
    """The nominal state has another length between its ends."""
    scene, state = rod_at(1e-12, 4)
    other = cp.Scene(scene.robot, [replace(scene.constraints[0], length=0.5)])
    solution = cp.solve(other, *state, solver=cp.dynamics.NullSpace(), throw=False)
    error = float(max(abs(Oracle(other).solve(*state)[0] - solution.a)))
    assert error <= solution.error_bound * max(float(np.abs(solution.a).max()), 9.81)
    assert not solution.status.ok


@pytest.mark.values
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(2))
def test_bounds_are_bounds_at_any_state_of_any_kind(kind, seed):
    scene = cp.Scene(replace(every_joint(), precision=0.0), KINDS[kind])
    rng, model = np.random.default_rng(seed), scene.robot.model
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    v, tau = rng.normal(size=(2, model.nv))
    right, _ = Oracle(scene).solve(q, 3.0 * v, 100.0 * tau)
    for solver in (cp.dynamics.NullSpace(), cp.dynamics.Reference()):
        solution = cp.solve(scene, q, 3.0 * v, 100.0 * tau, solver=solver, throw=False)
        error = float(max(abs(right - solution.a))) / max(float(np.abs(solution.a).max()), 9.81)
        assert error <= 2.0 * solution.error_bound
        assert solution.status.ok


@pytest.mark.parametrize("across", [1e-6, 1e-8])
def test_light_turns_that_are_held_do_not_spoil_a_bound(across):
    """A slender rod in a hinge: its spin feels next to nothing, and the hinge holds it."""
    model = pin.Model()
    free = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "rod")
    body = pin.Inertia(1.5, np.array([1.0, 0.0, 0.0]), np.diag([across, 0.5, 0.5]))
    model.appendBodyToJoint(free, body, pin.SE3.Identity())
    for name, joint in (("eye", free), ("pin", 0)):
        frame = pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
        model.addFrame(frame)
    scene = cp.Scene(cp.Robot("rod", model), [cp.Loop("eye", "pin", "hinge", axis="z")])
    q = np.r_[0, 0, 0, 0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)]
    v = np.r_[np.zeros(5), 5.0]
    right, _ = Oracle(scene).solve(q, v, np.zeros(6))
    for solver in (cp.Proximal(), cp.dynamics.NullSpace(), cp.dynamics.Reference()):
        solution = cp.solve(scene, q, v, np.zeros(6), solver=solver)
        assert float(max(abs(right - solution.a))) <= 9.81 * solution.error_bound + 1e-15


@pytest.mark.parametrize("solver", [cp.Proximal(), cp.dynamics.NullSpace()])
def test_a_light_body_is_not_moved_by_the_residual_of_a_heavy_one(solver):
    """Bodies that do not touch: forces of 1e5 N were said to shake a speck of 1e-9 kg."""
    speck, ball = cp.model.free_box(mass=1e-9), cp.model.free_ball(mass=1.0)
    scene = cp.Scene(
        cp.model.together({"a": speck, "b": ball}), [cp.SurfaceContact("b/ball", anchor=None)]
    )
    q, v = scene.state()
    tau = np.r_[np.zeros(6), 1e5 * np.ones(6)]
    solution = cp.solve(scene, q, v, tau, solver=solver)
    np.testing.assert_allclose(solution.a[:6], [0, 0, -9.81, 0, 0, 0], atol=1e-9)
