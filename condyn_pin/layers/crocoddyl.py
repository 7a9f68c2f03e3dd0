"""Steps as crocoddyl's optimisers have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.control.actuation import Actuation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, MissingExtra
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.route import Route
from condyn_pin.layers.answers import StepMap
from condyn_pin.model.joints import CoupledMotor
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle


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
    ``gains = [0, 1 / dt]`` and without joint damping; ``benchmarks/contact_peers.py crocoddyl``
    compares them. calc costs a step, calcDiff what `Route.cost` says. Both are Python: leave a
    problem on one thread. Crocoddyl 3.2.1 needs Pinocchio 4.0: beside 4.1 its own contacts crash.

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


# Action: a step as optimal control has it, x+ = f(x, u) with tangent derivatives.


@dataclass(frozen=True)
class Action:
    """One step of a scene, for trajectory optimisers; a frozen value.

    x+ = f(x, u),    x = (q, v),    tau = B u,    dx+ = Fx dx + Fu du

    Parameters
    ----------
    scene : Scene
        Its contacts may open and slide; its constraints hold.
    dt : float
        Time step [s].
    integrator : ContactScheme
        `StewartTrinkle()` by default.
    route : Route
        Of the derivatives, `ActiveSet()` by default: exact within a mode of the contacts.
        Optimisers that have to make and break contact take `Kappa`, which smooths them.
    motors : sequence of str or CoupledMotor, optional
        The motors whose torques are u, as for `Actuation`; those of the robot by default.

    Raises
    ------
    InvalidArgument
        If dt is not positive, or the integrator or the route cannot be used.
    UnknownName
        If there is no such joint.

    Notes
    -----
    Each call costs a step, `derivatives` what `Route.cost` says.
    """

    scene: Scene
    dt: float
    integrator: ContactScheme = field(default_factory=StewartTrinkle)
    route: Route = field(default_factory=ActiveSet)
    motors: Sequence[str | CoupledMotor] | None = None

    def __post_init__(self) -> None:
        if self.motors is not None and not isinstance(self.motors, str):  # which is refused below
            object.__setattr__(self, "motors", tuple(self.motors))
        _ = self._map, self.B  # both refuse what they cannot use

    @cached_property
    def B(self) -> Array:
        """The map (nv, k) from u to joint torques [1]."""
        return Actuation(self.scene.robot, self.motors).B

    @cached_property
    def _map(self) -> StepMap:
        return StepMap(self.scene, self.dt, self.integrator, self.route)

    @one_blas_thread
    def step(self, x: ArrayLike, u: ArrayLike) -> Array:
        """Return the next state.

        Parameters
        ----------
        x : (nq + nv,) array_like
            q and v, one after the other.
        u : (k,) array_like
            Torques of the motors [N m, N].

        Returns
        -------
        (nq + nv,) array
            The state after dt.

        Raises
        ------
        InvalidArgument
            If a size is wrong, or a number is not finite.
        SolveFailed
            If the contacts have no answer.
        """
        with np.errstate(all="ignore"):  # what is not finite is refused
            return np.concatenate(self._map.answer(*self._state(x, u)))

    @one_blas_thread
    def derivatives(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of the next state by x and u, in the tangent space.

        Parameters
        ----------
        x : (nq + nv,) array_like
            q and v, one after the other.
        u : (k,) array_like
            Torques of the motors [N m, N].

        Returns
        -------
        Fx : (2 nv, 2 nv) array
            Rows of q+ and then of v+, columns of q and then of v, along ``pin.integrate``.
        Fu : (2 nv, k) array
            By the torques of the motors.

        Raises
        ------
        InvalidArgument, SolveFailed
            As `step`.
        """
        _, d = self._map.change(*self._state(x, u))
        both = d.matrix
        n = 2 * self._map.nv
        return both[:, :n], both[:, n:] @ self.B

    def _state(self, x: ArrayLike, u: ArrayLike) -> tuple[Array, Array, Array]:
        robot = self.scene.robot
        x_ = finite("x", x, robot.nq + robot.nv)
        q = robot.arguments.configuration("x", x_[: robot.nq])
        return q, x_[robot.nq :], self.B @ finite("u", u, self.B.shape[1])
