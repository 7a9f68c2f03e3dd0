"""Spring-dampers between two frames: closed forms, energies, stiffness, and who else knows them.

f = k (l - l0) + c l'
"""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, robot
from test_applied_forces import chain_on, joints, state_of
from viewed import drawing

import condyn_pin as cp
from condyn_pin.model.springs import SpringDampers
from condyn_pin.simulation.system import System, with_rows
from condyn_pin.simulation.torques import PassiveForces
from condyn_pin.study.fresh import fingerprint

INTEGRATORS = cp.simulation.INTEGRATORS

MASSES = (1.0, 2.0)  # [kg]
REDUCED = MASSES[0] * MASSES[1] / sum(MASSES)  # [kg]
STILL = np.zeros(6)


def two_masses(*springs: cp.model.SpringDamper, gravity: bool = False) -> cp.Scene:
    """Two points that move freely."""
    model = pin.Model()
    for name, mass in zip("ab", MASSES, strict=True):
        joint = model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), name)
        point = pin.Inertia(mass, np.zeros(3), 1e-3 * np.eye(3))
        model.appendBodyToJoint(joint, point, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name}0", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    if not gravity:
        model.gravity = pin.Motion.Zero()
    return cp.Scene(cp.Robot("two_masses", model, spring_dampers=springs))


def apart(q: np.ndarray) -> np.ndarray:
    """The distance of the two masses."""
    return np.linalg.norm(q[..., 3:] - q[..., :3], axis=-1)


# Along no axis, so that every coordinate takes part.
ALONG = np.array([2.0, -1.0, 2.0]) / 3
STRETCHED = np.concatenate([np.zeros(3), 0.6 * ALONG])


@pytest.mark.parametrize("method", [kind() for kind in INTEGRATORS.values()], ids=list(INTEGRATORS))
def test_two_masses_swing_at_their_frequency(method):
    """x = x0 cos(w t), w^2 = k / (m1 m2 / (m1 + m2)): after a period it is where it was."""
    k = 100.0
    scene = two_masses(cp.model.SpringDamper("a0", "b0", k, rest_length=0.5))
    period = 2 * np.pi * np.sqrt(REDUCED / k)
    errors = []
    for steps in (200, 400):
        run = cp.simulate(
            scene, STRETCHED, STILL, duration=period, dt=period / steps, integrator=method
        )
        share = np.cos(2 * np.pi * run.t / period)
        errors.append(np.abs(apart(run.q) - (0.5 + 0.1 * share)).max())
        assert run.energy.springs[0] == pytest.approx(0.5 * k * 0.1**2)
    order = min(method.order)
    assert errors[1] < (1e-2 if order == 1 else 1e-4)
    if not method.is_adaptive:
        assert errors[1] < errors[0] / 2 ** (order - 0.3) or errors[1] < 1e-11


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.7, 0.999, 3.0])
def test_two_masses_are_damped_as_they_should(ratio):
    """x = exp(-z w t) (x0 cosh(s t) + z w x0 / s sinh(s t)), s^2 = (z^2 - 1) w^2."""
    k = 100.0
    omega = np.sqrt(k / REDUCED)
    c = 2 * ratio * omega * REDUCED
    scene = two_masses(cp.model.SpringDamper("a0", "b0", k, c, 0.5))
    run = cp.simulate(scene, STRETCHED, STILL, duration=1.0, dt=5e-4)
    s = np.emath.sqrt(ratio**2 - 1) * omega
    decay, t = ratio * omega, run.t
    wanted = 0.1 * np.exp(-decay * t) * np.real(np.cosh(s * t) + decay / s * np.sinh(s * t))
    assert np.abs(apart(run.q) - 0.5 - wanted).max() < 1e-8
    assert np.abs(run.energy.error).max() < 1e-7 * run.energy.scale
    assert np.abs(run.momentum[:, :3]).max() < 1e-13
    if ratio:
        assert run.energy.damping[-1] < -1e-2


SPRINGS = (
    cp.model.SpringDamper("tip", "side", 300.0, 20.0, 0.4),
    cp.model.SpringDamper("middle", "world", 500.0, 0.0, 0.0),
    cp.model.SpringDamper("world", "tip", 0.0, 30.0),
)


def sprung(kind: str) -> cp.Robot:
    return replace(chain_on(kind), spring_dampers=SPRINGS)


