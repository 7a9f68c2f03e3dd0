"""Style of plots: lines that colour-blind eyes tell apart, and those who read on paper.

Colours are those of Okabe and Ito, without their yellow, which paper loses; dashes tell lines apart
where there is no colour.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from condyn_pin._core.files.beside import written_beside

COLOURS: Final = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#7F7F7F",
)  # fmt: skip
# Methods of studies: no two are alike to colour-blind eyes either (`tests/test_plots.py`).
METHOD_COLOURS: Final = (
    "#0072B2", "#D55E00", "#009E73", "#40004B", "#B2DF8A", "#E69F00", "#9E0142", "#662506",
    "#B0B0B0", "#56B4E9", "#3B3B98", "#8000E0", "#000000",
)  # fmt: skip
DASHES: Final = ("-", "--", "-.", ":")

# Colour and marker of the main methods by their titles, and of any other.
METHODS: Final = {
    "ABA": ("#000000", "|"),
    "LCABA": ("#D55E00", "o"),
    "Proximal": ("#0072B2", "s"),
    "Dense KKT": ("#009E73", "^"),
    "numpy": ("#E69F00", "v"),
    "LAPACK": ("#56B4E9", "<"),
    "Contact Cholesky": ("#7F7F7F", "D"),
}
OTHER: Final = ("#CC79A7", "d")


def line(i: int) -> dict[str, Any]:
    """Return colour and dashes of line i: no two of the first 32 are alike."""
    dashes = DASHES[(i + i // len(COLOURS)) % len(DASHES)]
    return {"color": COLOURS[i % len(COLOURS)], "ls": dashes, "lw": 1.3}


def finished(ax: Any, *, title: str, x: str, y: str) -> Any:
    """Return axes with their words, a pale grid, and a legend if anything has a label.

    Of axes above one another that share x, the first has the title, the last the words of x, and
    a legend stands only once.
    """
    place = ax.get_subplotspec()
    beside = [each for each in ax.get_shared_x_axes().get_siblings(ax) if each is not ax]
    if place is not None and beside:
        title, x = title if place.is_first_row() else "", x if place.is_last_row() else ""
    ax.set(title=title, xlabel=x, ylabel=y)
    ax.grid(visible=True, which="major", color="0.92")
    ax.set_axisbelow(True)
    labels = ax.get_legend_handles_labels()[1]
    told = [each.get_legend_handles_labels()[1] for each in beside if each.get_legend()]
    if labels and labels not in told:
        ax.legend(fontsize=7, frameon=False)
    return ax


def write_figure(figure: Any, path: str | Path, *, dpi: int = 150) -> None:
    """Write a figure of matplotlib; the ending of `path` says which format, PNG if it has none."""
    path = Path(path)
    with written_beside(path if path.suffix else path.with_name(f"{path.name}.png")) as new:
        figure.savefig(new, dpi=dpi)
