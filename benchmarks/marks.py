"""Blocks of pages that scripts write, so that a figure is copied by no hand.

A block stands between ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->``. docs/results.md has whole
tables, the README the few rows that say how fast and how true; all are made from committed results.

To add a measured table: the `pages` of a script gives each page its blocks, and `write` puts them
between their marks. ``--from-json`` writes them again from committed results; a test compares.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = "README.md"
RESULTS = "docs/results.md"
SOLVERS = "docs/how-to-choose-a-solver.md"
SIMULATORS = "docs/simulators.md"


def filled(page: str, blocks: Mapping[str, str]) -> str:
    """Return a page with its blocks replaced."""
    for name, text in blocks.items():
        begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
        head, rest = page.split(begin)
        page = f"{head}{begin}\n{text}\n{end}{rest.split(end)[1]}"
    return page


def write(pages: Mapping[str, Mapping[str, str]]) -> None:
    """Replace the blocks of some pages, given by their paths."""
    for path, blocks in pages.items():
        page = (ROOT / path).read_text(encoding="utf-8")
        (ROOT / path).write_text(filled(page, blocks), encoding="utf-8")
