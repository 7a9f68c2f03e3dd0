"""What pictures are drawn on: axes of the caller or of a new figure, and figures for a file."""

from __future__ import annotations

import importlib.util
import math
from typing import Any, Final

from condyn_pin._core.arrays import shown
from condyn_pin.errors import InvalidArgument, MissingExtra

PICTURES: Final = (".png", ".svg", ".pdf")


def axes(ax: Any) -> Any:
    """Return the axes of the caller, or those of a new figure."""
    require_matplotlib()
    if ax is not None:
        from matplotlib.axes import Axes

        if not isinstance(ax, Axes):
            raise InvalidArgument(
                f"ax = {shown(ax)}: axes of matplotlib are needed, one of figure.subplots(); "
                "without any a new figure is made"
            )
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]  # long names of contacts are not cut off


def panels(
    count: int, *, width: float, height: float, columns: int, above: float = 0.0
) -> tuple[Any, list[Any]]:
    """Return a figure for a file, and the axes of its panels, those that are left over blank.

    Parameters
    ----------
    count : int
        Panels that are needed.
    width, height : float
        Of one panel [inch].
    columns : int
        Panels side by side, at most.
    above : float, optional
        Room for a legend above them all [inch].
    """
    require_matplotlib()
    from matplotlib.figure import Figure  # a figure of its own leaves the user's backend alone

    columns = min(columns, count)
    lines = math.ceil(count / columns)
    figure = Figure(figsize=(width * columns, above + height * lines), layout="constrained")
    places = list(figure.subplots(lines, columns, squeeze=False).flat)
    for ax in places[count:]:
        ax.set_axis_off()
    return figure, places


def require_matplotlib() -> None:
    """Raise MissingExtra if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise MissingExtra('pictures need matplotlib: python -m pip install "condyn_pin[plot]"')
