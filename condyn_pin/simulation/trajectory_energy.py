"""The energies of a trajectory, and the work that explains how they change."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.measures import (
    Energy,
    Kinematics,
    damping_rate,
    doubt,
    drive_power,
    is_accurate,
    work,
)
from condyn_pin.simulation.passive import Passive
from condyn_pin.simulation.recorder import Phase

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory


def energy_of(trajectory: Trajectory, kinematics: Kinematics) -> Energy:
    """Return the energies at the samples, work integrated over these."""
    run, t = trajectory.run, trajectory.t
    robot, effects = trajectory.scene.robot, run.effects
    passive = Passive.of(robot, springs=effects.springs, damping=effects.damping)
    with np.errstate(all="ignore"):  # a run that was lost ends with numbers that overflow
        applied = _Power(trajectory, lambda q, v, tau: np.sum(tau * v, axis=1))
        damped = _Power(trajectory, lambda q, v, tau: -passive.dissipation(q, v))
        if is_accurate(run.integrator):
            damped.rate = damping_rate(passive, trajectory.v, trajectory.a)
        sprung = passive.energy(trajectory.q)
    impacts, struck = np.zeros((2, len(t)))
    for event in run.happened:
        struck[event.sample :] += event.driven
        if event.is_of_contacts:
            continue  # the work of contacts has it
        impacts[event.sample :] -= event.energy_lost
    done, taken = applied.work(), damped.work()
    driven = _driven_work(trajectory)
    return Energy(
        kinematics.kinetic, kinematics.potential, sprung, done[0], taken[0], impacts,
        driven[0] + struck, *_contact_work(trajectory),
        doubt=done[1] + taken[1] + driven[1],
    )  # fmt: skip


class _Power:
    """A power along a motion, of (q, v, tau): at its samples, and of mean velocities between."""

    def __init__(self, trajectory: Trajectory, of: Callable[[Array, Array, Array], Array]) -> None:
        q, v, tau = trajectory.q, trajectory.v, trajectory.tau
        self._motion, self._at = trajectory, of(q, v, tau)
        self._between = of(q[:-1], 0.5 * (v[1:] + v[:-1]), 0.5 * (tau[1:] + tau[:-1]))
        self.rate: Array | None = None  # of the power at the samples [W/s]

    def work(self) -> tuple[Array, Array]:
        """Return its work since the start (k,), and the doubt of it [J]."""
        parts, doubts = [], []
        for phase in self._motion.phases:
            its = phase.samples
            t, power = self._motion.t[its], self._at[its]
            parts.append(work(t, power, None if self.rate is None else self.rate[its]))
            between, v = self._between[its.start : its.stop - 1], self._motion.v[its]
            doubts.append(doubt(t, power, parts[-1], between, v))
        return _chained(parts), _chained(doubts)


def _contact_work(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    contact = trajectory.contact
    if contact is None:
        none = np.zeros(len(trajectory.t))
        return none, none, none
    return contact.work, contact.correction, contact.algorithmic


def _driven_work(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return what driven constraints did between events (k,), and its doubt; steps book it."""
    booked = trajectory.contact.driven if trajectory.contact else None
    if booked is not None and isinstance(trajectory.run.integrator, ContactScheme):
        return booked, np.zeros(len(booked))
    parts, doubts = [], []
    for phase in trajectory.phases:
        t, power = trajectory.t[phase.samples], _drive_power(trajectory, phase)
        parts.append(work(t, power))
        doubts.append(doubt(t, power, parts[-1], 0.5 * (power[1:] + power[:-1])))
    return _chained(parts), _chained(doubts)


def _drive_power(trajectory: Trajectory, phase: Phase) -> Array:
    lam = trajectory.lam[phase.samples][:, list(phase.columns)]
    return drive_power(phase.scene, trajectory.t[phase.samples], lam)


def _chained(parts: list[Array]) -> Array:
    """Return integrals over phases, each beginning where the one before ended."""
    start, chained = 0.0, []
    for part in parts:
        chained.append(start + part)
        start = chained[-1][-1]
    return np.concatenate(chained)
