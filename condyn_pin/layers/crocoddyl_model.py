"""An `Action` with costs as crocoddyl's ActionModelAbstract. This module imports crocoddyl."""

from __future__ import annotations

from typing import Any

import crocoddyl
import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument, InvalidModel, SolveFailed, StepFailed
from condyn_pin.layers.crocoddyl import Action


class ActionModel(crocoddyl.ActionModelAbstract):  # type: ignore[misc]
    """A step and its costs; crocoddyl keeps all but these.

    A step that has no answer ends in NaN, crocoddyl's own sign of it: its solvers then try a
    shorter step of their search, and an exception of Python would end it. There is no step from
    NaN: a rollout that goes on is an error that names x.
    """

    def __init__(self, action: Action, costs: Any) -> None:
        super().__init__(costs.state, costs.nu)
        self.action, self.costs = action, costs

    def createData(self) -> ActionData:
        """Return memory for one time of a motion."""
        return ActionData(self)

    def calc(self, data: ActionData, x: Array, u: Array | None = None) -> None:
        """Write the next state and its cost; without u those of the end of a motion."""
        self._places(data, x)
        if u is None:
            self.costs.calc(data.costs, x)
            data.xnext, data.cost = x, data.costs.cost
        else:
            self.costs.calc(data.costs, x, u)
            data.xnext, data.cost = self._end(x, u), self.action.dt * data.costs.cost

    def calcDiff(self, data: ActionData, x: Array, u: Array | None = None) -> None:
        """Write the derivatives, after calc."""
        of = data.costs
        if u is None:
            self.costs.calcDiff(of, x)
            data.Lx, data.Lxx = of.Lx, of.Lxx
        else:
            self.costs.calcDiff(of, x, u)
            data.Fx, data.Fu = self.action.derivatives(x, u)
            for name in ("Lx", "Lu", "Lxx", "Lxu", "Luu"):
                setattr(data, name, self.action.dt * getattr(of, name))

    def _end(self, x: Array, u: Array) -> Array:
        """Return the next state, NaN where there is none."""
        try:
            return self.action.step(x, u)
        except (InvalidModel, SolveFailed, StepFailed):
            return np.full(len(x), np.nan)

    def _places(self, data: ActionData, x: Array) -> None:
        """Write what costs read: joints, frames, the centre of mass, and how all of them change."""
        model, q, v = self.state.pinocchio, x[: self.state.nq], x[self.state.nq :]
        pin.computeAllTerms(model, data.pinocchio, q, v)
        pin.updateFramePlacements(model, data.pinocchio)
        pin.computeForwardKinematicsDerivatives(model, data.pinocchio, q, v, np.zeros(len(v)))


class ActionData(crocoddyl.ActionDataAbstract):  # type: ignore[misc]
    """Memory for one time of a motion."""

    def __init__(self, model: ActionModel) -> None:
        super().__init__(model)
        self.pinocchio = model.state.pinocchio.createData()
        self.shared = crocoddyl.DataCollectorMultibody(self.pinocchio)  # kept: costs point at it
        self.costs = model.costs.createData(self.shared)


def model_of(action: Action, costs: Any) -> ActionModel:
    """Return the model, for costs of the same robot and motors."""
    check_type("costs", costs, crocoddyl.CostModelSum, "a crocoddyl.CostModelSum is needed")
    if not isinstance(costs.state, crocoddyl.StateMultibody) or not (
        costs.state.pinocchio == action.scene.robot.model
    ):
        raise InvalidArgument(
            "costs are of another robot: make them with "
            "crocoddyl.StateMultibody(action.scene.robot.model)"
        )
    if costs.nu != action.B.shape[1]:
        raise InvalidArgument(
            f"costs are of {costs.nu} motors, the action has {action.B.shape[1]}: "
            f"crocoddyl.CostModelSum(state, {action.B.shape[1]})"
        )
    return ActionModel(action, costs)
