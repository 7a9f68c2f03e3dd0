"""States that leave the loops open, or make them open: what answers are there, and derivatives."""

from __future__ import annotations

import sys

import numpy as np
import pinocchio as pin
import pytest
from overconstrained import cart_with_a_door, machines, state_near, trammel
from shared import BLOCKS, DERIVATIVES, central

import condyn_pin as cp
from condyn_pin.constraints.rows.redundancy import KeptRows, Redundancy
from condyn_pin.dynamics.at_state import equations_of

# Off the constraints by so much in q [rad, m] and v; closed loops that stay closed are of
# test_derivatives.
NOISES = [(0.0, 0.03), (0.0, 1.0), (1e-8, 0.03), (1e-6, 0.0), (1e-4, 0.03), (1e-3, 1.0)]

SMALL = ("bennett", "trammel", "three cranks", "bricard", "cart with a door", "four_bar, hinge")

STEPS = (1e-3, 3e-4, 1e-4, 3e-5)


def along(answer, step, found, within=DERIVATIVES):
    """Compare found (da, dlam) along a direction with central differences, at one of some steps."""
    found = np.concatenate(found)
    errors = [np.abs(central(lambda t: answer(t * step), h) - found).max() for h in STEPS]
    assert min(errors) < within * max(np.abs(found).max(), 1.0), errors


def at_their_word(scene):
    """The same with precision 0."""
    robot = scene.robot
    exact = cp.Robot(robot.name, robot.model, postures=robot.postures, precision=0.0)
    return cp.Scene(exact, scene.constraints)


def answers_of(scene, state):
    """(a, lam) of Reference, to all digits, by a step (3 nv,) of q, v and tau."""
    workspace = cp.Workspace(scene, cp.dynamics.Reference(refinements=0))

    def answer(step):
        dq, dv, dtau = np.split(step, 3)
        q = pin.integrate(workspace.model, state[0], dq)
        found = workspace.solve(q, state[1] + dv, state[2] + dtau, throw=False)
        return np.concatenate([found.a, found.lam])

    return answer


@pytest.mark.values
@pytest.mark.parametrize(
    ("name", "noise"),
    [
        pytest.param(
            name, noise, marks=pytest.mark.long if (i + j) % 2 else (), id=f"{name}-{noise}"
        )
        for i, name in enumerate(machines())
        for j, noise in enumerate(NOISES)
    ],
)  # every second
def test_derivatives_are_those_of_the_answer(name, noise):
    """By q, v and tau, across the constraints too, where rows of closed loops are redundant."""
    scene = machines()[name]
    state, n = state_near(scene, *noise), scene.robot.nv
    found, rng = cp.derivatives(scene, *state), np.random.default_rng(7)
    for block in range(3):
        step = np.zeros((3, n))
        step[block] = rng.normal(size=n)
        along(answers_of(scene, state), step.ravel(), found.jvp(*step))


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("noise", [(0.0, 0.3), (1e-4, 0.03)], ids=str)
@pytest.mark.parametrize("name", SMALL)
def test_products_and_matrices_agree(name, noise):
    scene, rng = machines()[name], np.random.default_rng(2)
    d = cp.derivatives(scene, *state_near(scene, *noise))
    steps, weights = rng.normal(size=(3, scene.robot.nv)), rng.normal(size=scene.robot.nv)
    on_forces = rng.normal(size=scene.rows)
    by_a, by_lam = (
        np.hstack([getattr(d, f"{part}_d{x}") for x in ("q", "v", "tau")])
        for part in ("da", "dlam")
    )
    of_a, of_lam = d.jvp(*steps)
    backward = np.concatenate(d.vjp(weights, on_forces))
    size = 1e-12 * max(np.abs(by_a).max(), np.abs(by_lam).max(), 1.0) * scene.robot.nv
    assert np.abs(of_a - by_a @ steps.ravel()).max() < size
    assert np.abs(of_lam - by_lam @ steps.ravel()).max() < size
    assert np.abs(backward - weights @ by_a - on_forces @ by_lam).max() < size


@pytest.mark.parametrize("name", SMALL)
def test_differences_have_all_columns_and_check(name):
    scene = machines()[name]
    state = state_near(scene, 1e-4, 0.03)
    found = cp.derivatives(scene, *state, check=True)
    slow = cp.derivatives(scene, *state, method="differences")
    for block in BLOCKS:
        wanted = getattr(slow, block)
        size = max(np.abs(wanted).max(), 1.0)
        assert np.abs(getattr(found, block) - wanted).max() < DERIVATIVES * size, block