@pytest.mark.parametrize("kind", list(joints()))
def test_torques_are_the_slope_of_the_energy(kind):
    """tau = -dE/dq of the springs, and tau . v = -c l'^2 of the dampers, of every kind of joint."""
    made = sprung(kind)
    q, v, _ = state_of(made, 2)
    passive = PassiveForces.of(made)

    def energy(step: np.ndarray) -> float:
        return float(passive.energy(np.array(pin.integrate(made.model, q, step))))

    stencil, h = (4 / 5, -1 / 5, 4 / 105, -1 / 280), 0.01
    slope = [
        sum(
            w / h * (energy(k * h * e) - energy(-k * h * e)) for k, w in enumerate(stencil, start=1)
        )
        for e in np.eye(made.nv)
    ]
    still = made.passive_torque(q, 0 * v)
    assert np.abs(still + slope).max() <= 1e-8 * np.abs(still).max()
    power = (made.passive_torque(q, v) - still) @ v
    taken = passive.dissipation(q[None], v[None])[0]
    assert taken > 1e-3
    assert power == pytest.approx(-taken, rel=1e-11)

    def lengths(t: float) -> np.ndarray:
        return passive.between.stretch(np.array(pin.integrate(made.model, q, t * v))).length

    rates = sum(w / h * (lengths(k * h) - lengths(-k * h)) for k, w in enumerate(stencil, start=1))
    assert taken == pytest.approx(rates**2 @ passive.between.c, rel=1e-8)


@pytest.mark.parametrize("kind", ["universal", "spherical", "free_flyer"])
def test_energy_is_balanced(kind):
    made = sprung(kind)
    q, v, tau = state_of(made, 3)
    run = cp.simulate(cp.Scene(made), q, v, tau, duration=0.2, dt=5e-4)
    assert np.ptp(run.energy.springs) > 1.0
    assert np.abs(run.energy.error).max() < 1e-6 * run.energy.scale
    first = cp.solve(cp.Scene(made), q, v, tau + made.passive_torque(q, v))
    assert np.abs(first.a - run.a[0]).max() <= 1e-10 * np.abs(first.a).max()
    text = run.run.effects.text(made)
    assert "springs" in text.partition(";")[0]
    assert "damping" in text.partition(";")[0]


@pytest.mark.long
def test_effects_turn_them_off():
    made = sprung("revolute")
    q, v, _ = state_of(made, 3)
    bare = replace(made, spring_dampers=())
    for off, kept in (
        ({"springs": False, "damping": False}, ()),
        ({"springs": False}, [replace(s, stiffness=0.0) for s in SPRINGS]),
        ({"damping": False}, [replace(s, damping=0.0) for s in SPRINGS]),
    ):
        had = cp.simulate(cp.Scene(made), q, v, duration=0.02, **off)
        want = cp.simulate(cp.Scene(replace(bare, spring_dampers=kept)), q, v, duration=0.02)
        assert np.abs(had.q - want.q).max() < 1e-14
        assert np.abs(had.energy.springs - want.energy.springs).max() < 1e-12
        assert np.abs(had.energy.damping - want.energy.damping).max() < 1e-12


# ---------------------------------------------------------------------------------------------
# Stiff ones

IMPLICIT = ("semiimpliciteuler", "implicitmidpoint", "linearlyimplicitmidpoint",
            "generalisedalpha", "radauiia", "gearguptaleimkuhler")  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("integrator", [*IMPLICIT, "dormandprince", "rattle"])
def test_a_stiff_damper_breaks_no_implicit_method(integrator):
    """k = 8e5 N/m, c = 4e4 N s/m: a rate of 6e4 / s at dt = 1 ms, and a slow creep of 20 / s.

    Of x'' + (c x' + k x) / m = 0 the slow root alone is left after some steps.
    """
    k, c = 8e5, 4e4
    scene = two_masses(cp.model.SpringDamper("a0", "b0", k, c, 0.5))
    run = cp.simulate(scene, STRETCHED, STILL, duration=0.1, integrator=INTEGRATORS[integrator]())
    assert run.status.ok
    decay = c / (2 * REDUCED)
    slow = decay - np.sqrt(decay**2 - k / REDUCED)
    fast = decay + np.sqrt(decay**2 - k / REDUCED)
    wanted = 0.1 * (fast * np.exp(-slow * 0.1) - slow * np.exp(-fast * 0.1)) / (fast - slow)
    first_order = min(INTEGRATORS[integrator]().order) == 1
    limit = 1e-3 if first_order or integrator == "generalisedalpha" else 1e-5
    assert abs(apart(run.q[-1]) - 0.5 - wanted) < limit
    assert np.abs(run.momentum[:, :3]).max() < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("integrator", IMPLICIT)
