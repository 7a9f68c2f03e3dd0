"""DormandPrince: adaptive Runge-Kutta methods of SciPy, in the coordinates of a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from condyn_pin.arrays import Array
from condyn_pin.errors import InvalidArgument, StepFailed
from condyn_pin.knobs import check_share
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System

# Smallest share of dt that a substep may have, before the motion counts as one that cannot be
# followed: 1e-9 of a millisecond is far below any time constant of a machine.
_SMALLEST = 1e-9

# Substeps of one dt, at most: more are those of a stiff motion, which no smooth one asks for.
_MOST = 10_000


@dataclass(frozen=True)
class DormandPrince(Integrator):
    """Steps as small as the tolerances ask for; dt is only how often the state is handed out.

    Within dt the state is (theta, v), q = integrate(q0, theta), as in `RungeKutta4`. The size of a
    substep is remembered from one dt to the next. With drift control by `Baumgarte` its gains count
    as fast motion once the tolerances are finer than the drift.

    A substep ends at every dt, where drift schemes and events look at the state: samples are states
    of the method, not interpolated ones. So a dt shorter than the substeps that the tolerances ask
    for costs what it says: 13 solves each with method 8, 7 with method 5.

    Parameters
    ----------
    relative_tolerance, absolute_tolerance : float
        Of the local error of theta and v, as in `scipy.integrate`. By default 1e-8 and 1e-10: what
        a status of ok promises for accelerations.
    method : {8, 5}
        Dormand and Prince's method of order 8 (DOP853) or 5 (RK45, with local extrapolation).

    References
    ----------
    Hairer, Norsett, Wanner. Solving Ordinary Differential Equations I. Springer, 1993, II.4-5.
    """

    title: ClassVar[str] = "Dormand-Prince, adaptive"
    symplectic: ClassVar[bool] = False
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
        """That of the method: the error falls with this power of the substeps."""
        return Order(self.method, self.method, self.method)

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        from scipy.integrate import DOP853, RK45

        kind: Any = DOP853 if self.method == 8 else RK45
        tolerances = {"rtol": max(self.relative_tolerance, 3e-14), "atol": self.absolute_tolerance}
        size = [dt]
        acceleration, integrate, rate = system.acceleration, system.integrate, system.rate

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            n = len(v)
            a = acceleration(t, q, v)

            def slope(s: float, y: Array) -> Array:
                theta, w = y[:n], y[n:]
                if s == 0.0:  # where theta is zero
                    return np.concatenate([w, a])
                return np.concatenate(
                    [rate(theta, w), acceleration(t + s, integrate(q, theta), w.copy())]
                )

            y0 = np.concatenate([np.zeros(n), v])
            method = kind(slope, 0.0, y0, dt, first_step=min(size[0], dt), **tolerances)
            size[0] = self._solve(method, t, dt)
            return integrate(q, method.y[:n]), method.y[n:].copy(), a

        return Stepper(step)

    def _solve(self, method: Any, t: float, dt: float) -> float:
        """Take the substeps of a step from t; return the largest one [s]."""
        largest = 0.0
        for _ in range(_MOST):
            largest = max(
                largest, float(method.h_abs)
            )  # the last substep is cut off, and says less
            method.step()
            too_small = method.step_size and method.step_size < _SMALLEST * dt
            if method.status != "running" or too_small:
                break
        else:
            raise StepFailed(
                f"{self!r}: more than {_MOST} substeps from t = {t:g} s: the motion is stiff; use "
                "SemiImplicitEuler() or GeneralisedAlpha(), or a smaller dt"
            )
        if method.status != "finished":
            raise StepFailed(
                f"{self!r}: no step from t = {t:g} s is small enough; the motion is too fast or "
                "not smooth there: use larger tolerances, or a tau without jumps"
            )
        return largest
