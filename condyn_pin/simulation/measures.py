"""Violation, energy, momentum and work along a motion.

    E = 1/2 v^T M v + potential + sum_i k_i (q_i - q0_i)^2 / 2

and E changes by the work of torques and forces applied, that of damping, what impacts take, what
constraints bring that follow a path of time, lam . s', and by contacts that open and slide, whose
work comes in three parts (`ContactWork`). Ideal constraints at rest do no work: what is left over
is the error of the integration.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import algorithms
from condyn_pin._core.threads import ThreadCache
from condyn_pin.constraints.rows.equations import MANY, BatchedGaps, Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.torques import PassiveForces

# Samples for which a matrix of them all is small.
_FEW = 64

# Order of velocities from which on a cubic spline is less accurate than the motion.
_ACCURATE = 4


@dataclass(frozen=True, eq=False, repr=False)
class Energy:
    """Energies at the samples of a trajectory, each (k,) [J].

    Attributes
    ----------
    kinetic, potential, springs : (k,) array
        [J]; the potential one is zero where Pinocchio has it: with all at the world's origin.
    work : (k,) array
        Of the torques applied, and of forces from outside, since the start [J].
    damping : (k,) array
        Work of the damping since the start; not positive [J].
    impacts : (k,) array
        What events did to the kinetic energy since the start [J].
    driven : (k,) array
        Work of constraints that follow a path of time, lam . s', since the start [J]. Of steps with
        contacts it is that of all impulses, recorded or not.
    contact : (k,) array
        Work of contacts that open and slide since the start, of friction and impacts: they only
        take, springs of a `SoftStep` apart [J].
    correction : (k,) array
        Work since the start of pushing penetrations out, and of moving q back onto the loops after
        each step with contacts [J].
    algorithmic : (k,) array
        Energy that contacts added since the start although friction and impacts only take it,
        because a step has J at one place only; not negative, and zero in the limit of small steps
        [J].
    doubt : (k,) array
        How far the work of torques, damping and drives may be off since the start, as an integral
        over the samples: by what trapezoids, or mean velocities between them, differ [J].
    """

    kinetic: Array
    potential: Array
    springs: Array
    work: Array
    damping: Array
    impacts: Array
    driven: Array
    contact: Array
    correction: Array
    algorithmic: Array
    doubt: Array

    @property
    def total(self) -> Array:
        """Kinetic, potential and springs (k,) [J]."""
        return self.kinetic + self.potential + self.springs

    @property
    def error(self) -> Array:
        """Unexplained change of the total energy (k,) [J], to within `doubt`."""
        total = self.total
        done = self.work + self.damping + self.impacts + self.driven
        done = done + self.contact + self.correction + self.algorithmic
        return np.asarray(total - total[0] - done)

    @property
    def scale(self) -> float:
        """The largest change that was exchanged [J]: what an error is small in comparison to."""
        parts = (
            *(self.kinetic, self.potential, self.springs, self.work, self.damping),
            *(self.driven, self.contact),
        )
        return float(max(np.ptp(part) for part in parts))

    @property
    def passed(self) -> float:
        """The largest energy that came in or went out, by one way [J]."""
        parts = self.work, self.damping, self.impacts, self.driven, self.contact
        return float(max(np.ptp(part) for part in parts))

    @property
    def kept(self) -> float:
        """An error that is rounding beside the energies themselves [J]."""
        parts = (self.kinetic, self.potential, self.springs)
        return tolerances.ENERGY_KEPT * float(max(np.abs(part).max() for part in parts))

    def of(self, motion: int) -> Energy:
        """Return the energies of one of N motions, whose samples are (k, N).

        Parameters
        ----------
        motion : int
            Its number.
        """
        return Energy(*(getattr(self, field.name)[:, motion] for field in fields(self)))

    def __repr__(self) -> str:
        total = self.total
        return (
            f"Energy({len(total)} samples, {total[0]:.6g} J to {total[-1]:.6g} J, unexplained "
            f"{np.abs(self.error).max():.1e} J at most)"
        )


class Kinematics(NamedTuple):
    """Constraint violations and energies at the samples of a phase, (k,) each."""

    violation: Array  # max abs(c(q)) [m, rad]; zero without constraints
    constraint_velocity: Array  # max abs(J v) [m/s, rad/s]
    kinetic: Array  # [J]
    potential: Array  # [J]


class Gauge:
    """The memory to measure states of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.equations = Equations(scene.robot.model, scene.bounds)
        self._run = algorithms(self.equations.data)
        self._armature = np.array(scene.robot.model.armature)
        # Pinocchio leaves the armature of joints about a slanted axis out of the kinetic energy
        self._links = pin.Model(scene.robot.model)
        self._links.armature[:] = 0.0

    @cached_property
    def _states(self) -> BatchedGaps:
        return BatchedGaps(self.equations)

    def measure(self, t: Array, q: Array, v: Array) -> Kinematics:
        """Constraint violations and energies at times t (k,), states q (k, nq), v (k, nv)."""
        states, links, data = self._states, self._links, self.equations.data
        count = len(q)
        worst, energies = np.zeros((2, 2, count))
        for start in range(0, count, MANY):
            block = range(start, min(start + MANY, count))
            run = self._run
            for i in block:
                states.look(i - start, q[i], v[i], t[i])
                # the rest reads what that has left in data
                energies[0, i] = run.computeKineticEnergy(links, data)
                energies[1, i] = run.computePotentialEnergy(links, data)
            gaps = np.abs(states.gaps(len(block)))
            worst[:, start : block.stop] = gaps.max(axis=2, initial=0.0)
        (violation, constraint_velocity), (kinetic, potential) = worst, energies
        with np.errstate(all="ignore"):  # a run that was lost ends with numbers that overflow
            kinetic = kinetic + v**2 @ self._armature / 2
        return Kinematics(violation, constraint_velocity, kinetic, potential)

    def momentum(self, q: Array, v: Array) -> Array:
        """Return the momentum (k, 6) of the links at states q (k, nq), v (k, nv)."""
        # Linear, and angular about the centre of mass, in the axes of the world [kg m/s, kg m^2/s].
        links, data, found = self._links, self.equations.data, np.zeros((len(q), 6))
        for i in range(len(q)):
            found[i] = self._run.computeCentroidalMomentum(links, data, q[i], v[i]).vector
        return found


