"""Columns of a trajectory: its samples as a table, named by joint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from condyn_pin._core.arrays import Array

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory


def columns(trajectory: Trajectory) -> dict[str, Array]:
    """Return t, q, v, a, tau, lam, violation, J v and energy by name, each (k,)."""
    model = trajectory.scene.robot.model
    table = {"t [s]": trajectory.t}
    for kind, values in (("q", trajectory.q), *((x, getattr(trajectory, x)) for x in _OF_V)):
        names = [f"{kind} {name}" for name in _entries(model, of_q=kind == "q")]
        table |= dict(zip(names, values.T, strict=True))
    lam = (f"lam {name}" for name in trajectory.row_names)
    table |= dict(zip(lam, trajectory.lam.T, strict=True))
    table["violation"] = trajectory.violation
    table["constraint_velocity"] = trajectory.constraint_velocity
    energy = trajectory.energy
    return table | {f"{f.name} [J]": getattr(energy, f.name) for f in fields(energy)}


_OF_V = ("v", "a", "tau")


def _entries(model: Any, *, of_q: bool) -> Iterator[str]:
    """Yield a name for each entry of q, or of v: the joint, with a number if it has several."""
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        size = joint.nq if of_q else joint.nv
        yield from [name] if size == 1 else (f"{name}[{i}]" for i in range(size))
