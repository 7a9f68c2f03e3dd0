"""placo: one quadratic program for eiquadprog; wrenches of soles within CoP and friction."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import placo

from peers.control.harness import Contender, main
from peers.control.question import Question


class Engine:
    """The robot, the solver, and its tasks."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.robot = placo.RobotWrapper(question.urdf)
        names = list(self.robot.joint_names())
        model = self.robot.model
        for name in names:
            at = model.joints[model.getJointId(name)].idx_v
            self.robot.set_gear_ratio(name, 1.0)
            self.robot.set_rotor_inertia(name, float(question.armature[at]))
            self.robot.set_torque_limit(name, float(question.effort[at]))
        self._state(question.home, np.zeros(model.nv))
        self.solver = placo.DynamicsSolver(self.robot)
        self.solver.enable_torque_limits(True)
        self.solver.enable_joint_limits(False)
        self.solver.enable_velocity_limits(False)
        self.solver.dt = 1e-3
        self._stand()
        self._wish(names)

    def _stand(self) -> None:
        question = self.question
        self.feet = []
        for foot in question.feet:
            task = self.solver.add_frame_task(foot, self.robot.get_T_world_frame(foot))
            task.configure(foot, "hard")
            for part in (task.position(), task.orientation()):
                part.kp = part.kd = 0.0
            contact = self.solver.add_planar_contact(task)
            contact.unilateral = True
            contact.length, contact.width = 2 * question.half_length, 2 * question.half_width
            contact.mu = question.wish.friction
            contact.weight_forces = contact.weight_moments = 1e-9
            self.feet.append((foot, contact))

    def _wish(self, names: list[str]) -> None:
        question, wish = self.question, self.question.wish
        com = self.solver.add_com_task(question.com)
        home = self.robot.get_T_world_frame(question.trunk)
        trunk = self.solver.add_orientation_task(question.trunk, home[:3, :3])
        posture = self.solver.add_joints_task()
        posture.set_joints({name: self.robot.get_joint(name) for name in names})
        for task, name, kp, weight in (
            (com, "com", wish.com_kp, wish.com_weight),
            (trunk, "trunk", wish.trunk_kp, wish.trunk_weight),
            (posture, "posture", wish.posture_kp, wish.posture_weight),
        ):
            if np.isinf(weight):
                task.configure(name, "hard")
            else:
                task.configure(name, "soft", weight)
            task.kp, task.kd = kp, 2.0 * np.sqrt(kp)

    def _state(self, q: np.ndarray, v: np.ndarray) -> None:
        self.robot.state.q, self.robot.state.qd = q, v
        self.robot.update_kinematics()

    def tick(self, i: int) -> float:
        """Return NaN after a whole tick: assembly and solver are one call."""
        self._state(self.question.q[i], self.question.v[i])
        self.solved = self.solver.solve(False)
        return float("nan")

    def answer(self, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a, tau, and what the feet do to the joints."""
        self.tick(i)
        if not self.solved.success:
            raise ValueError(f"state {i}: success is False")
        tau = np.array(self.solved.tau)
        tau[:6] = 0.0
        return np.array(self.solved.qdd), tau, np.array(self.solved.tau_contacts)


def contender(question: Question) -> Contender:
    """Return placo at work."""
    engine = Engine(question)
    engine.tick(0)
    problem = engine.solver.problem
    size = f"{problem.n_variables} unknowns, {problem.determined_variables} equations, "
    size += f"{problem.n_inequalities} inequalities"
    return Contender(engine.tick, engine.answer, size, "assembly and solver are one call")


if __name__ == "__main__":
    main("placo", version("placo"), contender)
