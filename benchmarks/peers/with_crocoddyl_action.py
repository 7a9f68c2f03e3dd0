"""Our steps in crocoddyl's hands, beside its own contact dynamics and by its own optimiser.

    python benchmarks/contact_peers.py crocoddyl

Talos on two soles, above legs that stand: costs are those of crocoddyl. So are `solve` and
`derivatives`, with the drift control that crocoddyl's gains stand for: a and its derivatives by x
and u are the same to 1e-9, no step between them. A step is that of its contact dynamics by Euler,
with gains [0, 1 / dt], to the order of both: over steps of four sizes, extrapolated to dt = 0, the
same to 1e-9. FDDP
finds the same motion with both. Solo12 crouches by FDDP on contacts that may open, for which
crocoddyl has no dynamics. It fails where one of these does not hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import crocoddyl
import numpy as np
import pinocchio as pin

import condyn_pin as cp

DT = 0.01  # [s]
STEPS = 10
STATES = 5
SIZES = 1e-3 / 2.0 ** np.arange(4)  # [s], of steps that are extrapolated
SAME = 1e-9
MOTION = ("xnext", "Fx", "Fu")
DYNAMICS = ("xout", "Fx", "Fu")
COSTS = ("cost", "Lx", "Lu", "Lxx", "Lxu", "Luu")
COSTS_AT_END = ("cost", "Lx", "Lxx")


@dataclass(frozen=True)
class Talos:
    """Talos on two soles, as both have it; crocoddyl knows no damping of joints."""

    scene: cp.Scene
    state: crocoddyl.StateMultibody

    @classmethod
    def load(cls) -> Talos:
        """Return it with one model for both."""
        robot = cp.load_robot("talos")
        model = pin.Model(robot.model)
        model.damping = np.zeros(model.nv)
        scene = cp.Scene(replace(robot, model=model), robot.contacts)
        return cls(scene, crocoddyl.StateMultibody(scene.robot.model))

    def ours(self, costs: crocoddyl.CostModelSum, dt: float) -> crocoddyl.ActionModelAbstract:
        """Return our step."""
        return cp.layers.crocoddyl_action(cp.layers.Action(self.scene, dt=dt), costs)

    def theirs(self, costs: crocoddyl.CostModelSum, dt: float) -> crocoddyl.ActionModelAbstract:
        """Return crocoddyl's, with feet whose velocity is gone after a step."""
        actuation = crocoddyl.ActuationModelFloatingBase(self.state)
        contacts = crocoddyl.ContactModelMultiple(self.state, actuation.nu)
        for contact in self.scene.constraints:
            made = crocoddyl.ContactModel6D(
                self.state,
                self.scene.robot.model.getFrameId(contact.frame),
                pin.SE3.Identity(),  # nowhere: the first gain, by which it is pulled there, is 0
                pin.ReferenceFrame.LOCAL,
                actuation.nu,
                np.array([0.0, 1 / dt]),
            )
            contacts.addContact(contact.name, made)
        dynamics = crocoddyl.DifferentialActionModelContactFwdDynamics(
            self.state, actuation, contacts, costs, 0.0, True
        )
        return crocoddyl.IntegratedActionModelEuler(dynamics, dt)

    def sample(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return a state whose legs stand while all above them moves, and torques."""
        model = self.scene.robot.model
        v = np.zeros(model.nv)
        for joint, name in zip(model.joints[2:], model.names[2:], strict=True):
            if not name.startswith("leg"):
                v[joint.idx_v] = rng.normal()
        q = pin.integrate(
            model, self.scene.state("half_sitting")[0], 0.1 * rng.normal(size=model.nv)
        )
        inertia = pin.crba(model, model.createData(), q).diagonal()[6:]
        return np.r_[q, v], 10.0 * inertia * rng.normal(size=model.nv - 6)


def costs_of(
    state: crocoddyl.StateMultibody, rest: np.ndarray, held: np.ndarray, goal: np.ndarray
) -> crocoddyl.CostModelSum:
    """Return costs of the centre of mass, of the state and of torques."""
    nu, costs = len(held), crocoddyl.CostModelSum(state, len(held))
    for name, residual, weight in (
        ("centre of mass", crocoddyl.ResidualModelCoMPosition(state, goal, nu), 1e4),
        ("state", crocoddyl.ResidualModelState(state, rest, nu), 1e-1),
        ("torques", crocoddyl.ResidualModelControl(state, held), 1e-5),
    ):
        costs.addCost(name, crocoddyl.CostModelResidual(state, residual), weight)
    return costs


def asked(
    model: crocoddyl.ActionModelAbstract, names: tuple[str, ...], *at: np.ndarray
) -> dict[str, np.ndarray]:
    """Return what calc and calcDiff write."""
    data = model.createData()
    model.calc(data, *at)
    model.calcDiff(data, *at)
    return {name: np.array(getattr(data, name)) for name in names}


def differences_of_costs(talos: Talos) -> dict[str, float]:
    """Return how far costs are from crocoddyl's, relative to the largest entry."""
    rng, worst = np.random.default_rng(0), dict.fromkeys(COSTS, 0.0)
    for _ in range(STATES):
        x, u = talos.sample(rng)
        costs = costs_of(talos.state, talos.state.rand(), 0.0 * u, rng.normal(size=3))
        for names, at in ((COSTS, (x, u)), (COSTS_AT_END, (x,))):
            ours = asked(talos.ours(costs, DT), names, *at)
            for name, wanted in asked(talos.theirs(costs, DT), names, *at).items():
                error = np.abs(ours[name] - wanted).max() / max(np.abs(wanted).max(), 1e-300)
                worst[name] = max(worst[name], float(error))
    return worst


def differences_of_dynamics(talos: Talos) -> dict[str, float]:
    """Return how far a, and a by x and u, are from those of crocoddyl's contact dynamics.

    Of `solve` and `derivatives` on the feet that hold, with the same drift control: kd = 1 / dt is
    2 alpha. No step has a part in it. Relative to the largest entry.
    """
    rng, worst = np.random.default_rng(2), dict.fromkeys(DYNAMICS, 0.0)
    workspace = cp.Workspace(talos.scene, drift=cp.Baumgarte(alpha=1 / (2 * DT), beta=0.0))
    B, nq = cp.layers.Action(talos.scene, DT).B, talos.state.nq
    for _ in range(STATES):
        x, u = talos.sample(rng)
        d = workspace.derivatives(x[:nq], x[nq:], B @ u)
        ours = d.solution.a, np.hstack([d.da_dq, d.da_dv]), d.da_dtau @ B
        dynamics = talos.theirs(costs_of(talos.state, x, u, np.zeros(3)), DT).differential
        theirs = asked(dynamics, DYNAMICS, x, u)
        for name, had in zip(DYNAMICS, ours, strict=True):
            error = np.abs(had - theirs[name]).max() / np.abs(theirs[name]).max()
            worst[name] = max(worst[name], float(error))
    return worst


def differences_of_motion(talos: Talos) -> dict[str, tuple[float, float]]:
    """Return how far steps over dt are from crocoddyl's: by the shortest, and by none.

    Relative to the largest entry of a or of its derivatives. By v along what feet allow: h is that
    of the mean velocity of the step here, and of the first one there.
    """
    rng, worst = np.random.default_rng(1), dict.fromkeys(MOTION, (0.0, 0.0))
    # the polynomial through steps of these sizes, where dt = 0
    weights = [np.prod([o / (o - dt) for o in SIZES if o != dt]) for dt in SIZES]
    for _ in range(STATES):
        x, u = talos.sample(rng)
        costs = costs_of(talos.state, x, u, np.zeros(3))
        apart = []
        for dt in SIZES:
            ours, theirs = (
                asked(made(costs, dt), MOTION, x, u) for made in (talos.ours, talos.theirs)
            )
            apart.append({name: (ours[name] - theirs[name]) / dt for name in MOTION})
        J = cp.Workspace(talos.scene).jacobian(x[: talos.state.nq])
        allowed = np.eye(2 * talos.state.nv)
        allowed[talos.state.nv :, talos.state.nv :] -= np.linalg.pinv(J) @ J
        dynamics = talos.theirs(costs, DT).differential
        sizes = asked(dynamics, ("xout", "Fx", "Fu"), x, u).values()
        for name, size in zip(MOTION, sizes, strict=True):
            each = [found[name] @ allowed if name == "Fx" else found[name] for found in apart]
            limit = sum(w * e for w, e in zip(weights, each, strict=True))
            both = [float(np.abs(e).max() / np.abs(size).max()) for e in (each[-1], limit)]
            worst[name] = max(worst[name][0], both[0]), max(worst[name][1], both[1])
    return worst


def solved(
    model: crocoddyl.ActionModelAbstract, x: np.ndarray, u: np.ndarray
) -> crocoddyl.SolverFDDP:
    """Return FDDP after a motion of STEPS from x, begun with torques u."""
    problem = crocoddyl.ShootingProblem(x, [model] * STEPS, model)
    solver = crocoddyl.SolverFDDP(problem)
    solver.th_stop = 1e-10
    us = [u] * STEPS
    assert solver.solve(problem.rollout(us), us, 50, False), "FDDP did not converge"
    return solver


def leaning(talos: Talos) -> tuple[crocoddyl.SolverFDDP, crocoddyl.SolverFDDP]:
    """Return FDDP with ours and with crocoddyl's: the centre of mass goes 2 cm to the left."""
    model, q = talos.scene.robot.model, talos.scene.state("half_sitting")[0]
    held = cp.control.gravity_compensation(talos.scene, q).u
    x, u = np.r_[q, np.zeros(model.nv)], held
    goal = pin.centerOfMass(model, model.createData(), q) + np.array([0.0, 0.02, 0.0])
    costs = costs_of(talos.state, x, u, goal)
    return solved(talos.ours(costs, DT), x, u), solved(talos.theirs(costs, DT), x, u)


def crouching() -> tuple[float, float]:
    """Return how far Solo12's centre of mass is from its goal, before and after FDDP [m]."""
    robot = cp.load_robot("solo12")
    scene = cp.Scene(robot, contacts=robot.frictional_contacts(friction=0.7))
    q = cp.mechanism.place_on_ground(scene, scene.state()[0])
    model, data = robot.model, robot.model.createData()
    held = cp.control.gravity_compensation(cp.Scene(robot, robot.contacts), q).u
    x, start = np.r_[q, np.zeros(model.nv)], pin.centerOfMass(model, data, q).copy()
    goal = start - np.array([0.0, 0.0, 0.02])
    costs = costs_of(crocoddyl.StateMultibody(model), x, held, goal)
    solver = solved(cp.layers.crocoddyl_action(cp.layers.Action(scene, dt=DT), costs), x, held)
    end = pin.centerOfMass(model, data, np.array(solver.xs[-1])[: model.nq])
    return float(np.linalg.norm(start - goal)), float(np.linalg.norm(end - goal))


def main() -> None:
    """Compare, solve, print, and fail where something does not hold."""
    talos = Talos.load()
    found = differences_of_costs(talos)
    print("costs:", ", ".join(f"{name} {error:.0e}" for name, error in found.items()))
    bare = differences_of_dynamics(talos)
    print("accelerations:", ", ".join(f"{name} {error:.0e}" for name, error in bare.items()))
    moved = differences_of_motion(talos)
    for name, (near, limit) in moved.items():
        print(f"{name} over dt: {near:.0e} at {SIZES[-1]:g} s, {limit:.0e} extrapolated to 0")
    ours, theirs = leaning(talos)
    for name, solver in (("condyn_pin", ours), ("crocoddyl", theirs)):
        print(f"FDDP with {name}: cost {solver.cost:.6f} after {solver.iter} iterations")
    before, after = crouching()
    print(f"Solo12: {1e3 * before:.1f} mm from its goal, {1e3 * after:.1f} mm after FDDP")
    assert max(found.values()) < SAME
    assert max(bare.values()) < SAME
    assert max(limit for _, limit in moved.values()) < SAME
    assert abs(ours.cost - theirs.cost) < 1e-3 * theirs.cost
    assert after < 0.25 * before


if __name__ == "__main__":
    main()
