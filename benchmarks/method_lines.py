"""How methods are told apart in a picture: integrators by their lines, drift schemes by markers.

A picture with twenty methods has one legend below all panels: a line for every integrator, and a
marker for every drift scheme.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from condyn_pin._core.show import line
from condyn_pin.simulation.drift import DRIFTS

_MARKERS = "osd^vP*"  # of the drift schemes, in the order of their registry


def split(method: str) -> tuple[str, str]:
    """Return integrator and drift scheme of 'integrator, scheme'; one that needs none has 'none'.

    Both are named by their titles, or both by their classes.
    """
    integrator, _, scheme = method.rpartition(", ")
    if any(scheme in (kind.title, kind.__name__) for kind in DRIFTS.values()):
        return integrator, scheme
    return method, "none"


class Lines:
    """The lines of some methods, and the legend that explains them."""

    def __init__(self, methods: Iterable[str]) -> None:
        pairs = [split(method) for method in methods]
        self._lines = {name: line(i) for i, name in enumerate(dict.fromkeys(p[0] for p in pairs))}
        used = dict.fromkeys(p[1] for p in pairs)
        self._markers = dict(zip(used, _MARKERS, strict=False))

    def of(self, method: str) -> dict[str, Any]:
        """Return how a method is drawn."""
        integrator, scheme = split(method)
        return self._lines[integrator] | {"marker": self._markers[scheme], "ms": 4, "lw": 1.0}

    def legend(self) -> list[Any]:
        """Return what the legend shows: lines without a marker, and markers without a line."""
        from matplotlib.lines import Line2D

        lines = [Line2D([], [], label=name, **style) for name, style in self._lines.items()]
        markers = [
            Line2D([], [], color="k", ls="", marker=marker, ms=5, label=f"drift: {scheme}")
            for scheme, marker in self._markers.items()
        ]
        return lines + markers
