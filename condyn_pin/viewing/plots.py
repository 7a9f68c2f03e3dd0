"""Diagrams: of motions, of contacts that open and slide, of balance, and of scenes.

Each draws on axes of matplotlib, or on a new figure, and returns the axes. For a paper:

    with plots.style("paper"):
        plots.energy(run)
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arrays import Array, text_of
from condyn_pin._core.show import COLOURS, axes, labelled_axes, line
from condyn_pin._core.show import style as style
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.simulation.trajectory import MotionBalance, Trajectory, motion_balance
from condyn_pin.viewing.part import mode_colour

_LEAST: Final = 1e-17  # where zero is drawn on a scale of logarithms
_MODES: Final = ("open", "stick", "slide")
_HEIGHT: Final = 0.8  # of the bar of a contact
_OPEN: Final = 0.25  # height of its line while it is open
_SAME: Final = 1e-3  # [m] supports whose corners are nearer are drawn once
_SUPPORTS: Final = 8  # polygons of a motion that are drawn: more would hide the paths


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
    ax = _over_time(trajectory, lines, ax, y="violation")
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
    return _over_time(trajectory, shown, ax, y="energy [J]")


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
    ax = _over_time(trajectory, lines, ax, y="force [N]")
    ax.update_datalim([(trajectory.t[0], 0.0)])  # from zero: a steady force is a level line
    ax.autoscale_view()
    return ax


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
        If the scene has no contacts that may open.
    UnknownName
        If one has another name, or is dry friction, which has no distance.
    """
    found = trajectory.gaps
    lines = {name: found[name] for name in _chosen_names(names, found)}
    ax = _over_time(trajectory, lines, ax, y="gap [m, rad]")
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
        If the scene has no contacts that may open.
    UnknownName
        If one has another name, or is dry friction, which has no normal.
    """
    forces = trajectory.forces
    lines = {name: forces[name][:, -1] for name in _chosen_names(names, trajectory.gaps)}
    return _over_time(trajectory, lines, ax, y="normal force [N, N m]")


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
        If the scene has no contacts that may open.
    UnknownName
        If one has another name.
    """
    found = trajectory.modes
    chosen, ax = _chosen_names(names, found), axes(ax)
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
    _mark_events(trajectory, ax)
    labelled_axes(ax, title=_title_of(trajectory), x="t [s]", y="")
    ax.legend(fontsize="small", frameon=False, loc="lower center", ncols=len(_MODES))  # below
    return ax


def _over_time(trajectory: Trajectory, lines: Mapping[str, Array], ax: Any, *, y: str) -> Any:
    """Draw lines (k,) by their labels over the samples, with the events; return the axes."""
    ax = axes(ax)
    for i, (label, values) in enumerate(lines.items()):
        ax.plot(trajectory.t, values, label=label, **line(i))
    _mark_events(trajectory, ax)
    return labelled_axes(ax, title=_title_of(trajectory), x="t [s]", y=y)


def _mark_events(trajectory: Trajectory, ax: Any) -> None:
    """Draw a line at every event."""
    for event in trajectory.run.happened:
        ax.axvline(event.t, color="0.6", lw=0.8, ls=":")


def _title_of(trajectory: Trajectory) -> str:
    """Return the title of a motion: robot, integrator and step [ms]."""
    run = trajectory.run
    return f"{trajectory.scene.robot.name}: {type(run.integrator).__name__}, {1e3 * run.dt:g} ms"