# One of a scene as it was written, one of it with contacts anchored, and those of others.
_gauges = ThreadCache[Gauge]()


def gauge_of(scene: Scene) -> Gauge:
    """Return this thread's gauge of a scene: an earlier one, or a new one."""
    scene.robot.check_unedited()
    return _gauges.of(scene, None, lambda: Gauge(scene))


def drive_power(scene: Scene, t: Array, q: Array, lam: Array) -> Array:
    """Return the power lam . s' of driven constraints at samples t (k,), q and lam (k, m) [W]."""
    power = np.zeros(len(t))
    for bound in scene.bounds:
        if bound.drive:
            rates = [bound.wanted_rate(*each) for each in zip(q, t.tolist(), strict=True)]
            power += (lam[:, bound.rows] * np.array(rates)).sum(axis=1)
    return power


def is_accurate(integrator: Integrator) -> bool:
    """True if a cubic spline of the power is less accurate than the integrator."""
    return integrator.order.v >= _ACCURATE


def damping_rate(passive: PassiveForces, v: Array, a: Array) -> Array | None:
    """Return the rate of the power of joint damping, d/dt (-d v^2), at samples (..., nv) [W/s]."""
    # None where frames are damped, whose rows change too.
    if passive.between is not None and passive.between.c.any():
        return None
    return np.asarray(-2.0 * (v * a) @ passive.d)


def work(t: Array, power: Array, rate: Array | None = None) -> Array:
    """Return the integral of power (k, ...) over t (k,), zero at the first sample."""
    # By a cubic spline through the samples, of order 4 where the power is smooth; with the `rate`
    # of the power [W/s] at the samples by polynomials of degree 7, of order 8. NaN where a run was
    # lost and its power overflows.
    if not np.isfinite(power).all():
        return np.full(power.shape, np.nan)
    if len(t) < 2 or not power.any():
        return np.zeros(power.shape)
    if rate is not None and np.isfinite(rate).all():
        of_power, of_rate = hermite_weights(t) if len(t) > _FEW else _weights(t.tobytes())
        near = _stencils(len(t))
        each = np.einsum("ij,ij...->i...", of_power, power[near])
        each += np.einsum("ij,ij...->i...", of_rate, rate[near])
        return np.concatenate((np.zeros((1, *power.shape[1:])), np.cumsum(each, axis=0)))
    if len(t) <= _FEW:
        return np.asarray(_integrals(t.tobytes()).dot(power))
    return _integral(t, power)


