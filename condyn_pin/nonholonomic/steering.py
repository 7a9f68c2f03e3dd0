"""Steering: inputs that bring a chain of integrators from one place to another.

    z_1' = u_1,    z_2' = u_2,    z_(j+1)' = z_j u_1

Sinusoids move one coordinate after the other. With s from 0 to 1 in each period,

    u_1 = A sin(2 pi s),    u_2 = B cos(2 pi k s)

z_(k+2) moves by B (A / 4 pi)^k / k!, all before it come back, and those behind it are moved later.

Polynomials do it at once: with u_1 constant, y is a polynomial of x that has the derivatives z at
both ends (Hermite), and u_2 is what bends it so.

A chain has no drift, so that the same path is driven at any pace. Each stage begins and ends at
rest, s = 10 x^3 - 15 x^4 + 6 x^5, x = t / duration: velocities and accelerations are continuous.

References
----------
Murray, Sastry. Nonholonomic motion planning: steering using sinusoids. IEEE Transactions on
Automatic Control 38, 1993.
Tilbury, Murray, Sastry. Trajectory generation for the n-trailer problem using Goursat normal form.
IEEE Transactions on Automatic Control 40, 1995.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial, pi
from typing import Any, Final

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.driven import Driven
from condyn_pin.constraints.held_joint import HeldJoint
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.nonholonomic.chained_form import ChainedForm, Numbers

# Terms of a period of a sinusoid on [0, 1] in Chebyshev's polynomials, for k = 1 and each k more:
# what is left is rounding.
_TERMS: Final = (32, 12)

# Coefficients below this share of the largest are rounding.
_ROUNDING: Final = 1e-17

# A change of z below this is none, relative to the largest z.
_NONE: Final = 1e-14

# Step of a derivative along the imaginary axis [s]: no difference is formed, so that none cancels.
_IMAGINARY: Final = 1e-30


@dataclass(frozen=True, eq=False)
class _Stage:
    """A path of z over s from 0 to 1, and the time that it takes."""

    z: tuple[Any, ...]  # of numpy's polynomials
    duration: float  # [s]

    @classmethod
    def driven(cls, start: Array, u: tuple[Any, Any], duration: float) -> _Stage:
        """Return the path from a place under inputs u(s), which are numpy's polynomials."""
        found = [start[0] + u[0].integ(lbnd=0), start[1] + u[1].integ(lbnd=0)]
        for z0 in start[2:]:
            rate = (found[-1] * u[0]).trim(_ROUNDING * np.abs(found[-1].coef).max(initial=0.0))
            found.append(z0 + rate.integ(lbnd=0))
        return cls(tuple(found), duration)

    def at(self, s: Any) -> Numbers:
        """Return z (n,)."""
        return np.array([each(s) for each in self.z])

    def inputs(self, s: Any) -> Numbers:
        """Return u (2,) by s."""
        return np.array([each(s) for each in self._u])

    @cached_property
    def _u(self) -> tuple[Any, Any]:
        return self.z[0].deriv(), self.z[1].deriv()


