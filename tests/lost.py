"""What loses a worker: in the middle of its work, and not after a time that somebody waited."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import condyn_pin as cp


def kill_once(mark: str | Path) -> None:
    """Kill this process, and leave its number in a file; do nothing if the file is there."""
    try:
        file = os.open(mark, os.O_CREAT | os.O_EXCL | os.O_WRONLY)
    except FileExistsError:
        return
    os.write(file, str(os.getpid()).encode())
    os.close(file)
    os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True)
class KillsOnce(cp.Proximal):
    """Kills the first process that comes to a state with it, or that makes a workspace of it."""

    title: ClassVar[str] = "Kills once"

    mark: str = ""
    at: float | None = None  # the first entry of the state's q

    def start(self, workspace):
        method = super().start(workspace)
        if self.at is None:
            kill_once(self.mark)

        def acceleration(q, v, tau):
            if q[0] == self.at:
                kill_once(self.mark)
            return method.acceleration(q, v, tau)

        return cp.dynamics.BoundSolver(acceleration, method.lam, method.iterations)


del cp.dynamics.SOLVERS[KillsOnce.__name__.lower()]  # nothing else gets to see it
