"""Values as a notebook shows them: tables in HTML.

Every text is escaped, for names come from files. Nothing is loaded, and no script runs. Text has
the colour of the page, light or dark, and lines are half clear; a status is in words, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import compress
from typing import Final

import numpy as np

from condyn_pin._core.arrays import Array

_GOOD: Final = "#009e73"  # green and vermillion of Okabe and Ito: told apart by all eyes
_BAD: Final = "#d55e00"
_LINE: Final = "1px solid rgba(128,128,128,0.35)"
_FLAT: Final = 1e-9  # a change that is rounding beside the numbers is no curve
_CELL: Final = f"text-align:left;padding:2px 14px 2px 0;border:none;border-bottom:{_LINE}"
_NUMBER: Final = (
    _CELL.replace("left", "right", 1) + ";white-space:nowrap;font-variant-numeric:tabular-nums"
)
_TABLE: Final = "border-collapse:collapse;margin:4px 0 8px 0;background:transparent;color:inherit"
_FOLD: Final = 12  # rows of a table that are seen at once


def page(title: str, *parts: str, ok: bool | None = None) -> str:
    """Return a title, with a dot that says whether it is as it should be, and what is below it."""
    dot = "" if ok is None else f'<span style="color:{_GOOD if ok else _BAD}">&#9679;</span> '
    head = f'<div style="font-weight:600;margin-bottom:2px">{dot}{escape(title)}</div>'
    return f'<div style="max-width:60em;line-height:1.4">{head}{"".join(parts)}</div>'


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Return labels and texts, a line each."""
    rows = "".join(
        f'<tr style="background:transparent"><th style="{_CELL};font-weight:normal;opacity:0.7;'
        f'vertical-align:top;white-space:nowrap">{escape(label)}</th>'
        f'<td style="{_CELL}">{escape(text)}</td></tr>'
        for label, text in pairs
    )
    return f'<table style="{_TABLE}">{rows}</table>' if rows else ""


def grid(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table without its empty columns; those of numbers are right-aligned."""
    if not rows:
        return ""
    used = [any(column) for column in zip(*rows, strict=True)]
    headings = list(compress(headings, used))
    rows = [list(compress(row, used)) for row in rows]
    styles = [
        _NUMBER if all(map(_is_number, column)) else _CELL for column in zip(*rows, strict=True)
    ]
    heads = "".join(
        f'<th style="{style};font-weight:600">{escape(heading)}</th>'
        for heading, style in zip(headings, styles, strict=True)
    )
    lines = [
        '<tr style="background:transparent">'
        + "".join(
            f'<td style="{style}">{escape(cell)}</td>'
            for cell, style in zip(row, styles, strict=True)
        )
        + "</tr>"
        for row in rows
    ]
    head = f'<tr style="background:transparent">{heads}</tr>'
    return f'<table style="{_TABLE}"><thead>{head}</thead><tbody>{"".join(lines)}</tbody></table>'


def folded(title: str, content: str, *, count: int = _FOLD + 1) -> str:
    """Return content below a line that opens it; at once what has few rows."""
    if not content:
        return ""
    opened = " open" if count <= _FOLD else ""
    return (
        f'<details{opened}><summary style="cursor:pointer">{escape(title)}</summary>'
        f"{content}</details>"
    )


def notes(texts: Iterable[str]) -> str:
    """Return what deserves attention, a line each."""
    return "".join(
        f'<div style="border-left:3px solid {_BAD};padding-left:8px;margin:3px 0">'
        f"{escape(text)}</div>"
        for text in texts
    )


def curve(title: str, x: Array, y: Array, unit: str) -> str:
    """Return a small curve, its extremes and its end in words."""
    known = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(known) < 2:
        return ""
    x, y = x[known], y[known]
    low, high = float(y.min()), float(y.max())
    if high - low <= _FLAT * max(abs(low), abs(high)):
        return f"<div>{escape(f'{title}: {low:.3g} {unit}')}</div>"
    chosen = np.unique(np.linspace(0, len(x) - 1, min(len(x), 200)).astype(int))
    width, height = 240.0, 40.0
    across = (x - x[0]) / max(float(x[-1] - x[0]), 1e-300) * width
    up = height - (y - low) / (high - low) * height
    points = " ".join(f"{across[i]:.1f},{up[i]:.1f}" for i in chosen)
    said = f"{title}: {low:.3g} to {high:.3g} {unit}, at the end {y[-1]:.3g}"
    return (
        f'<div style="display:inline-block;margin:4px 18px 4px 0"><div>{escape(said)}</div>'
        f'<svg width="{width:g}" height="{height + 4:g}" viewBox="0 -2 {width:g} {height + 4:g}" '
        f'role="img" aria-label="{escape(said)}"><polyline points="{points}" fill="none" '
        'stroke="currentColor" stroke-width="1.2"/></svg></div>'
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return not text
    return True