@pytest.mark.long
@pytest.mark.parametrize("noise", [(0.0, 0.3), (1e-4, 0.03)], ids=str)
def test_every_solver_has_the_same(noise):
    scene = machines()["cassie"]
    state = state_near(scene, *noise)
    solvers = (cp.dynamics.NullSpace(), cp.dynamics.GaussPrinciple(), cp.dynamics.Reference())
    first, *others = (cp.derivatives(scene, *state, solver=s) for s in (None, *solvers))
    for other in others:
        for block in BLOCKS:
            wanted = getattr(first, block)
            off = np.abs(getattr(other, block) - wanted).max()
            assert off < 1e-8 * max(np.abs(wanted).max(), 1.0), (other.solution, block)


@pytest.mark.parametrize("noise", [(0.0, 0.3), (1e-4, 0.03)], ids=str)
@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
@pytest.mark.parametrize("name", ["bennett", "bricard"])
def test_with_drift_and_forces(name, drift, noise):
    scene, rng = machines()[name], np.random.default_rng(4)
    state, n = state_near(scene, *noise), scene.robot.nv
    frame = scene.constraints[0].frame_a
    forces = [cp.AppliedForce(frame, rng.normal(size=6))]
    workspace = cp.Workspace(scene, drift=drift)
    found = workspace.derivatives(*state, forces=forces)

    def answer(step):
        q = pin.integrate(workspace.model, state[0], step)
        solution = workspace.solve(q, *state[1:], forces=forces, throw=False)
        return np.concatenate([solution.a, solution.lam])

    step = rng.normal(size=n)
    along(answer, step, found.jvp(step, 0 * step, 0 * step))


@pytest.mark.parametrize("noise", [(0.0, 0.3), (1e-4, 0.03)], ids=str)
@pytest.mark.parametrize("name", ["bennett", "bricard", "cart with a door"])
def test_by_gravity_and_inertias(name, noise):
    scene, rng = machines()[name], np.random.default_rng(5)
    state, model = state_near(scene, *noise), scene.robot.model
    found = cp.derivatives(scene, *state)

    def answer(change):
        changed = pin.Model(model)
        change(changed)
        robot = cp.Robot("changed", changed, postures=scene.robot.postures)
        solution = cp.solve(cp.Scene(robot, scene.constraints), *state, throw=False)
        return np.concatenate([solution.a, solution.lam])

    direction = rng.normal(size=3)

    def pulled(t):
        gravity = pin.Motion(model.gravity.linear + t * direction, np.zeros(3))
        return answer(lambda changed: setattr(changed, "gravity", gravity))

    def heavier(t):
        def change(changed):
            for i, Y in enumerate(list(model.inertias)[1:], 1):
                more = (1 + 0.1 * i * t) * Y.toDynamicParameters()
                changed.inertias[i] = pin.Inertia.FromDynamicParameters(more)

        return answer(change)

    own = [0.1 * i * Y.toDynamicParameters() for i, Y in enumerate(model.inertias) if i]
    for part, step, of in (
        (found.by_gravity(), direction, pulled),
        (found.by_inertias(), np.concatenate(own), heavier),
    ):
        wanted = central(of, 1e-3)
        size = max(np.abs(wanted).max(), 1.0)
        assert np.abs(np.vstack(part) @ step - wanted).max() < DERIVATIVES * size


@pytest.mark.parametrize("noise", [(0.0, 0.3), (1e-6, 0.3)], ids=str)
@pytest.mark.parametrize("end", ["first", "second"])
def test_by_the_placement_of_a_frame(end, noise):
    """A door whose post moves: what no acceleration satisfies turns with it."""
    scene, rng = cart_with_a_door(), np.random.default_rng(6)
    state, twist = state_near(scene, *noise), rng.normal(size=6)
    da, dlam = cp.derivatives(scene, *state).by_placement("post~edge", end)
    model = scene.robot.model
    i = model.getFrameId({"first": "post", "second": "edge"}[end])

    def moved(t):
        changed = pin.Model(model)
        changed.frames[i].placement = model.frames[i].placement * pin.exp6(t * twist)
        robot = cp.Robot("changed", changed, postures=scene.robot.postures)
        solution = cp.solve(cp.Scene(robot, scene.constraints), *state, throw=False)
        return np.concatenate([solution.a, solution.lam])

    wanted = central(moved, 1e-5)
    size = max(np.abs(wanted).max(), 1.0)
    assert np.abs(np.concatenate([da @ twist, dlam @ twist]) - wanted).max() < 1e-5 * size


