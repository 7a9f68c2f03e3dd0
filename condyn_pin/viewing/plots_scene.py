"""Diagrams of a scene: singular values along a path, and the sparsity of derivatives."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.show import COLOURS, axes, finished, line
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

_LEAST: Final = 1e-17  # where zero is drawn on a scale of logarithms


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
    return finished(ax, title=title, x=along_text, y="singular values [1/sqrt(kg)]")


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
    ax.spy(marks, markersize=max(1.0, 120.0 / marks.shape[1]), color=COLOURS[0])
    for edge in (n, 2 * n):
        ax.axvline(edge - 0.5, color="0.4", lw=0.8)
    if m:
        ax.axhline(n - 0.5, color="0.4", lw=0.8)
    ax.set_xticks([0.5 * n, 1.5 * n, 2.5 * n], ["q", "v", "tau"])
    ax.set_yticks([0.5 * n, n + 0.5 * m] if m else [0.5 * n], ["a", "lam"] if m else ["a"])
    full = 100.0 * marks.mean()
    ax.set(title=f"{full:.0f} % of {marks.size} derivatives are not zero")
    return ax
