"""Crocoddyl: contact dynamics and their derivatives. It has contacts with the world, no loops."""

from __future__ import annotations

import crocoddyl
import numpy as np
import pinocchio as pin

from peers.bare import model_of
from peers.exported import ACCELERATION, DERIVATIVES, Exported
from peers.harness import Candidate, main


def candidates(scene: Exported) -> list[Candidate]:
    """Return calc and calcDiff, for scenes whose constraints all hold to the world."""
    if any(c.joint2 for c in scene.constraints) or scene.joints[0].kind != "free":
        return []
    return [acceleration(scene), derivatives(scene)]


class Engine:
    """The differential action model of a scene, with no cost."""

    def __init__(self, scene: Exported) -> None:
        model = model_of(scene)
        frames = [
            model.addFrame(
                pin.Frame(c.name, c.joint1, 0, pin.SE3(*c.placement1), pin.FrameType.OP_FRAME)
            )
            for c in scene.constraints
        ]
        state = crocoddyl.StateMultibody(model)
        actuation = crocoddyl.ActuationModelFloatingBase(state)
        contacts = crocoddyl.ContactModelMultiple(state, actuation.nu)
        for c, frame in zip(scene.constraints, frames, strict=True):
            made = crocoddyl.ContactModel6D(
                state,
                frame,
                pin.SE3(*c.placement2),
                pin.ReferenceFrame.LOCAL,
                actuation.nu,
                np.zeros(2),
            )
            contacts.addContact(c.name, made)
        costs = crocoddyl.CostModelSum(state, actuation.nu)
        self.model = crocoddyl.DifferentialActionModelContactFwdDynamics(
            state, actuation, contacts, costs, 0.0, True
        )
        self.data = self.model.createData()
        q, v, tau = (scene.states[key] for key in ("q", "v", "tau"))
        if np.any(tau[:, :6]):
            raise ValueError("crocoddyl's actuation has no torque on the floating base")
        self.x, self.u = np.hstack([q, v]), tau[:, 6:].copy()


def acceleration(scene: Exported) -> Candidate:
    """Return calc."""
    engine = Engine(scene)

    def call(i: int) -> None:
        engine.model.calc(engine.data, engine.x[i], engine.u[i])

    def answer(i: int) -> np.ndarray:
        call(i)
        return engine.data.xout.copy()

    return Candidate(ACCELERATION, "ContactFwdDynamics.calc", call, answer)


def derivatives(scene: Exported) -> Candidate:
    """Return calc and calcDiff."""
    engine, nv = Engine(scene), scene.nv
    columns = [k - 6 for k in scene.motors]

    def call(i: int) -> None:
        engine.model.calc(engine.data, engine.x[i], engine.u[i])
        engine.model.calcDiff(engine.data, engine.x[i], engine.u[i])

    def answer(i: int) -> tuple[np.ndarray, ...]:
        call(i)
        Fx, Fu = engine.data.Fx.copy(), engine.data.Fu.copy()
        return Fx[:, :nv], Fx[:, nv:], Fu[:, columns]

    return Candidate(DERIVATIVES, "ContactFwdDynamics.calc + calcDiff", call, answer)


if __name__ == "__main__":
    main("Crocoddyl", crocoddyl.__version__, candidates)
