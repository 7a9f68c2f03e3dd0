"""What a motion says about itself: violation, energy, momentum, work.

    E = 1/2 v^T M v + potential + sum_i k_i (q_i - q0_i)^2 / 2

and E changes by the work of the torques applied, that of damping, and what impacts take. Ideal
constraints do no work: what is left over is the error of the integration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.rows.equations import Equations

if TYPE_CHECKING:
    from condyn_pin.simulation.recorder import Phase


@dataclass(frozen=True, eq=False)
class Energy:
    """Energies at the samples of a trajectory, each (k,) [J].

    Attributes
    ----------
    kinetic, potential, springs : (k,) array
        [J]; the potential one is zero where Pinocchio has it: with all at the world's origin.
    work : (k,) array
        Of the torques applied, since the start [J].
    damping : (k,) array
        Work of the damping since the start; not positive [J].
    impacts : (k,) array
        What events did to the kinetic energy since the start [J].
    """

    kinetic: Array
    potential: Array
    springs: Array
    work: Array
    damping: Array
    impacts: Array

    @property
    def total(self) -> Array:
        """Kinetic, potential and springs (k,) [J]."""
        return self.kinetic + self.potential + self.springs

    @property
    def error(self) -> Array:
        """What the total has changed by that no work explains (k,) [J]."""
        total = self.total
        return np.asarray(total - total[0] - self.work - self.damping - self.impacts)

    @property
    def scale(self) -> float:
        """The largest change that was exchanged [J]: what an error is small in comparison to."""
        parts = (self.kinetic, self.potential, self.springs, self.work, self.damping)
        return float(max(np.ptp(part) for part in parts))

    @property
    def kept(self) -> float:
        """An error that is nothing beside the energies themselves [J]."""
        parts = (self.kinetic, self.potential, self.springs)
        return tolerances.ENERGY_KEPT * float(max(np.abs(part).max() for part in parts))


@dataclass(frozen=True, eq=False)
class Kinematics:
    """What forward kinematics says at the samples of a phase.

    Attributes
    ----------
    violation, slip : (k,) array
        max abs(c(q)) [m, rad] and max abs(J v) [m/s, rad/s]; zero without constraints.
    kinetic, potential : (k,) array
        [J]
    momentum : (k, 6) array
        Linear, and angular about the centre of mass, in the axes of the world [kg m/s, kg m^2/s].
    """

    violation: Array
    slip: Array
    kinetic: Array
    potential: Array
    momentum: Array


def kinematics(phase: Phase, q: Array, v: Array) -> Kinematics:
    """Return what forward kinematics says at the samples (q, v) of a phase."""
    model = phase.scene.robot.model
    equations = Equations(model, phase.scene.bounds)
    data = equations.data
    found = np.zeros((len(q), 4))
    momentum = np.zeros((len(q), 6))
    for i, (q_i, v_i) in enumerate(zip(q, v, strict=True)):
        c, slip = equations.open_by(q_i, v_i)
        kinetic = pin.computeKineticEnergy(model, data, q_i, v_i)
        potential = pin.computePotentialEnergy(model, data, q_i)
        found[i] = c, slip, kinetic, potential
        momentum[i] = pin.computeCentroidalMomentum(model, data, q_i, v_i).vector
    return Kinematics(found[:, 0], found[:, 1], found[:, 2], found[:, 3], momentum)


def work(t: Array, power: Array) -> Array:
    """Return the integral of power over t, zero at the first sample.

    By a cubic spline through the samples: of order 4 where the power is smooth.
    """
    from scipy.interpolate import CubicSpline

    done = np.zeros(len(t))
    if len(t) > 1 and power.any():
        done[:] = CubicSpline(t, power).antiderivative()(t)
        done -= done[0]
    return done
