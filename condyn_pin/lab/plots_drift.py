"""Pictures of the drift laboratory: growth of gaps, stability of gains, energy over long times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core.plot_style import COLOURS, write_figure
from condyn_pin._core.plots import axes, panels
from condyn_pin.lab.contest import Contest
from condyn_pin.lab.laboratory import Growth, stability_map
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.stability_limit import stability_limit

# Okabe and Ito's colours; the lines tell them apart in print.
_LINES = ("-", "--", "-.", ":", "-", "--")


def draw_growth(found: Mapping[str, Growth], ax: Any = None) -> Any:
    """Draw the gap against time of runs that nothing closes; the slope is the power of t.

    Parameters
    ----------
    found : mapping of str to Growth
        By the title of the integrator.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    ax = axes(ax)
    for (title, growth), colour, line in zip(found.items(), COLOURS, _LINES, strict=False):
        seen = growth.violation > 0
        label = f"{title}: t^{growth.power:.2f}"
        ax.plot(growth.t[seen], growth.violation[seen], line, color=colour, label=label)
    ax.set(title="gap without stabilisation", xscale="log", yscale="log")
    ax.set(xlabel="t [s]", ylabel="max abs(c) so far [m]")
    ax.grid(visible=True, color="0.9")
    ax.legend(fontsize=7, frameon=False)
    return ax


def draw_stability(integrator: Integrator, ax: Any = None, *, points: int = 60) -> Any:
    """Draw the factor by which a gap grows in a step over Baumgarte's gains.

    Parameters
    ----------
    integrator : Integrator
        One whose constraints are held by accelerations.
    ax : matplotlib axes, optional
        A new figure by default.
    points : int
        In each direction.

    Returns
    -------
    matplotlib axes
    """
    ax = axes(ax)
    end = 1.3 * stability_limit(integrator)
    alphas, betas = np.linspace(end / points, end, points), np.linspace(end / points, end, points)
    factor = stability_map(integrator, alphas.tolist(), betas.tolist())
    levels = [0.0, 0.25, 0.5, 0.75, 0.9, 1.0]
    shown = ax.contourf(alphas, betas, factor, levels=levels, cmap="cividis")
    ax.contour(alphas, betas, factor, levels=[1.0], colors="k", linewidths=1.0)
    ax.plot([0, end], [0, end], ":", color="0.4", lw=0.8)
    ax.set(title=f"{integrator.title}: factor per step", xlabel="alpha dt", ylabel="beta dt")
    ax.set(xlim=(0, end), ylim=(0, end))
    ax.figure.colorbar(shown, ax=ax)
    return ax


def draw_contest(found: Sequence[Contest], ax: Any = None) -> Any:
    """Draw gap against energy error of each way to keep a constraint: both are wanted small.

    The hollow mark is the energy error in the first tenth of the run, the full one in the last.

    Parameters
    ----------
    found : sequence of Contest
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    ax = axes(ax)
    for one, colour in zip(found, COLOURS, strict=False):
        gap, label = max(one.errors.violation, 1e-17), title(one)
        ax.plot([gap] * 2, [one.errors.early, one.errors.late], "-", color=colour, lw=1.0)
        ax.plot(gap, one.errors.early, "o", color=colour, mfc="none", ms=7)
        ax.plot(gap, one.errors.late, "o", color=colour, ms=7, label=label)
    ax.set(title="first (hollow) and last tenth", xscale="log", yscale="log")
    ax.set(xlabel="max abs(c) [m]", ylabel="max abs(E - E0) [J]")
    ax.grid(visible=True, color="0.9")
    ax.legend(fontsize=7, frameon=False)
    return ax


def title(one: Contest) -> str:
    """Return the name of a contender."""
    if one.integrator.keeps_constraints:
        return one.integrator.title
    return f"{one.integrator.title}, {one.drift.title}"


def save_laboratory(
    growths: Mapping[str, Growth],
    integrators: Sequence[Integrator],
    found: Sequence[Contest],
    path: str | Path,
) -> None:
    """Draw all of it into one picture; the ending of `path` says which format."""
    count = 2 + len(integrators)
    figure, places = panels(count, width=4.4, height=3.8, columns=count)
    draw_growth(growths, places[0])
    for integrator, ax in zip(integrators, places[1:-1], strict=True):
        draw_stability(integrator, ax)
    draw_contest(found, places[-1])
    write_figure(figure, path)