@dataclass(frozen=True, eq=False, repr=False)
class SteeringPlan:
    """Path of a vehicle in chained form, from rest to rest.

    Attributes
    ----------
    form : ChainedForm
    start, goal : (n,) array
        Chained coordinates [m, 1, 1/m, ...] at its beginning and at its end.
    stages : tuple
        Its parts, one after the other, each from rest to rest.
    """

    form: ChainedForm
    start: Array
    goal: Array
    stages: tuple[_Stage, ...]

    @property
    def duration(self) -> float:
        """Time that the plan takes [s]."""
        return float(sum(stage.duration for stage in self.stages))

    def z(self, t: float) -> Array:
        """Return the chained coordinates (n,) at t [s]; those of the ends outside of the plan."""
        return self._chained(t)[0]

    def inputs(self, t: float) -> Array:
        """Return u (2,) at t: rates of z_1 and z_2 [m/s, ...]."""
        return self._chained(t)[1]

    def pose(self, t: float) -> Array:
        """Return the values of ``form.joints`` (n,) at t [m, rad]."""
        return self.form.pose(self.z(t))

    def driven(self, joints: Sequence[str] = ()) -> Scene:
        """Return the scene of the vehicle with some of its joints driven along the plan.

        Parameters
        ----------
        joints : sequence of str
            Two of the form's, which decide all others: by default ``x``, and ``steering`` of a car
            or ``heading`` of a unicycle.

        Raises
        ------
        InvalidArgument
            If the form has no such joint.
        """
        scene, chosen = self.form.scene, tuple(joints)
        if not chosen:
            chosen = ("x", "steering" if self.form.lengths else "heading")
        for name in chosen:
            if name not in self.form.joints:
                raise InvalidArgument(
                    f"joints = {list(chosen)}: the form has {', '.join(self.form.joints)}"
                )
        drives = [Driven(HeldJoint(name), _JointPath(self, name)) for name in chosen]
        return Scene(scene.robot, [*scene.constraints, *drives])

    def state(self) -> tuple[Array, Array]:
        """Return q (nq,) and v (nv,) at the beginning: at rest, other joints as in neutral q."""
        return self.form.to_joints(self.start), np.zeros(self.form.scene.robot.nv)

    def __add__(self, other: SteeringPlan) -> SteeringPlan:
        if other.form != self.form or np.abs(other.start - self.goal).max() > _NONE * self._size:
            raise InvalidArgument(f"plan: it begins at {other.start}, where {self.goal} is needed")
        return SteeringPlan(self.form, self.start, other.goal, (*self.stages, *other.stages))

    def __repr__(self) -> str:
        return (
            f"SteeringPlan({self.form.scene.robot.name}: {len(self.stages)} stages, "
            f"{self.duration:g} s, z from {self.start} to {self.goal})"
        )

    @property
    def _size(self) -> float:
        return max(1.0, float(np.abs(self.goal).max()))

    @cached_property
    def _begins(self) -> Array:
        return np.cumsum([0.0, *(stage.duration for stage in self.stages)])

    def _chained(self, t: Any) -> tuple[Numbers, Numbers]:
        """Return z and u at t [s], which may be complex."""
        if not self.stages:
            return self.start, np.zeros(2)
        i = int(np.searchsorted(self._begins[1:-1], np.real(t), side="right"))
        stage = self.stages[i]
        x = (t - self._begins[i]) / stage.duration
        if not 0.0 <= np.real(x) <= 1.0:
            x = min(max(float(np.real(x)), 0.0), 1.0)
        s, pace = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 / stage.duration
        return stage.at(s), pace * stage.inputs(s)

    def path(self, t: float) -> tuple[Array, Array, Array]:
        """Return values, rates and accelerations (n,) of ``form.joints`` at t."""
        return self._path(t)

    @cached_property
    def _path(self) -> Callable[[float], tuple[Array, Array, Array]]:
        @lru_cache(maxsize=2)  # the joints that are driven need it at one time, one by one
        def found(t: float) -> tuple[Array, Array, Array]:
            rate = self.form.pose_rate(*self._chained(t + 1j * _IMAGINARY))
            return self.form.pose(self.z(t)), rate.real, rate.imag / _IMAGINARY

        return found

    def __reduce__(self) -> tuple[Any, ...]:
        return SteeringPlan, (self.form, self.start, self.goal, self.stages)


@dataclass(frozen=True, eq=False)
class _JointPath:
    """Path of one joint of a plan, for `Driven`."""

    plan: SteeringPlan
    joint: str

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        i = self.plan.form.joints.index(self.joint)
        s, rate, bend = self.plan.path(t)
        return s[[i]], rate[[i]], bend[[i]]


