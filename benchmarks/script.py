"""What scripts with one table share: measure or take the committed results, print, write, fill."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import marks

from condyn_pin._core.timing import machine

Saved = dict[str, Any]


def run(
    words: Sequence[str] | None,
    *,
    about: str | None,
    quick: str,
    path: Path,
    measure: Callable[[argparse.Namespace], Mapping[str, Any]],
    table: Callable[[Saved], str],
    pages: Callable[[Saved], dict[str, dict[str, str]]],
    rounds: int = 0,
) -> None:
    """Run, print, write `path` and update the docs.

    `quick` says what ``--quick`` does; with `rounds` there is an option of that name.
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    if rounds:
        parser.add_argument("--rounds", type=int, default=rounds)
    given = parser.parse_args(words)
    if given.from_json:
        saved = json.loads(path.read_text(encoding="utf-8"))
    else:
        load = os.getloadavg()[0]
        saved = {"machine": machine(), "load": load, **measure(given)}
    print(table(saved))
    if given.quick:
        return
    path.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    marks.write(pages(saved))
