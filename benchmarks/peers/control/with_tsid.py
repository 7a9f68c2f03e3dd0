"""tsid: a hierarchy of two levels for eiquadprog; forces at the four corners of each sole."""

from __future__ import annotations

from importlib.metadata import version
from time import perf_counter

import numpy as np
import pinocchio as pin
from tsid import tsid_pywrap as tsid

from peers.control.harness import Contender, main, model_of
from peers.control.question import Question

_LARGEST = 1e5  # [N] of a contact: no limit
# weight of their regularisation: what a user takes, and, where an optimum is asked for, nearly none
_FORCES, _HARDLY = 1e-5, 1e-9


class Engine:
    """The formulation, its tasks, and its solver."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.robot = tsid.RobotWrapper(model_of(question), False)
        made = tsid.InverseDynamicsFormulationAccForce("talos", self.robot, False)
        made.computeProblemData(0.0, question.home, np.zeros(self.robot.nv))
        self.made, self.feet, self.tasks = made, [], []
        self._stand()
        self._wish()
        self.solver = tsid.SolverHQuadProgFast("eiquadprog")
        self.solver.resize(made.nVar, made.nEq, made.nIn)

    def _stand(self) -> None:
        question, model = self.question, self.robot.model()
        for foot in question.feet:
            contact = tsid.Contact6d(
                foot, self.robot, foot, question.corners, np.array([0.0, 0.0, 1.0]),
                question.wish.friction, 0.0, _LARGEST,
            )  # fmt: skip
            contact.setKp(np.zeros(6))
            contact.setKd(np.zeros(6))
            frame = model.getFrameId(foot)
            contact.setReference(self.robot.framePosition(self.made.data(), frame))
            self.made.addRigidContact(contact, _HARDLY if question.title else _FORCES)
            self.feet.append(contact)

    def _wish(self) -> None:
        question, wish, made = self.question, self.question.wish, self.made
        com = tsid.TaskComEquality("com", self.robot)
        trunk = tsid.TaskSE3Equality("trunk", self.robot, question.trunk)
        trunk.setMask(np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]))
        posture = tsid.TaskJointPosture("posture", self.robot)
        home = self.robot.framePosition(made.data(), self.robot.model().getFrameId(question.trunk))
        placed = np.concatenate((home.translation, home.rotation.T.ravel()))
        wanted = (
            (com, question.com, wish.com_kp, wish.com_weight, 3),
            (trunk, placed, wish.trunk_kp, wish.trunk_weight, 6),
            (posture, question.home[7:], wish.posture_kp, wish.posture_weight, self.robot.na),
        )
        for task, reference, kp, weight, size in wanted:
            task.setKp(kp * np.ones(size))
            task.setKd(2.0 * np.sqrt(kp) * np.ones(size))
            sample = tsid.TrajectorySample(len(reference), size)
            sample.value(reference)
            task.setReference(sample)
            hard = np.isinf(weight)
            made.addMotionTask(task, 1.0 if hard else weight, 0 if hard else 1, 0.0)
            self.tasks.append(task)  # tsid keeps no reference
        limits = tsid.TaskActuationBounds("limits", self.robot)
        limits.setBounds(-question.effort[6:], question.effort[6:])
        made.addActuationTask(limits, 1.0, 0, 0.0)
        self.tasks.append(limits)

    def tick(self, i: int) -> float:
        """Return the seconds of the solver, after a whole tick."""
        data = self.made.computeProblemData(0.0, self.question.q[i], self.question.v[i])
        start = perf_counter()
        self.solved = self.solver.solve(data)
        took = perf_counter() - start
        self.made.getActuatorForces(self.solved)
        return took

    def answer(self, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a, tau, and what the feet do to the joints."""
        self.tick(i)
        if self.solved.status:
            raise ValueError(f"state {i}: {self.solved.status}")
        a = np.array(self.made.getAccelerations(self.solved))
        tau = np.concatenate((np.zeros(6), self.made.getActuatorForces(self.solved)))
        model = self.robot.model()
        data = model.createData()
        pin.computeJointJacobians(model, data, self.question.q[i])
        pin.updateFramePlacements(model, data)
        felt = np.zeros(model.nv)
        for contact in self.feet:
            # tsid's forces are at the corners, in the axes of the world as the sole lies flat
            f = np.array(self.made.getContactForce(contact.name, self.solved))
            wrench = contact.getForceGeneratorMatrix @ f
            J = pin.getFrameJacobian(
                model, data, model.getFrameId(contact.name), pin.ReferenceFrame.LOCAL
            )
            felt += J.T @ wrench
        return a, tau, felt


def contender(question: Question) -> Contender:
    """Return tsid at work."""
    engine = Engine(question)
    made = engine.made
    size = f"{made.nVar} unknowns, {made.nEq} equations, {made.nIn} inequalities"
    return Contender(engine.tick, engine.answer, size)


if __name__ == "__main__":
    main("tsid", version("tsid"), contender)
