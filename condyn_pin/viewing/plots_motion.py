"""Diagrams of a motion: constraint violation, energy and forces over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.show import axes, finished, line
from condyn_pin.errors import unknown_name
from condyn_pin.simulation.trajectory import Trajectory

_LEAST: Final = 1e-17  # where zero is drawn on a scale of logarithms

TIME: Final = "t [s]"


def violation(trajectory: Trajectory, ax: Any = None) -> Any:
    """Draw max abs(c(q)) and max abs(J v) over time, on a scale of logarithms.

    Parameters
    ----------
    trajectory : Trajectory
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    lines = {
        "max |c(q)| [m, rad]": np.maximum(trajectory.violation, _LEAST),
        "max |J v| [m/s, rad/s]": np.maximum(trajectory.constraint_velocity, _LEAST),
    }
    ax = over_time(trajectory, lines, ax, y="violation")
    ax.set_yscale("log")
    return ax


def energy(trajectory: Trajectory, ax: Any = None) -> Any:
    """Draw the energies over time, the work done, and the unexplained rest.

    The total is drawn against its start, and so are the work of tau and forces, damping, impacts,
    drives, contacts, their corrections and the algorithmic part: with a good integrator
    `unexplained` is a line along zero.

    Parameters
    ----------
    trajectory : Trajectory
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    found = trajectory.energy
    lines = {
        "kinetic": found.kinetic,
        "potential, from the start": found.potential - found.potential[0],
        "springs": found.springs,
        "total, from the start": found.total - found.total[0],
        "work of tau and forces": found.work,
        "damping": found.damping,
        "impacts": found.impacts,
        "drives": found.driven,
        "contacts": found.contact,
        "corrections": found.correction,
        "algorithmic": found.algorithmic,
        "unexplained": found.error,
    }
    shown = {k: x for k, x in lines.items() if x.any() or k == "unexplained"}
    return over_time(trajectory, shown, ax, y="energy [J]")


def forces(trajectory: Trajectory, names: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Draw the size of the forces of constraints and contacts over time.

    Parameters
    ----------
    trajectory : Trajectory
    names : sequence of str, optional
        Of constraints and contacts; all of them by default.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
        One line each: the Euclidean norm of the force, moments left out [N]; of a coupling, a stop
        or dry friction the force along its joint [N m or N].

    Raises
    ------
    UnknownName
        If there is no such constraint or contact.
    """
    found = trajectory.forces
    for name in names or ():
        if name not in found:
            raise unknown_name("constraint or contact", name, found)
    chosen = found if names is None else names
    lines = {name: np.linalg.norm(found[name][:, :3], axis=1) for name in chosen}
    ax = over_time(trajectory, lines, ax, y="force [N]")
    ax.update_datalim([(trajectory.t[0], 0.0)])  # from zero: a steady force is a level line
    ax.autoscale_view()
    return ax


def over_time(trajectory: Trajectory, lines: Mapping[str, Array], ax: Any, *, y: str) -> Any:
    """Draw lines (k,) by their labels over the samples, with the events; return the axes."""
    ax = axes(ax)
    for i, (label, values) in enumerate(lines.items()):
        ax.plot(trajectory.t, values, label=label, **line(i))
    mark_events(trajectory, ax)
    return finished(ax, title=title_of(trajectory), x=TIME, y=y)


def mark_events(trajectory: Trajectory, ax: Any) -> None:
    """Draw a line at every event."""
    for event in trajectory.run.happened:
        ax.axvline(event.t, color="0.6", lw=0.8, ls=":")


def title_of(trajectory: Trajectory) -> str:
    """Return the title of a motion: robot, integrator and step [s]."""
    run = trajectory.run
    return f"{trajectory.scene.robot.name}: {type(run.integrator).__name__}, dt {run.dt:g} s"
