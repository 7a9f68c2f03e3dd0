"""Diagrams of contacts that open and slide: gaps, normal forces and modes, over time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.show import axes, finished
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.viewing.part import mode_colour
from condyn_pin.viewing.plots_motion import TIME, mark_events, over_time, title_of

_MODES: Final = ("open", "stick", "slide")
_HEIGHT: Final = 0.8  # of the bar of a contact
_OPEN: Final = 0.25  # height of its line while it is open


def gaps(trajectory: Trajectory, names: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Draw the signed distance of contacts and stops over time; below zero they penetrate.

    Parameters
    ----------
    trajectory : Trajectory
    names : sequence of str, optional
        Of contacts and stops; all of them by default.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
        One line each [m, rad].

    Raises
    ------
    InvalidArgument
        If the scene has no contacts that may let go.
    UnknownName
        If one has another name, or is dry friction, which has no distance.
    """
    found = trajectory.gaps
    lines = {name: found[name] for name in _chosen(names, found)}
    ax = over_time(trajectory, lines, ax, y="gap [m, rad]")
    ax.axhline(0.0, color="0.6", lw=0.8)
    return ax


def normal_forces(
    trajectory: Trajectory, names: Sequence[str] | None = None, ax: Any = None
) -> Any:
    """Draw the normal forces of contacts, and those of stops, over time: impulses over dt.

    Parameters
    ----------
    trajectory : Trajectory
    names : sequence of str, optional
        Of contacts and stops; all of them by default.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
        One line each [N, N m]. An impact is a peak whose height grows with 1/dt.

    Raises
    ------
    InvalidArgument
        If the scene has no contacts that may let go.
    UnknownName
        If one has another name, or is dry friction, which has no normal.
    """
    forces = trajectory.forces
    lines = {name: forces[name][:, -1] for name in _chosen(names, trajectory.gaps)}
    return over_time(trajectory, lines, ax, y="normal force [N, N m]")


def modes(trajectory: Trajectory, names: Sequence[str] | None = None, ax: Any = None) -> Any:
    """Draw when each contact is open, sticks and slides: a bar each, thin while it is open.

    Parameters
    ----------
    trajectory : Trajectory
    names : sequence of str, optional
        Of contacts, stops and dry friction; all of them by default.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
        The first contact on top; colours are those of `view`.

    Raises
    ------
    InvalidArgument
        If the scene has no contacts that may let go.
    UnknownName
        If one has another name.
    """
    found = trajectory.modes
    chosen, ax = _chosen(names, found), axes(ax)
    for mode in _MODES:
        height = _OPEN if mode == "open" else _HEIGHT
        label = mode
        for row, name in enumerate(chosen):
            spans = _spans(trajectory.t, found[name] == mode)
            if spans:
                ax.broken_barh(
                    spans, (row - 0.5 * height, height), facecolor=mode_colour(mode), label=label
                )
                label = ""  # once in the legend
    ax.set_yticks(range(len(chosen)), chosen)
    ax.set_ylim(len(chosen) + 0.1, -0.5)
    mark_events(trajectory, ax)
    finished(ax, title=title_of(trajectory), x=TIME, y="")
    ax.legend(fontsize=7, frameon=False, loc="lower center", ncols=len(_MODES))  # below all bars
    return ax


def _spans(t: NDArray[Any], holds: NDArray[Any]) -> list[tuple[float, float]]:
    """Start and length of each interval in which a condition holds [s].

    A sample has the state of the step that ended there, which began at the sample before.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False])).astype(int)))
    starts = np.maximum(edges[::2] - 1, 0)
    return [(t[a], t[b - 1] - t[a]) for a, b in zip(starts, edges[1::2], strict=True)]


def _chosen(names: Sequence[str] | None, known: Collection[str]) -> list[str]:
    if not known:
        raise InvalidArgument("trajectory: its scene has no contacts that may let go")
    for name in names or ():
        if name not in known:
            raise unknown_name("contact", name, known)
    return list(known if names is None else names)