@pytest.mark.parametrize("noise", [(0.0, 0.3), (1e-4, 0.03)], ids=str)
@pytest.mark.parametrize("name", ["cassie", "talos on eight points"])
def test_pinocchios_own_are_refused(name, noise):
    scene = machines()[name]
    with pytest.raises(cp.errors.DerivativesDisagree, match=r"open by .* method='kkt'"):
        cp.derivatives(scene, *state_near(scene, *noise), method="pinocchio")


@pytest.mark.pairs
@pytest.mark.parametrize("restitution", [0.0, 0.6])
@pytest.mark.parametrize("noise", [1e-8, 1e-4, 1e-3])
@pytest.mark.parametrize("name", [*SMALL, "cassie"])
def test_impacts(name, noise, restitution):
    scene, rng = machines()[name], np.random.default_rng(8)
    q, v, _ = state_near(scene, noise, 1.0)
    found = cp.impact(scene, q, v, restitution=restitution)
    closed = cp.impact(scene, state_near(scene, 0.0, 0.0)[0], v, restitution=restitution)
    for had, wanted in ((found.v, closed.v), (found.lam, closed.lam)):
        assert np.abs(had - wanted).max() < 100 * noise * max(np.abs(wanted).max(), 1.0)
    dq, dv = rng.normal(size=(2, scene.robot.nv))

    def answer(step):
        moved = pin.integrate(scene.robot.model, q, step[0] * dq)
        after = cp.impact(scene, moved, v + step[1] * dv, restitution=restitution)
        return np.concatenate([after.v, after.lam])

    along(answer, np.array([1.0, 0.0]), (found.dv_dq @ dq, found.dlam_dq @ dq))
    along(answer, np.array([0.0, 1.0]), (found.dv_dv @ dv, found.dlam_dv @ dv))


@pytest.mark.parametrize("method", ["kkt", "differences"])
@pytest.mark.parametrize("name", ["bricard", "cassie"])
def test_on_the_constraints_precision_changes_nothing(name, method):
    """To the bit: nothing is left out there but what was redundant before."""
    scene = machines()[name]
    state = state_near(scene, 0.0, 0.0)
    scenes = scene, at_their_word(scene)
    had, wanted = (cp.derivatives(s, *state, method=method) for s in scenes)
    for block in BLOCKS:
        assert np.array_equal(getattr(had, block), getattr(wanted, block)), block


@pytest.mark.long
@pytest.mark.parametrize("precision", [None, 0.0])
@pytest.mark.parametrize("open_by", [0.0, 0.3])
def test_a_door_that_is_nailed_to_its_cart(open_by, precision):
    """Its edge moves at right angles to it alone: two of three rows miss its turning at speed."""
    scene = cart_with_a_door(precision=precision)
    state = (np.array([0.0, open_by]), np.array([0.2, 1.0]), np.array([1.0, 2.0]))
    found = cp.derivatives(scene, *state, solver=cp.dynamics.Reference())
    rng = np.random.default_rng(9)
    for block in range(3):
        step = np.zeros((3, 2))
        step[block] = rng.normal(size=2)
        along(answers_of(scene, state), step.ravel(), found.jvp(*step))


@pytest.mark.parametrize("name", ["bennett", "trammel", "three cranks"])
def test_closed_loops_that_open_have_the_answer_of_the_kept_rows(name):
    """J v off by 0.3 on closed loops, where hinges and planar pins are solved by dense rows."""
    scene = machines()[name]
    state = state_near(scene, 0.0, 0.3)
    found, wanted = cp.solve(scene, *state), cp.solve(scene, *state, solver=cp.dynamics.Reference())
    assert np.abs(found.a - wanted.a).max() < 1e-9 * max(np.abs(wanted.a).max(), 1.0)
    assert np.abs(found.lam - wanted.lam).max() < 1e-9 * max(np.abs(wanted.lam).max(), 1.0)


@pytest.mark.long
def test_the_rank_of_closed_loops_is_that_of_rounding():
    """Newton's steps from a posture that moved may end at a gap that tells rows apart."""
    for leans in (0.5, 0.6, 0.7, 0.8):
        scene = trammel(leans=leans)
        state = state_near(scene, 1e-4, 0.0)
        assert cp.solve(scene, *state).rank == 2