def test_a_stiff_spring_without_length_holds_sideways_too(integrator):
    """k = 1e9 N/m on a free body that flies: as stiff across as along, 2e4 rad/s at dt = 1 ms."""
    made = chain_on("free_flyer")
    tied = replace(made, spring_dampers=[cp.model.SpringDamper("middle", "world", 1e9)])
    q, v, _ = state_of(tied, 1)
    v = 0.1 * v  # else it would be thrown by half a million newton within a step
    passive = PassiveForces.of(tied)
    # from where the two coincide: the base is moved there by Newton's method
    for _ in range(50):
        at = passive.between.stretch(q)
        r = at.length[0] * at.n[0]
        q = np.array(pin.integrate(tied.model, q, -np.linalg.lstsq(at.J[0], r, rcond=None)[0]))
    run = cp.simulate(cp.Scene(tied), q, v, duration=0.05, integrator=INTEGRATORS[integrator]())
    assert run.status.ok
    length = [passive.between.stretch(each).length[0] for each in run.q]
    assert max(length) < 2e-4
    assert np.abs(run.v).max() < 1e1


def test_explicit_methods_say_which_damper_is_too_stiff():
    scene = two_masses(cp.model.SpringDamper("a0", "b0", 8e5, 4e4, 0.5))
    run = cp.simulate(scene, STRETCHED, STILL, duration=0.1)
    assert run.status is cp.simulation.RunStatus.DIVERGED
    assert "the damping between a0 - b0 (4e+04 N s/m) has a rate of 6e+04 / s" in run.reason


@pytest.mark.parametrize(
    "integrator",
    [
        None,
        cp.simulation.StormerVerlet(),
        cp.simulation.Leapfrog(),
        cp.simulation.Rattle(),
        cp.simulation.ExplicitEuler(),
    ],
)
def test_explicit_methods_say_which_spring_is_too_stiff(integrator):
    """The root of k over the reduced mass."""
    scene = two_masses(cp.model.SpringDamper("a0", "b0", 1e8, 0.0, 0.5))
    run = cp.simulate(scene, STRETCHED, STILL, duration=1.0, integrator=integrator)
    assert run.status is cp.simulation.RunStatus.DIVERGED
    frequency = np.sqrt(1e8 * sum(1 / mass for mass in MASSES))
    said = f"the spring between a0 - b0 (1e+08 N/m) has a frequency of {frequency:.3g} rad/s"
    assert said in run.reason


@pytest.mark.long
def test_a_stiff_spring_of_a_joint_in_a_loop_is_named():
    """The root of k over the inertia that the motor sees."""
    bar = robot("four_bar")
    joint = bar.joints[0]
    model = pin.Model(bar.model)
    model.damping = np.zeros(3)
    scene = cp.Scene(replace(bar, model=model, springs=[cp.model.Spring(joint, 1e8)]), bar.loops)
    q, v = scene.state()
    run = cp.simulate(scene, q, v, duration=0.5)
    assert run.status is cp.simulation.RunStatus.DIVERGED
    # a unit torque at the spring moves its joint by its share of P
    pushed, still = (cp.solve(scene, q, v, tau).a for tau in (np.eye(3)[0], np.zeros(3)))
    frequency = np.sqrt(1e8 * (pushed - still)[0])
    assert f"the spring of joint {joint!r} (1e+08 N m/rad or N/m) has a freq" in run.reason
    assert f"{frequency:.3g} rad/s" in run.reason


