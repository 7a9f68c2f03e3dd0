"""Solvers that lie, raise, die and hang, for a process that imports them."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin.dynamics import BoundSolver, Reference, Solver


class Broken(Solver):  # abstract for the registry: it has no way to spoil
    """The answer of `Reference`, spoilt."""

    title: ClassVar[str] = "Broken"
    cost: ClassVar[str] = "too high"
    use: ClassVar[str] = "never"
    takes_redundant: ClassVar[bool] = True

    def start(self, workspace):
        right = Reference().start(workspace)

        def acceleration(q, v, tau):
            return self.spoil(workspace, right.acceleration(q, v, tau))

        return BoundSolver(acceleration, right.lam, right.iterations)


@dataclass(frozen=True)
class Lying(Broken):
    """It is wrong, and bribes its judge."""

    def spoil(self, workspace, a):
        workspace._verifier._estimator = _Bribed()
        return a * 1.001


class _Bribed:
    gravity, negligible_dynamics_error, leaning = 0.0, np.inf, ()

    def prove(self, dynamics, largest, tau, lean=0.0):
        from condyn_pin.dynamics import Residuals

        return Residuals(0.0, 0.0, 0.0, 0.0, 0.0), False


@dataclass(frozen=True)
class Raising(Broken):
    """It raises what no caller expects."""

    def spoil(self, workspace, a):
        raise RuntimeError("lost")


@dataclass(frozen=True)
class Dying(Broken):
    """It takes the interpreter with it, as Pinocchio can."""

    def spoil(self, workspace, a):
        os.kill(os.getpid(), signal.SIGSEGV)
        return a


@dataclass(frozen=True)
class Hanging(Broken):
    """It never comes back."""

    def spoil(self, workspace, a):
        time.sleep(1000.0)
        return np.zeros_like(a)
