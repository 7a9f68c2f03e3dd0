"""at_rate: a controller in closed loop, as the torque function of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from math import floor, isfinite
from typing import Final

import numpy as np

from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import check_positive
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.controller import Controller
from condyn_pin.errors import InvalidArgument, SolveFailed

_LONGEST: Final = 1.0  # [s]; no robot is controlled more slowly, and rates in Hz are larger

# Share of a period: times of steps are sums, and rounded.
_ROUNDING = 1e-6


def at_rate(
    controller: Controller, period: float, *, watch: Callable[[ControlAnswer], object] | None = None
) -> Callable[[float, Array, Array], Array]:
    """Return a torque function (t, q, v) that runs a controller once per period.

    tau(t) = tau_k,    t_k <= t < t_k + period,    t_k = k period

    ``simulate(floor, q, v, at_rate(controller, 1e-3), dt=5e-4, duration=2.0)`` closes the loop.

    Parameters
    ----------
    controller : Controller
        Of the robot that moves, on contacts that it takes for closed; the scene that moves may
        have others. It is told `Robot.passive_torque`, which a simulation adds as well.
    period : float
        From one tick to the next [s], preferably a whole number of steps.
    watch : callable, optional
        Called with every answer that is applied, such as ``answers.append``.

    Returns
    -------
    callable
        Raises SolveFailed, with the answer as its `solution`, in a tick without torques. Torques of
        an answer that is INACCURATE are applied.

    Raises
    ------
    InvalidArgument
        If there is no controller, or the period is not positive, or longer than a second.

    Notes
    -----
    Between two ticks a call costs a microsecond. A call at the instant of a tick with another
    state, from a trial step of an integrator or from another run, solves again.
    """
    if not isinstance(controller, Controller):
        raise InvalidArgument(f"controller = {controller!r}: a Controller is needed")
    check_positive("time [s]", period=period)
    if period > _LONGEST:
        raise InvalidArgument(
            f"period = {period:g} s: torques would be held for so long; at a rate in Hz the period "
            "is 1 / rate"
        )
    if watch is not None:
        check_called("watch", watch, "answer")
    return _Held(controller, float(period), watch)


class _Held:
    """A controller, and the answer that is applied until its next tick."""

    def __init__(
        self,
        controller: Controller,
        period: float,
        watch: Callable[[ControlAnswer], object] | None,
    ) -> None:
        self._controller, self._period, self._watch = controller, period, watch
        self._tick, self._t = 0, np.inf
        self._state: tuple[Array, Array] = np.zeros(0), np.zeros(0)
        self._tau = np.zeros(0)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques of the tick (nv,) [N m, N]."""
        ticks = t / self._period
        if not isfinite(ticks):
            raise InvalidArgument(
                f"t = {t!r}: not a finite number of periods of {self._period:g} s"
            )
        tick = floor(ticks + _ROUNDING)
        if tick != self._tick or t < self._t or (t == self._t and self._is_elsewhere(q, v)):
            self._tau = self._answer(t, q, v)
            self._tick, self._t, self._state = tick, t, (q.copy(), v.copy())
        return self._tau

    def _answer(self, t: float, q: Array, v: Array) -> Array:
        passive = self._controller.scene.robot.passive_torque(q, v)
        answer = self._controller.solve(q, v, t, passive=passive)
        if not np.isfinite(answer.tau).all():
            named = "; ".join(str(answer.infeasible or answer.status).splitlines())
            raise SolveFailed(f"t = {t:g} s: the controller has no torques: {named}", answer)
        if self._watch is not None:
            self._watch(answer)
        return answer.tau

    def _is_elsewhere(self, q: Array, v: Array) -> bool:
        return not (np.array_equal(q, self._state[0]) and np.array_equal(v, self._state[1]))

    def __repr__(self) -> str:
        return f"at_rate({self._controller!r}, {self._period:g})"