@pytest.mark.parametrize("label", ["tree", "loop"])
def test_the_implicit_system_solves_its_equations(label):
    """(M + dt D + dt^2 K) a + h = tau - (D + dt K) v - f + J^T lam, against one dense matrix."""
    if label == "tree":
        scene = cp.Scene(sprung("universal"))
    else:
        bar = robot("four_bar")
        made = replace(
            bar,
            spring_dampers=[
                cp.model.SpringDamper("world", "coupler_tip", 1e7, 1e5, 0.1),
                cp.model.SpringDamper("crank_tip", "rocker_tip", 1e3, 1e1, 0.0),
            ],
        )
        scene = cp.Scene(made, made.loops)
    made, dt = scene.robot, 1e-3
    q, v = scene.sample(np.random.default_rng(6))
    tau = np.linspace(-1, 1, made.nv)
    system = System(cp.Workspace(scene), tau)
    found = system.implicit(dt).acceleration(0.0, q, v)
    terms, passive = system.equations.terms(q, v), system.passive
    K, D = passive.stiffness_matrix(q), passive.damping_matrix(q)
    assert np.abs(K - K.T).max() <= 1e-12 * np.abs(K).max()
    assert np.linalg.eigvalsh(K).min() > -1e-9 * np.abs(K).max()
    heavy = terms.M + dt * D + dt**2 * K
    assert np.abs(system.implicit(dt).mass(q) - heavy).max() <= 1e-12 * np.abs(heavy).max()
    rhs = tau + passive.torque(q, v) - dt * K @ v - terms.h
    m = len(terms.J)
    whole = np.block([[heavy, -terms.J.T], [terms.J, np.zeros((m, m))]])
    wanted = np.linalg.lstsq(whole, np.concatenate([rhs, -terms.gamma]), rcond=1e-13)[0]
    assert np.abs(found - wanted[: made.nv]).max() <= 1e-8 * np.abs(wanted[: made.nv]).max()
    lam = system.implicit(dt).lam()
    left = heavy @ found - rhs - terms.J.T @ lam
    assert np.abs(left).max() <= 1e-8 * np.abs(rhs).max()


@pytest.mark.parametrize("weight", [1e-9, 1.0, 1e9])
def test_rows_of_inertia_are_added_by_solves(weight):
    rng = np.random.default_rng(8)
    A = rng.normal(size=(6, 6))
    M, rows, weights = A @ A.T + np.eye(6), rng.normal(size=(3, 6)), weight * rng.uniform(1, 2, 3)
    h, tau = rng.normal(size=6), rng.normal(size=6)
    found = with_rows(lambda tau: np.linalg.solve(M, tau - h), tau, rows, weights)
    # the same with the force f = w U a as an unknown, which no weight makes ill-conditioned
    whole = np.block([[M, rows.T], [rows, -np.diag(1 / weights)]])
    wanted = np.linalg.solve(whole, np.concatenate([tau - h, np.zeros(3)]))[:6]
    assert np.abs(found - wanted).max() <= 1e-12 * max(np.abs(wanted).max(), 1.0)
    assert np.array_equal(with_rows(lambda tau: tau, np.zeros(6), rows, weights), np.zeros(6))


# ---------------------------------------------------------------------------------------------
# Where there is no direction, and what is refused


def test_where_the_ends_coincide_nothing_pulls():
    for rest in (0.0, 0.5):
        scene = two_masses(cp.model.SpringDamper("a0", "b0", 100.0, 3.0, rest))
        v = np.array([1.0, 0.0, 0.0, -1.0, 0.5, 0.0])
        torque = scene.robot.passive_torque(np.zeros(6), v)
        assert np.array_equal(torque, np.zeros(6))
        dampers = SpringDampers(scene.robot, scene.robot.spring_dampers)
        for matrix in (dampers.stiffness(np.zeros(6)), dampers.damping(np.zeros(6))):
            assert np.isfinite(matrix).all()


@pytest.mark.long
def test_a_spring_goes_through_zero_length():
    """Without a rest length it is harmonic in space, through the middle and out again."""
    k = 100.0
    scene = two_masses(cp.model.SpringDamper("a0", "b0", k))
    half = np.pi * np.sqrt(REDUCED / k)
    run = cp.simulate(scene, STRETCHED, STILL, duration=half, dt=half / 500)
    r = run.q[-1][3:] - run.q[-1][:3]
    assert np.abs(r + 0.6 * ALONG).max() < 1e-9


