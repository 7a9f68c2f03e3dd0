"""DormandPrince: adaptive Runge-Kutta methods of SciPy, in the coordinates of a step."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import check_share
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument, SolveFailed, StepFailed
from condyn_pin.simulation.integrators.integrator import Integrator, Order, Stepper
from condyn_pin.simulation.manifold import HALF_TURN
from condyn_pin.simulation.system import System

# Smallest share of dt that a substep may have, before the motion counts as one that cannot be
# followed: 1e-9 of a millisecond is far below any time constant of a machine.
_SMALLEST = 1e-9

# Substeps of one dt, at most: more are those of a stiff motion, which no smooth one asks for.
_MOST = 10_000

# How far bodies may have turned in the chart of a step before the next substep begins another
# [rad]: theta' is smooth there, and far from the end of the chart.
_FAR = 1.0


@dataclass(frozen=True)
class DormandPrince(Integrator):
    """Adaptive steps, as small as the tolerances require; dt is only the sampling interval.

    Within dt the state is that of `RungeKutta4`, (y, V), from another q0 once a body has turned by
    a radian. The size of a substep is remembered from one dt to the
    next; one that leads to where nothing can be evaluated is refused like one that is too wrong.
    With drift control by `Baumgarte` its gains count as fast motion once the tolerances are finer
    than the drift.

    A substep ends at every dt, where drift schemes and events evaluate the state, so samples are
    not interpolated. A dt shorter than the substeps that the tolerances require therefore costs
    more: 13 solves per dt with method 8, 7 with method 5.

    Parameters
    ----------
    relative_tolerance, absolute_tolerance : float
        Of the local error of y and V, as in `scipy.integrate`. By default 1e-8 and 1e-10: what
        a status of ok promises for accelerations.
    method : {8, 5}
        Dormand and Prince's method of order 8 (DOP853) or 5 (RK45, with local extrapolation).

    Raises
    ------
    InvalidArgument
        If a tolerance is not between 0 and 1, or the method is neither 5 nor 8.

    References
    ----------
    Hairer, Norsett, Wanner. Solving Ordinary Differential Equations I. Springer, 1993, II.4-5.
    """

    title: ClassVar[str] = "Dormand-Prince, adaptive"
    solves_per_step: ClassVar[float] = 13
    use: ClassVar[str] = "where the error is to be chosen instead of dt"
    is_adaptive: ClassVar[bool] = True

    relative_tolerance: float = 1e-8
    absolute_tolerance: float = 1e-10
    method: int = 8

    def __post_init__(self) -> None:
        check_share("relative_tolerance", self.relative_tolerance)
        check_share("absolute_tolerance", self.absolute_tolerance)
        if self.method not in (5, 8):
            raise InvalidArgument(f"method = {self.method!r}: the order 5 or 8 is needed")

    @property
    def order(self) -> Order:
        """Order of the method: power of the substeps with which the error falls."""
        return Order(self.method, self.method, self.method)

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        size = [dt]  # of the largest substep in the last step; what is too large is refused

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = system.acceleration(t, q, v)
            begun = _Slope(system, t, q, v, system.manifold.straight(v, a))
            q1, v1, size[0] = self._solve(begun, dt, size[0])
            return q1, v1, a

        return Stepper(step)

    def _solve(self, slope: _Slope, dt: float, size: float) -> tuple[Array, Array, float]:
        """Take the substeps of a step; return its end, and the largest of them [s]."""
        method, largest = self._begin(slope, dt, size), 0.0
        for _ in range(_MOST):
            # before the substep: the last one is cut off, and says less
            largest = max(largest, float(method.h_abs))
            method.step()
            too_small = method.step_size and method.step_size < _SMALLEST * dt
            if method.status == "failed" or (too_small and method.status == "running"):
                raise StepFailed(
                    f"{self!r}: no step from t = {slope.t:g} s is small enough: {slope.trouble()}"
                )
            if method.status == "finished":
                return *slope.state(method.y), largest
            if slope.turned(method.y) > _FAR:
                slope = slope.after(float(method.t), method.y, method.f)
                method = self._begin(slope, dt, float(method.h_abs))
        raise StepFailed(
            f"{self!r}: more than {_MOST} substeps from t = {slope.t:g} s: the motion is stiff; "
            "use RadauIIA(3) or GeneralisedAlpha(), or a smaller dt"
        )

    def _begin(self, slope: _Slope, dt: float, size: float) -> Any:
        """Return SciPy's solver from where a slope begins to the end of the step."""
        from scipy.integrate import DOP853, RK45

        kind: Any = DOP853 if self.method == 8 else RK45
        left = dt - slope.start
        return kind(
            slope, slope.start, slope.y0, dt, first_step=min(size, left),
            rtol=max(self.relative_tolerance, 3e-14), atol=self.absolute_tolerance,
        )  # fmt: skip


class _Slope:
    """The slope of (y, V) in the coordinates of one chart, `Manifold` has them.

    The step begins at t [s], and the chart at (q, v), where V' is A, `start` after that [s]. What
    cannot be evaluated is not a number: such a substep is refused, and a smaller one tried.
    """

    def __init__(
        self, system: System, t: float, q: Array, v: Array, A: Array, start: float = 0.0
    ) -> None:
        self.t, self.start = t, start
        self._system, self._q, self._n = system, q, len(v)
        self.y0 = np.concatenate([np.zeros(len(v)), v])
        self._first = np.concatenate([v, A])
        self._error = ""  # of the last evaluation that failed

    def __call__(self, s: float, x: Array) -> Array:
        """Return the slope at t + s."""
        if s == self.start:  # where y is zero
            return self._first.copy()
        y, V = x[: self._n], x[self._n :].copy()
        if not np.isfinite(x).all() or self.turned(x) > HALF_TURN:
            return np.full_like(x, nan)
        try:
            return np.concatenate(self._system.slope(self.t + s, self._q, y, V))
        except (SolveFailed, InvalidArgument) as error:
            self._error = f"at t = {self.t + s:.9g} s: {error}"
            return np.full_like(x, nan)

    def state(self, x: Array) -> tuple[Array, Array]:
        """Return q and v."""
        return self._system.manifold.place(self._q, x[: self._n], x[self._n :].copy())

    def turned(self, x: Array) -> float:
        """Largest rotation angle of a body in this chart [rad]."""
        return self._system.manifold.largest_turn(x[: self._n])[1]

    def after(self, s: float, x: Array, slope: Array) -> _Slope:
        """Return the slope in a chart that begins at x, where its slope is known."""
        A = self._system.manifold.own(x[: self._n], slope[self._n :].copy())
        return _Slope(self._system, self.t, *self.state(x), A, s)

    def trouble(self) -> str:
        """Reason why a step cannot be taken."""
        return self._error or (
            "the motion is too fast or not smooth there: use larger tolerances, or a tau without "
            "jumps"
        )
