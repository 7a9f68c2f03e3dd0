"""Action: a step as optimal control has it, x+ = f(x, u) with tangent derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.control.actuation import Actuation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.layers.step_map import StepMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.base import Route


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
    motors : sequence of str, optional
        The joints that u drives, ``robot.actuated`` by default.

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
    motors: Sequence[str] | None = None

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
        """Return how the next state changes, in the tangent.

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
