"""A Trajectory as a notebook shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import show

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

_EVENTS = 20  # that are listed


def trajectory_html(trajectory: Trajectory) -> str:
    """Return how a motion was made, its errors as curves, its events and notices."""
    run, energy, t = trajectory.run, trajectory.energy, trajectory.t
    said = {
        "motion": f"{t[-1] - t[0]:.6g} s in steps of {1e3 * run.dt:.4g} ms, {len(t)} samples",
        "chosen": run.choices,
        "effects": run.effects.text(trajectory.scene.robot),
        "took": f"{run.wall_time:.3g} s",
    }
    events = [(each.name, f"{each.t:.6g}") for each in run.happened[:_EVENTS]]
    more = len(run.happened) - len(events)
    return show.page(
        f"{trajectory.scene.robot.name}: {run.status.name.lower()}",
        show.notes([trajectory.reason] if trajectory.reason else []),
        show.facts(said.items()),
        show.curve("open constraints", t, trajectory.violation, "m, rad")
        if trajectory.scene.rows
        else "",
        show.curve("energy", t, energy.total, "J"),
        show.curve("energy that nothing explains", t, np.abs(energy.error), "J"),
        show.folded(
            f"{len(run.happened)} events" + (f", the first {_EVENTS} here" if more > 0 else ""),
            show.grid(("event", "t [s]"), events),
            count=len(events),
        ),
        show.notes([*run.missed, *trajectory.notices]),
        ok=run.status.ok,
    )
