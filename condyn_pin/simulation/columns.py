"""Columns of motions, named by joint: the samples of one, the ends of many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from condyn_pin._core.arrays import Array
from condyn_pin.model.joints import coordinate_names

if TYPE_CHECKING:
    from condyn_pin.simulation.batch.batch_step import BatchStep
    from condyn_pin.simulation.batch.trajectory import BatchTrajectory
    from condyn_pin.simulation.trajectory import Trajectory


def columns(trajectory: Trajectory) -> dict[str, Array]:
    """Return t, q, v, a, tau, lam, violation, J v and energy by name, each (k,)."""
    table = {"t [s]": trajectory.t}
    table |= _by_joint(trajectory, "q", "v", "a", "tau")
    lam = (f"lam {name}" for name in trajectory.row_names)
    table |= dict(zip(lam, trajectory.lam.T, strict=True))
    table["violation"] = trajectory.violation
    table["constraint_velocity"] = trajectory.constraint_velocity
    energy = trajectory.energy
    return table | {f"{f.name} [J]": getattr(energy, f.name) for f in fields(energy)}


def ends(batch: BatchTrajectory) -> dict[str, Any]:
    """Return statuses, reasons, ends and errors of motions by name, each (N,)."""
    table: dict[str, Any] = {"status": batch.status_names, "reason": batch.reasons}
    table |= {"t [s]": batch.t} | _by_joint(batch, "q", "v")
    return table | {name: getattr(batch, name) for name in _ERRORS}


def step_columns(batch: BatchStep, errors: Sequence[str]) -> dict[str, Any]:
    """Return statuses, ends, modes and errors of steps by name, each (N,)."""
    table: dict[str, Any] = {"status": batch.status_names} | _by_joint(batch, "q", "v")
    table |= {f"mode {name}": modes for name, modes in batch.modes.items()}
    return table | dict(zip(errors, batch.errors.T, strict=True))


_ERRORS = ("violation", "constraint_velocity", "energy_error", "run_times")


def _by_joint(of: Trajectory | BatchTrajectory | BatchStep, *kinds: str) -> dict[str, Array]:
    """Return the columns of some arrays, named by joint."""
    model, table = of.scene.robot.model, dict[str, Array]()
    for kind in kinds:
        names = [f"{kind} {name}" for name in coordinate_names(model, "q" if kind == "q" else "v")]
        table |= dict(zip(names, getattr(of, kind).T, strict=True))
    return table
