"""Steps as crocoddyl's optimisers have them."""

from __future__ import annotations

from typing import Any

from condyn_pin.errors import InvalidArgument, MissingExtra
from condyn_pin.layers.action import Action


def crocoddyl_action(action: Action, costs: Any) -> Any:
    """Return an action as a crocoddyl action model.

    x+ = f(x, u),    l = dt costs(x, u);    at the end of a motion  l = costs(x)

    Parameters
    ----------
    action : Action
        Its `step` is calc, its `derivatives` are calcDiff.
    costs : crocoddyl.CostModelSum
        Of x and u; made with ``crocoddyl.StateMultibody(action.scene.robot.model)`` and as many
        u as there are motors. Costs on contact forces are those of crocoddyl's contacts alone.

    Returns
    -------
    crocoddyl.ActionModelAbstract
        For `crocoddyl.ShootingProblem`; one may stand at all times.

    Raises
    ------
    InvalidArgument
        If the costs are of another robot or of another number of motors.
    MissingExtra
        If crocoddyl is not installed.

    Notes
    -----
    On feet that hold, a step is to its order that of crocoddyl's contact dynamics by Euler, with
    ``gains = [0, 1 / dt]`` and without joint damping; ``benchmarks/crocoddyl_action.py`` compares
    them. calc costs a step, calcDiff what `Route.cost` says. Both are Python: leave a problem on
    one thread. Crocoddyl 3.2.1 needs Pinocchio 4.0: beside 4.1 its own contacts crash.

    References
    ----------
    Mastalli et al. Crocoddyl: an efficient and versatile framework for multi-contact optimal
    control. ICRA, 2020.
    """
    try:
        from condyn_pin.layers.crocoddyl_model import model_of
    except ModuleNotFoundError as error:
        if error.name != "crocoddyl":
            raise
        raise MissingExtra(
            "crocoddyl is missing: python -m pip install --no-deps crocoddyl==3.2.1 "
            "libcrocoddyl==3.2.1 pin==4.0.0 libpinocchio==4.0.0"
        ) from error
    if not isinstance(action, Action):
        raise InvalidArgument(f"action = {type(action).__name__}: an Action is needed")
    return model_of(action, costs)