@pytest.mark.long
@pytest.mark.parametrize("gap", [1e-5, 1e-3])
@pytest.mark.parametrize("name", ["bennett, flat", "three cranks", "bricard", "delta, hinges"])
def test_forces_have_no_part_in_the_singular_subspace(name, gap):
    """N = R U_n of the scaled rows R J D, with the smallest singular values."""
    scene = machines()[name]
    q, v, tau = state_near(scene, gap, 0.0)
    found, scales = cp.solve(scene, q, v, tau), scene.nominal.redundancy
    J = cp.Workspace(scene).equations.jacobian(q)
    U, _, _ = np.linalg.svd(scales.R[:, None] * J * scales.D)
    N = np.linalg.qr(scales.R[:, None] * U[:, found.rank :])[0]
    assert np.abs(N.T @ found.lam).max() < 1e-11 * np.abs(found.lam).max()


def calls_of(workspace, *state):
    """Names of all functions that a hot loop calls."""
    names = []

    def look(frame, event, function):
        if event == "call":
            names.append(frame.f_code.co_qualname)
        elif event == "c_call":
            names.append(function.__name__)

    before = sys.getprofile()
    sys.setprofile(look)
    try:
        workspace.acceleration(*state)
    finally:
        sys.setprofile(before)
    return names


@pytest.mark.long
@pytest.mark.parametrize("gap", [1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("name", ["four_bar, hinge", "four_bar, planar", "cart with a door"])
def test_open_loops_cost_no_more_where_rows_are_redundant_everywhere(name, gap):
    """In a plane the points in place of a hinge say the same at every configuration."""
    scene = machines()[name]
    (q, v, tau), nv = state_near(scene, 0.0, 0.0), scene.robot.nv
    at = q + gap * np.array([1.0, -0.5, 0.3])[:nv]
    if name == "cart with a door":
        v = np.array([v[0], 0.0])  # rows of a door that turns contradict each other
    workspace = cp.Workspace(scene)
    workspace.acceleration(at, v, tau)  # the first open state finds it out
    at_open, at_closed = (calls_of(workspace, x, v, tau) for x in (at, q))
    assert set(at_open) <= set(at_closed)
    assert len(at_open) <= len(at_closed)
    found = workspace.acceleration(at, v, tau)
    right = cp.solve(scene, at, v, tau, solver=cp.dynamics.Reference(), throw=False)
    size = max(np.abs(right.a).max(), 9.81)
    assert np.abs(found - right.a).max() < 100 * gap * size
    held = workspace.jacobian(at).T @ (workspace.lam() - right.lam)
    assert np.abs(held).max() < 100 * gap * size


@pytest.mark.long
@pytest.mark.values
@pytest.mark.parametrize("gap", [0.0, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize(
    "name", ["bennett", "three cranks", "bricard", "cassie", "cassie on its feet", "delta, hinges"]
)
def test_products_of_rows_keep_what_pivots_keep(name, gap, monkeypatch):
    """The basis of hot loops spans what is across N, and N is found without pivots."""
    scene = machines()[name]
    rows, redundancy = equations_of(scene), scene.nominal.redundancy
    q, _, _ = state_near(scene, gap, 0.0, seed=3)
    c, J = rows.position_level(q)
    found = KeptRows(redundancy, scene.nominal.terms.J)
    wanted = redundancy.left_out(J, c)
    if gap:

        def refuse(*_):
            pytest.fail("pivots are not needed here")

        monkeypatch.setattr(Redundancy, "kept_basis", refuse)
    V = found.basis(J, c)
    assert V.shape == (scene.rows, wanted.rank)
    Q, _ = np.linalg.qr(V)
    assert np.abs(Q @ Q.T + wanted.N @ wanted.N.T - np.eye(scene.rows)).max() < 1e-10


def test_rows_that_count_beside_a_closed_state_are_kept():
    """A row more than on closed loops, if the move that closes them is too short to explain it."""
    scene = machines()["bennett"]
    rows, redundancy = equations_of(scene), scene.nominal.redundancy
    q, _, _ = state_near(scene, 1e-3, 0.0)
    c, J = rows.position_level(q)
    V = KeptRows(redundancy, scene.nominal.terms.J).basis(J, 1e-6 * c)
    assert V.shape[1] == redundancy.left_out(J, 1e-6 * c).rank > redundancy.floor
