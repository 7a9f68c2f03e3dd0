"""Pictures of the drift laboratory: growth of gaps, stability of gains, energy over long times.

Each draws on `ax` or new axes, which it returns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin._core.show import COLOURS, axes, finished
from condyn_pin.lab.laboratory import Contest, Growth, stability_map
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.stability import stability_limit
from condyn_pin.study.plots import save_panels

# the lines tell the colours apart in print
_LINES = ("-", "--", "-.", ":", "-", "--")


def draw_growth(found: Mapping[str, Growth], ax: Any = None) -> Any:
    """Draw the gap against time of runs that nothing closes; the slope is the power of t.

    `found` is by the title of the integrator.
    """
    ax = axes(ax)
    for (title, growth), colour, line in zip(found.items(), COLOURS, _LINES, strict=False):
        seen = growth.violation > 0
        t, gap = growth.t[seen], growth.violation[seen]
        ax.plot(t, gap, line, color=colour)
        ax.annotate(
            f"{title}: t^{growth.power:.2f}", (t[-1], gap[-1]), xytext=(0, 6), color=colour,
            textcoords="offset points", ha="right", fontsize=8,
        )  # fmt: skip
    ax.set(xscale="log", yscale="log")
    ax.margins(y=0.15)
    return finished(ax, title="gap without stabilisation", x="t [s]", y="max abs(c) so far [m]")


def draw_stability(integrator: Integrator, ax: Any = None, *, points: int = 60) -> Any:
    """Draw the factor by which a gap grows in a step over Baumgarte's gains.

    With so many points in each direction, for an integrator whose constraints are held by
    accelerations.
    """
    ax = axes(ax)
    end = 1.3 * stability_limit(integrator)
    products = np.linspace(end / points, end, points)
    factor = stability_map(integrator, products.tolist(), products.tolist())
    levels = [0.0, 0.25, 0.5, 0.75, 0.9, 1.0]
    shown = ax.contourf(products, products, factor, levels=levels, cmap="cividis")
    ax.contour(products, products, factor, levels=[1.0], colors="k", linewidths=1.0)
    ax.plot([0, end], [0, end], ":", color="0.4", lw=0.8)
    ax.set(title=f"{integrator.title}: factor per step", xlabel="alpha dt", ylabel="beta dt")
    ax.set(xlim=(0, end), ylim=(0, end))
    ax.figure.colorbar(shown, ax=ax)
    return ax


def draw_contest(found: Sequence[Contest], ax: Any = None) -> Any:
    """Draw gap against energy error of each way to keep a constraint: both are wanted small.

    The hollow mark is the energy error in the first tenth of the run, the full one in the last.
    """
    ax = axes(ax)
    for one, colour in zip(found, COLOURS, strict=False):
        gap = max(one.errors.violation, 1e-17)
        ax.plot([gap] * 2, [one.errors.early, one.errors.late], "-", color=colour, lw=1.0)
        ax.plot(gap, one.errors.early, "o", color=colour, mfc="none", ms=7)
        ax.plot(gap, one.errors.late, "o", color=colour, ms=7, label=one.title)
    ax.set(xscale="log", yscale="log")
    title = "first (hollow) and last tenth of a run"
    return finished(ax, title=title, x="max abs(c) [m]", y="max abs(E - E0) [J]")


def save_laboratory(
    growths: Mapping[str, Growth],
    integrators: Sequence[Integrator],
    found: Sequence[Contest],
    path: str | Path,
) -> None:
    """Draw all of it into one picture; the ending of `path` says which format."""
    draw = [
        partial(draw_growth, growths),
        *(partial(draw_stability, integrator) for integrator in integrators),
        partial(draw_contest, found),
    ]
    save_panels(draw, path, size=(4.4, 3.4), columns=2, one_legend=True)
