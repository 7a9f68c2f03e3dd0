"""A motion in words: how it was made, how far it drifted, and where its energy went."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from condyn_pin._core.arguments import counted
from condyn_pin.contact.problem import MODES
from condyn_pin.simulation.measures import Energy

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.simulation.trajectory import Trajectory

# Events that are listed, at most.
_SHOWN: Final = 20


def trajectory_text(motion: Trajectory) -> str:
    """Return what `print` shows of a trajectory."""
    run, energy, scene = motion.run, motion.energy, motion.scene
    ratio = motion.t[-1] / run.wall_time if run.wall_time else float("nan")
    return "\n".join(
        [
            f"{scene.robot.name}, {_counts(scene)}: {motion.t[-1]:.6g} s in steps of "
            f"{1e3 * run.dt:.4g} ms, {len(motion.t)} samples, {motion.status.name.lower()}",
            run.choices,
            run.effects.text(scene.robot),
            f"took        {run.wall_time:.3g} s, {ratio:.3g} x real time",
            *_constraint_lines(motion),
            *_energy_lines(energy, is_driven=any(phase.scene.is_driven for phase in motion.phases)),
            *_event_lines(motion),
            *(f"note: {notice}" for notice in motion.notices),
        ]
    )


def _counts(scene: Scene) -> str:
    """How many rows of constraints, and how many contacts, a scene has."""
    contacts = sum(len(bound.candidates) for bound in scene.contact_bounds)
    rows = [f"{scene.rows} rows"] if scene.rows or not contacts else []
    return ", ".join([*rows, *([counted(contacts, "contact")] if contacts else [])])


def _constraint_lines(motion: Trajectory) -> list[str]:
    """How far constraints were violated, how deep contacts were, and what these do at the end."""
    lines = []
    if any(phase.scene.rows for phase in motion.phases):
        lines.append(
            f"violation   {motion.violation.max():.1e} m, rad at most; "
            f"{motion.constraint_velocity.max():.1e} m/s, rad/s"
        )
    if motion.contact:
        deepest = max((-float(np.nanmin(gap)) for gap in motion.gaps.values()), default=0.0)
        last = [its[-1] for its in motion.modes.values()]
        modes = ", ".join(f"{last.count(mode)} {mode}" for mode in MODES if mode in last)
        lines.append(
            f"contacts    penetrate by {max(deepest, 0.0):.1e} m, rad at most; at the end {modes}"
        )
    return lines


def _energy_lines(energy: Energy, *, is_driven: bool) -> list[str]:
    lines = [
        f"energy      {energy.total[0]:.6g} J to {energy.total[-1]:.6g} J; work of tau "
        f"and forces {energy.work[-1]:.4g} J, of damping {energy.damping[-1]:.4g} J, impacts "
        f"{energy.impacts[-1]:.4g} J, contacts {energy.contact[-1]:.4g} J"
        + (f", drives {energy.driven[-1]:.4g} J" if is_driven else "")
    ]
    if energy.correction.any() or energy.algorithmic.any():  # of steps with contacts
        lines.append(
            f"            corrections {energy.correction[-1]:.4g} J, algorithmic "
            f"{energy.algorithmic[-1]:.4g} J"
        )
    return [*lines, f"unexplained {np.abs(energy.error).max():.1e} J at most"]


def _event_lines(motion: Trajectory) -> list[str]:
    events, more = motion.run.happened[:_SHOWN], len(motion.run.happened) - _SHOWN
    lines = [f"event       {each.name} at t = {each.t:.9g} s" for each in events]
    lines += [f"event       and {more} more"] if more > 0 else []
    return [*lines, *(f"event       {missed}" for missed in motion.run.missed)]