@each_row(
    ("change", "said"),
    [
        ({"stiffness": -1.0}, "stiffness = -1.0: zero or more"),
        ({"stiffness": np.nan}, "stiffness = nan"),
        ({"damping": -1e-9}, "damping = -1e-09"),
        ({"rest_length": -0.1}, "rest_length = -0.1"),
        ({"rest_length": "far"}, "rest_length"),
        ({"stiffness": 1e200}, "no machine has that"),
        ({"frame_a": ""}, "frame_a = ''"),
        ({"frame_b": 3}, "frame_b = 3"),
        ({"frame_b": "a0"}, "frame_b = 'a0' is frame_a too"),
    ],
)
def test_what_is_no_spring_damper_is_refused(change, said):
    with pytest.raises(cp.InvalidArgument) as error:
        cp.model.SpringDamper(**{"frame_a": "a0", "frame_b": "b0", "stiffness": 1.0, **change})
    assert said in str(error.value)


def test_a_robot_refuses_ends_that_it_does_not_have():
    made = chain_on("revolute").with_frame("parameter", "tip", (0.0, 0.0, 0.1))
    with pytest.raises(cp.errors.UnknownName, match="no frame named 'tipp'"):
        replace(made, spring_dampers=[cp.model.SpringDamper("tipp", "world", 1.0)])
    with pytest.raises(cp.errors.InvalidModel, match="both are on one body"):
        replace(made, spring_dampers=[cp.model.SpringDamper("tip", "parameter", 1.0)])
    with pytest.raises(cp.InvalidArgument, match="is not a SpringDamper"):
        replace(made, spring_dampers=[cp.model.Spring("j0", 1.0)])


# ---------------------------------------------------------------------------------------------
# Who else knows them


def test_robots_keep_them(tmp_path):
    made = sprung("revolute")
    bare = replace(made, spring_dampers=())
    assert made == pickle.loads(pickle.dumps(made)) != bare
    assert made.with_frame("more", "tip", (0, 0, 1)).spring_dampers == SPRINGS
    scene = cp.Scene(made)
    assert any(text.startswith("spring-dampers (tip - side, ") for text in scene.summary().unused)
    assert fingerprint(scene) != fingerprint(cp.Scene(bare))
    q, v, _ = state_of(made)
    run = cp.simulate(scene, q, v, duration=0.01)
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert again.scene.robot.spring_dampers == SPRINGS
    assert np.array_equal(again.energy.springs, run.energy.springs)
    event = cp.Event(name="let go", at=0.005, scene=cp.Scene(bare))
    with pytest.raises(cp.InvalidArgument, match="other springs than the one simulated"):
        cp.simulate(scene, q, v, duration=0.01, events=[event])


def test_smaller_robots_keep_those_that_still_pull():
    made = sprung("revolute")
    scene = cp.Scene(made)
    locked = scene.lock(["j2", "j3"]).robot
    assert locked.spring_dampers == SPRINGS
    rigid = scene.lock(["j1", "j2", "j3", "branch"]).robot
    assert rigid.spring_dampers == SPRINGS[1:]


def test_mujoco_has_the_same_forces():
    mujoco = pytest.importorskip("mujoco")
    made = sprung("spherical")
    mj = mujoco.MjModel.from_xml_string(made.to_mjcf())
    data, bridge = mujoco.MjData(mj), cp.study.MujocoBridge(made, mj)
    for seed in range(3):
        q, v, _ = state_of(made, seed)
        data.qpos[:], data.qvel[:] = bridge.to_mujoco(q, v)
        mujoco.mj_forward(mj, data)
        wanted = bridge.torque_from_mujoco(q, data.qfrc_passive)
        found = made.passive_torque(q, v)
        assert np.abs(found - wanted).max() <= 1e-10 * np.abs(found).max()
    check = bridge.compare(*state_of(made))
    assert not any("tendons" in note for note in check.notes), check


def test_they_are_seen():
    made = sprung("revolute")
    q, _, _ = state_of(made)
    found = drawing(cp.Scene(made), q)
    seen = {part.path: part for part in found.parts if part.path.startswith("springs/")}
    assert len(seen) == len(SPRINGS)
    at = PassiveForces.of(made).between.stretch(q)
    for part, length in zip(seen.values(), at.length, strict=True):
        T = part.place(found.instants[0])
        assert np.linalg.norm(T[:3, 2]) == pytest.approx(length)
    assert "spring and damper" in found.html()