def steer_by_sinusoids(
    form: ChainedForm, start: ArrayLike, goal: ArrayLike, *, ahead: float, period: float = 5.0
) -> SteeringPlan:
    """Plan that moves one chained coordinate after the other by sinusoids.

    u_1 = A sin(2 pi s),    u_2 = B cos(2 pi k s),    z_(k+2) moves by B (A / 4 pi)^k / k!

    Parameters
    ----------
    form : ChainedForm
    start, goal : (nq,) array_like
        Configurations [m, rad]; joints that are not of the form do not count.
    ahead : float
        How far it drives ahead, and back, in each period [m]; backwards if negative. The angles of
        period k go with ahead^-k: a longer drive bends less.
    period : float
        Duration of each period [s].

    Returns
    -------
    SteeringPlan
        First z_1 and z_2 straight to their goals, then a period for each other coordinate.

    Raises
    ------
    InvalidArgument
        If `ahead` is zero, `period` is not positive, or an axle of start or goal is across x or the
        one ahead of it.

    Notes
    -----
    Costs a millisecond for each coordinate.

    References
    ----------
    Murray, Sastry. Nonholonomic motion planning: steering using sinusoids. IEEE Transactions on
    Automatic Control 38, 1993.
    """
    z0, z1 = form.to_chained(start), form.to_chained(goal)
    check_positive("time [s]", period=period)
    if not finite("ahead", ahead, ()):
        raise InvalidArgument("ahead = 0: it has to drive some way to get sideways [m]")
    size, z, stages = max(1.0, float(np.abs([z0, z1]).max())), z0, []
    if np.abs(z1[:2] - z0[:2]).max() > _NONE * size:
        u = tuple(Chebyshev([change], [0.0, 1.0]) for change in z1[:2] - z0[:2])
        stages.append(_Stage.driven(z, u, period))  # type: ignore[arg-type]
        z = stages[-1].at(1.0)
    for k in range(1, form.size - 1):
        change = z1[k + 1] - z[k + 1]
        if abs(change) <= _NONE * size:
            continue
        A, B = pi * ahead, change * factorial(k) * (4.0 / ahead) ** k
        u = _sine(A), _cosine(B, k)
        stages.append(_Stage.driven(z, u, period))
        z = stages[-1].at(1.0)
    return SteeringPlan(form, z0, z1, tuple(stages))


def _sine(A: float) -> Any:
    """A sin(2 pi s) as a polynomial."""
    return Chebyshev.interpolate(lambda s: A * np.sin(2 * pi * s), _TERMS[0], [0.0, 1.0])


def _cosine(B: float, k: int) -> Any:
    """B cos(2 pi k s) as a polynomial."""
    terms = _TERMS[0] + _TERMS[1] * k
    return Chebyshev.interpolate(lambda s: B * np.cos(2 * pi * k * s), terms, [0.0, 1.0])


def steer_by_polynomials(
    form: ChainedForm, start: ArrayLike, goal: ArrayLike, *, duration: float = 10.0
) -> SteeringPlan:
    """Plan along which y is a polynomial of x, that of Hermite between both ends.

    y(x) = sum_k c_k x^k of degree 2 n - 3,    with n - 1 derivatives given at each end

    Parameters
    ----------
    form : ChainedForm
    start, goal : (nq,) array_like
        Configurations [m, rad] at different x of the last axle; joints that are not of the form do
        not count.
    duration : float
        Of the plan [s].

    Returns
    -------
    SteeringPlan
        Of one stage.

    Raises
    ------
    InvalidArgument
        If the last axle has the same x at both ends, `duration` is not positive, or an axle of
        start or goal is across x or the one ahead of it.

    Notes
    -----
    A place beside takes two plans, ahead and back: ``one + two``. Costs a millisecond.

    References
    ----------
    Tilbury, Murray, Sastry. Trajectory generation for the n-trailer problem using Goursat normal
    form. IEEE Transactions on Automatic Control 40, 1995.
    """
    z0, z1 = form.to_chained(start), form.to_chained(goal)
    check_positive("time [s]", duration=duration)
    D = float(z1[0] - z0[0])
    if abs(D) <= _NONE * max(1.0, float(np.abs([z0, z1]).max())):
        raise InvalidArgument(
            f"goal: the last axle is at x = {z0[0]:.6g} m at both ends, and a polynomial of x "
            "joins places that differ in it: plan to a place ahead, and from there: one + two"
        )
    # c of y(s), x = x_0 + D s: its derivatives by s are D^k times those by x
    n, degree = form.size, 2 * form.size - 3
    basis = [Polynomial.basis(k) for k in range(degree + 1)]
    rows, wanted = [], []
    for s, z in ((0.0, z0), (1.0, z1)):
        for k in range(n - 1):
            rows.append([each.deriv(k)(s) if k else each(s) for each in basis])
            wanted.append(D**k * z[n - 1 - k])
    y = Polynomial(np.linalg.solve(rows, wanted))
    by_x = [y.deriv(k) / D**k if k else y for k in range(n - 1)]
    x = Polynomial([z0[0], D])
    return SteeringPlan(form, z0, z1, (_Stage((x, *by_x[::-1]), float(duration)),))