def _spans(t: NDArray[Any], holds: NDArray[Any]) -> list[tuple[float, float]]:
    """Start and length of each interval in which a condition holds [s].

    A sample has the state of the step that ended there, which began at the sample before.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False])).astype(int)))
    starts = np.maximum(edges[::2] - 1, 0)
    return [(t[a], t[b - 1] - t[a]) for a, b in zip(starts, edges[1::2], strict=True)]


def _chosen_names(names: Sequence[str] | None, known: Collection[str]) -> list[str]:
    if not known:
        raise InvalidArgument("trajectory: its scene has no contacts that may open")
    for name in names or ():
        if name not in known:
            raise unknown_name("contact", name, known)
    return list(known if names is None else names)


# Balance along a motion: points of pressure and capture seen from above, and margins.
#
# All points are in the axes of the world, x and y [m]. With c the centre of mass, h its height
# above the plane of the contacts, omega = sqrt(g / h) and (f, n) the wrench of the floor:
#
#     ZMP             where (f, n) leaves a moment along the normal alone; of the motion alone
#     CoP             the mean of the contact points, weighted by normal forces; of the forces alone
#     DCM             c + cdot / omega, and the capture point is its foot on the plane
#
# ZMP and CoP are one where nothing but the floor acts from outside. They, and the support polygon,
# are there while all contacts that touch are on one plane; the capture point is that of a linear
# inverted pendulum, whose height and angular momentum do not change. In flight there is none.


def from_above(
    trajectory: Trajectory, ax: Any = None, *, found: MotionBalance | None = None
) -> Any:
    """Draw the paths of centre of mass, ZMP, CoP and capture point over the support, from above.

    Each path starts at its dot; support polygons of the motion are areas, eight at most.

    Parameters
    ----------
    trajectory : Trajectory
    ax : matplotlib axes, optional
        A new figure by default.
    found : MotionBalance, optional
        That of the trajectory, if it is known; it is computed by default.

    Returns
    -------
    matplotlib axes
        x and y of the world [m], with one scale; heights are left out.

    Raises
    ------
    InvalidArgument
        If nothing of it could press on a floor, or what was found is of another motion.
    """
    found = _balance_of(trajectory, found)
    ax = axes(ax)
    supports = _supports(found)
    for i, corners in enumerate(supports[:: math.ceil(len(supports) / _SUPPORTS) or 1]):
        ax.fill(*corners.T, facecolor="0.6", edgecolor="0.4", alpha=0.2, lw=0.8,
                label="" if i else "support")  # fmt: skip
    ways = {
        "centre of mass": found.com,
        "ZMP": found.zmp,
        "CoP": found.cop,
        "capture point": found.capture_point,
    }
    for i, (label, points) in enumerate(ways.items()):
        drawn = ax.plot(points[:, 0], points[:, 1], label=label, **line(i))[0]
        known = np.flatnonzero(np.isfinite(points[:, 0]))
        if len(known):
            start = points[known[0]]
            ax.plot(start[0], start[1], "o", ms=4, color=drawn.get_color(), label="_start")
    labelled_axes(ax, title=_title_of(trajectory), x="x [m]", y="y [m]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend(fontsize="small", frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.15),
              ncols=3)  # fmt: skip
    return ax


def margins(trajectory: Trajectory, ax: Any = None, *, found: MotionBalance | None = None) -> Any:
    """Draw the margins of ZMP, CoP and capture point to the support polygon's edge over time.

    A CoP is never below zero. A ZMP below zero says that more than the floor acted, a push above
    all, and a capture point that the robot falls unless it steps. There is no line in flight.

    Parameters
    ----------
    trajectory : Trajectory
    ax : matplotlib axes, optional
        A new figure by default.
    found : MotionBalance, optional
        That of the trajectory, if it is known; it is computed by default.

    Returns
    -------
    matplotlib axes
        One line each: the distance to the nearest edge [m].

    Raises
    ------
    InvalidArgument
        If nothing of it could press on a floor, or what was found is of another motion.
    """
    found = _balance_of(trajectory, found)
    ax = axes(ax)
    lines = {
        "ZMP": found.zmp_margin,
        "CoP": found.cop_margin,
        "capture point": found.capture_margin,
    }
    for i, (label, values) in enumerate(lines.items(), start=1):
        ax.plot(found.t, values, label=label, **line(i))
    ax.axhline(0.0, color="0.6", lw=0.8)
    _mark_events(trajectory, ax)
    return labelled_axes(ax, title=_title_of(trajectory), x="t [s]", y="margin to the edge [m]")


def _balance_of(trajectory: Trajectory, found: MotionBalance | None) -> MotionBalance:
    """Balance of a motion, computed unless it is given."""
    if found is None:
        return motion_balance(trajectory)
    if not (isinstance(found, MotionBalance) and np.array_equal(found.t, trajectory.t)):
        raise InvalidArgument(
            f"found = {text_of(found)}: it is not of this motion; motion_balance(trajectory) is"
        )
    return found


def _supports(found: MotionBalance) -> list[Any]:
    """Distinct support polygons of a motion (k, 2), their corners in the world [m]."""
    seen: dict[bytes, Any] = {}
    for polygon in found.polygons:
        if polygon is not None:
            corners = polygon.in_world[:, :2]
            seen.setdefault(np.round(corners / _SAME).tobytes(), corners)
    return list(seen.values())


# Scenes: singular values along a path, and the sparsity of derivatives.


def singular_values(
    scene: Scene, path: ArrayLike, along: ArrayLike | None = None, ax: Any = None
) -> Any:
    """Draw the singular values of J M^-1/2 along a path; one that dips marks a dead point.

    Parameters
    ----------
    scene : Scene
        With at least one row.
    path : (k, nq) array_like
        Configurations.
    along : (k,) array_like, optional
        What they are drawn over, such as the angle of a motor; their number by default.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
        One line a singular value, the largest first [1/sqrt(kg)]; those of redundant rows lie at
        the rounding.

    Raises
    ------
    InvalidArgument
        If the scene has no rows, or the path is none.
    """
    configurations = np.atleast_2d(np.asarray(path, dtype=float))
    if not scene.rows or not configurations.size:
        missing = "path is empty" if scene.rows else "the scene has no rows"
        raise InvalidArgument(f"{missing}: there is nothing to draw")
    x = np.arange(len(configurations)) if along is None else np.asarray(along, dtype=float)
    if x.shape != (len(configurations),):
        raise InvalidArgument(f"along has shape {x.shape}: one number a configuration is needed")
    values = np.array([scene.rank(q).singular_values for q in configurations])
    ax = axes(ax)
    for i, each in enumerate(values.T):
        ax.plot(x, np.maximum(each, _LEAST), **line(i))
    ax.set_yscale("log")
    title = f"{scene.robot.name}: {scene.rows} rows"
    along_text = "configuration" if along is None else ""
    return labelled_axes(ax, title=title, x=along_text, y="singular values [1/sqrt(kg)]")


def sparsity(derivatives: Derivatives, ax: Any = None) -> Any:
    """Draw which accelerations and forces depend on which of q, v and tau.

    Parameters
    ----------
    derivatives : Derivatives
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
        Rows are a and lam, columns q, v and tau; a mark where abs(derivative) is above 1e-12 of the
        largest one of a, or of lam.
    """
    d = derivatives
    blocks = [[d.da_dq, d.da_dv, d.da_dtau], [d.dlam_dq, d.dlam_dv, d.dlam_dtau]]
    n, m = d.da_dq.shape[0], d.dlam_dq.shape[0]
    rows = [np.abs(np.hstack(row)) for row in blocks]
    marks = np.vstack([row > 1e-12 * row.max(initial=0.0) for row in rows])
    ax = axes(ax)
    size = max(1.0, 200.0 / marks.shape[1])
    ax.spy(marks, marker="s", markersize=size, color=COLOURS[0])
    for edge in (n, 2 * n):
        ax.axvline(edge - 0.5, color="0.4", lw=0.8)
    if m:
        ax.axhline(n - 0.5, color="0.4", lw=0.8)
    ax.set_xticks([0.5 * n, 1.5 * n, 2.5 * n], ["q", "v", "tau"])
    ax.set_yticks([0.5 * n, n + 0.5 * m] if m else [0.5 * n], ["a", "lam"] if m else ["a"])
    full = 100.0 * marks.mean()
    ax.set(title=f"{full:.0f} % of {marks.size} derivatives are not zero")
    return ax
