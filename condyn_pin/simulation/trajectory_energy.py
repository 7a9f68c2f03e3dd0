"""The energies of a trajectory, and the work that explains how they change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.measures import Energy, Kinematics, drive_power, work
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
        applied = np.sum(trajectory.tau * trajectory.v, axis=1)
        damped = -passive.dissipation(trajectory.q, trajectory.v)
        sprung = passive.energy(trajectory.q)
    samples = [phase.samples for phase in trajectory.phases]
    impacts, struck = np.zeros((2, len(t)))
    for event in run.happened:
        struck[event.sample :] += event.driven
        if event.is_of_contacts:
            continue  # the work of contacts has it
        impacts[event.sample :] -= event.energy_lost
    return Energy(
        kinematics.kinetic,
        kinematics.potential,
        sprung,
        _chained([work(t[s], applied[s]) for s in samples]),
        _chained([work(t[s], damped[s]) for s in samples]),
        impacts,
        _driven_work(trajectory) + struck,
        *_contact_work(trajectory),
    )


def _contact_work(trajectory: Trajectory) -> tuple[Array, ...]:
    contact = trajectory.contact
    if contact is None:
        return tuple(np.zeros((3, len(trajectory.t))))
    return contact.work, contact.correction, contact.algorithmic


def _driven_work(trajectory: Trajectory) -> Array:
    """Return what driven constraints did between events (k,); steps with contacts book it."""
    booked = trajectory.contact.driven if trajectory.contact else None
    if booked is not None and isinstance(trajectory.run.integrator, ContactScheme):
        return booked
    return _chained(
        [work(trajectory.t[p.samples], _drive_power(trajectory, p)) for p in trajectory.phases]
    )


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
