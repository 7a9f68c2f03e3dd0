"""What a motion says about itself: violation, energy, momentum, work.

    E = 1/2 v^T M v + potential + sum_i k_i (q_i - q0_i)^2 / 2

and E changes by the work of torques and forces applied, that of damping, what impacts take, what
constraints bring that follow a path of time, lam . s', and by contacts that open and slide, whose
work comes in three parts (`ContactWork`). Ideal constraints at rest do no work: what is left over
is the error of the integration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.kept import Kept
from condyn_pin.constraints.along import along_at
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.many import MANY, ManyGaps
from condyn_pin.dynamics.scene import Scene

# Samples for which a matrix of them all is small.
_FEW = 64


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

    @property
    def total(self) -> Array:
        """Kinetic, potential and springs (k,) [J]."""
        return self.kinetic + self.potential + self.springs

    @property
    def error(self) -> Array:
        """Change of the total energy that no work accounts for (k,) [J]."""
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
    def kept(self) -> float:
        """An error that is rounding beside the energies themselves [J]."""
        parts = (self.kinetic, self.potential, self.springs)
        return tolerances.ENERGY_KEPT * float(max(np.abs(part).max() for part in parts))

    def __repr__(self) -> str:
        total = self.total
        return (
            f"Energy({len(total)} samples, {total[0]:.6g} J to {total[-1]:.6g} J, unexplained "
            f"{np.abs(self.error).max():.1e} J at most)"
        )


class Kinematics(NamedTuple):
    """What forward kinematics says at the samples of a phase, (k,) each."""

    violation: Array  # max abs(c(q)) [m, rad]; zero without constraints
    constraint_velocity: Array  # max abs(J v) [m/s, rad/s]
    kinetic: Array  # [J]
    potential: Array  # [J]


class Gauge:
    """The memory to measure states of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.equations = Equations(scene.robot.model, scene.bounds)
        self._armature = np.array(scene.robot.model.armature)
        # Pinocchio leaves the armature of joints about a slanted axis out of the kinetic energy
        self._links = pin.Model(scene.robot.model)
        self._links.armature[:] = 0.0

    @cached_property
    def _states(self) -> ManyGaps:
        return ManyGaps(self.equations)

    def measure(self, t: Array, q: Array, v: Array) -> Kinematics:
        """Return what forward kinematics says at times t (k,), states q (k, nq), v (k, nv)."""
        states, links, data = self._states, self._links, self.equations.data
        count = len(q)
        worst, energies = np.zeros((2, 2, count))
        for start in range(0, count, MANY):
            block = range(start, min(start + MANY, count))
            for i in block:
                states.look(i - start, q[i], v[i], t[i])
                # the rest reads what that has left in data
                energies[0, i] = pin.computeKineticEnergy(links, data)
                energies[1, i] = pin.computePotentialEnergy(links, data)
            gaps = np.abs(states.gaps(len(block)))
            worst[:, start : block.stop] = gaps.max(axis=2, initial=0.0)
        (violation, constraint_velocity), (kinetic, potential) = worst, energies
        with np.errstate(all="ignore"):  # a run that was lost ends with numbers that overflow
            kinetic = kinetic + v**2 @ self._armature / 2
        return Kinematics(violation, constraint_velocity, kinetic, potential)

    def momentum(self, q: Array, v: Array) -> Array:
        """Return the momentum (k, 6) of the links at states q (k, nq), v (k, nv).

        Linear, and angular about the centre of mass, in the axes of the world [kg m/s, kg m^2/s].
        """
        links, data, found = self._links, self.equations.data, np.zeros((len(q), 6))
        for i in range(len(q)):
            found[i] = pin.computeCentroidalMomentum(links, data, q[i], v[i]).vector
        return found


# One of a scene as it was written, one of it with contacts anchored, and those of others.
_gauges = Kept[Gauge]()


def gauge_of(scene: Scene) -> Gauge:
    """Return this thread's gauge of a scene: an earlier one, or a new one."""
    scene.robot.check_unedited()
    return _gauges.of(scene, None, lambda: Gauge(scene))


def drive_power(scene: Scene, t: Array, lam: Array) -> Array:
    """Return the power lam . s' of driven constraints at samples t (k,), lam (k, m) [W]."""
    power = np.zeros(len(t))
    for bound in scene.bounds:
        if bound.drive:
            rates = [along_at(bound.drive.along, each, bound.size, bound.name)[1] for each in t]
            power += (lam[:, bound.rows] * np.array(rates)).sum(axis=1)
    return power


def work(t: Array, power: Array) -> Array:
    """Return the integral of power (k, ...) over t (k,), zero at the first sample.

    By a cubic spline through the samples: of order 4 where the power is smooth. NaN where a run was
    lost and its power overflows.
    """
    if not np.isfinite(power).all():
        return np.full(power.shape, np.nan)
    if len(t) < 2 or not power.any():
        return np.zeros(power.shape)
    if len(t) <= _FEW:
        return np.asarray(_integrals(t.tobytes()).dot(power))
    return _integral(t, power)


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
