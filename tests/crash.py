"""Run a snippet of Python in an interpreter of its own, which may die."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from textwrap import dedent
from typing import Literal


@dataclass(frozen=True)
class Outcome:
    """How a snippet ended.

    Attributes
    ----------
    kind : {"ok", "exception", "signal"}
    text : str
        What it printed; the last line of the traceback; or the name of the signal.
    """

    kind: Literal["ok", "exception", "signal"]
    text: str


def run(snippet: str, *, timeout: float = 600.0) -> Outcome:
    """Return how `snippet` ends in a fresh interpreter that sees the same packages."""
    done = subprocess.run(
        [sys.executable, "-c", dedent(snippet)],
        capture_output=True,
        text=True,
        timeout=timeout,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    if done.returncode < 0:
        return Outcome("signal", signal.Signals(-done.returncode).name)
    if done.returncode > 0:
        return Outcome("exception", done.stderr.strip().rpartition("\n")[2])
    return Outcome("ok", done.stdout.strip())