def integral_error(
    t: Array, power: Array, done: Array, between: Array, v: Array | None = None
) -> Array:
    """Estimated error of an integral `done` of power over t (k, ...), summed from the start."""
    # In each interval, the larger difference to the trapezoidal rule, and to the power `between` (k
    # - 1, ...) of the mean velocity of two samples: where a stiff damper alternates from step to
    # step, the powers at the samples are no estimate. Where velocities v (k, ..., nv) bend between
    # samples, the trapezoidal rule of |power| times their relative bend is added.
    if len(t) < 2 or not power.any():
        return np.zeros(power.shape)
    spans = np.diff(t).reshape(-1, *(1,) * (power.ndim - 1))
    with np.errstate(all="ignore"):  # a run that was lost
        each = np.diff(done, axis=0)
        trapezoids = 0.5 * spans * (power[1:] + power[:-1])
        off = np.maximum(np.abs(each - trapezoids), np.abs(each - spans * between))
        if v is not None:
            off += 0.5 * spans * _relative_bend(v) * (np.abs(power[1:]) + np.abs(power[:-1]))
        return np.concatenate((np.zeros((1, *power.shape[1:])), np.cumsum(off, axis=0)))


def _relative_bend(v: Array) -> Array:
    """Relative bend of velocities in each interval (k - 1, ...), at most 1."""
    # |v_2 - 2 v_1 + v_0| / (|v_2| + |v_0|): about (omega h)^2 / 2 of a frequency that the samples
    # resolve, 1 where they do not.
    size = np.linalg.norm(v, axis=-1)
    if len(v) < 3:  # no bend from two samples
        return np.ones((len(v) - 1, *size.shape[1:]))
    bend = np.linalg.norm(v[2:] - 2.0 * v[1:-1] + v[:-2], axis=-1)
    share = bend / np.maximum(size[2:] + size[:-2], np.finfo(float).tiny)
    share = np.minimum(share, 1.0)
    before, after = np.concatenate((share[:1], share)), np.concatenate((share, share[-1:]))
    return np.asarray(np.maximum(before, after))


# Samples of a stencil, and the largest ratio of their spacings: two samples that an event has put
# next to each other would make a difference of rounding out of their powers.
_STENCIL, _EVEN = 4, 4.0


def _stencils(count: int) -> NDArray[np.intp]:
    """Samples whose polynomial is integrated over each interval (k - 1, s)."""
    size = min(_STENCIL, count)
    first = np.clip(np.arange(count - 1) - (size // 2 - 1), 0, count - size)
    return np.asarray(first[:, None] + np.arange(size))


@lru_cache(maxsize=8)
def _weights(times: bytes) -> tuple[Array, Array]:
    return hermite_weights(np.frombuffer(times))


def hermite_weights(t: Array) -> tuple[Array, Array]:
    """Weights (k - 1, s) of powers [s] and of their rates [s^2] in the integral over each interval.

    Exact for the polynomial that has both at the samples of a stencil; of the two ends of the
    interval alone where those beside them are much nearer or further.
    """
    near = _stencils(len(t))
    spans = np.diff(t)
    x = (t[near] - t[:-1, None]) / spans[:, None]
    powers = np.arange(2 * near.shape[1])
    values = x[:, :, None] ** powers
    slopes = powers * x[:, :, None] ** np.maximum(powers - 1, 0)
    integral = np.broadcast_to(1.0 / (powers + 1.0), (len(x), len(powers)))
    rows = np.concatenate((values, slopes), axis=1)
    steps = np.diff(x, axis=1)
    even = (steps.max(axis=1) < _EVEN) & (steps.min(axis=1) > 1 / _EVEN)
    found = np.zeros((len(x), len(powers)))
    if even.any():
        transposed = rows[even].transpose(0, 2, 1)
        found[even] = np.linalg.solve(transposed, integral[even][:, :, None])[:, :, 0]
    size = near.shape[1]
    here = near == np.arange(len(t) - 1)[:, None]
    there = near == np.arange(1, len(t))[:, None]
    of_power, of_rate = found[:, :size], found[:, size:]
    uneven = ~even[:, None]
    of_power[uneven & (here | there)] = 0.5
    of_rate[uneven & here], of_rate[uneven & there] = 1 / 12, -1 / 12
    return of_power * spans[:, None], of_rate * spans[:, None] ** 2


@lru_cache(maxsize=8)
def _integrals(times: bytes) -> Array:
    """Return the matrix (k, k) that integrates: motion after motion has the same times."""
    t = np.frombuffer(times)
    return _integral(t, np.eye(len(t)))


def _integral(t: Array, power: Array) -> Array:
    """Return the integral of each column of power (k, ...) over t."""
    from scipy.interpolate import CubicSpline

    done = CubicSpline(t, power).antiderivative()(t)
    return np.asarray(done - done[0])
