"""Contest: ways of keeping the rod's length, side by side, in the laboratory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.drift import Drift
from condyn_pin.errors import Interrupted
from condyn_pin.lab.laboratory import DriftErrors, area, errors
from condyn_pin.simulation.drift.no_drift import NoDrift
from condyn_pin.simulation.drift.projection import Projection
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.integrators.explicit import RungeKutta4, SemiImplicitEuler
from condyn_pin.simulation.integrators.rattle import Rattle


@dataclass(frozen=True)
class Contest:
    """One way of keeping the rod's length, over many steps.

    Attributes
    ----------
    integrator, drift
    dt : float
        [s]
    errors : DriftErrors
    area : float
        By how much a step changes areas in the phase plane, as a share of them.
    """

    integrator: Integrator
    drift: Drift
    dt: float  # [s]
    errors: DriftErrors
    area: float


def contenders(dt: float) -> tuple[tuple[Integrator, Drift], ...]:
    """Return ways of keeping the rod's length: gains, projections, RATTLE."""
    semi, rk4 = SemiImplicitEuler(), RungeKutta4()
    return (
        (semi, Baumgarte.critical(0.3 / dt)),
        (semi, Projection()),
        (rk4, NoDrift()),
        (rk4, Baumgarte.critical(0.03 / dt)),
        (rk4, Projection()),
        (Rattle(), NoDrift()),
    )


def contest(
    dt: float, steps: int, *, progress: Callable[[float], object] | None = None
) -> tuple[Contest, ...]:
    """Return how all `contenders` do.

    Parameters
    ----------
    dt : float
        [s]
    steps : int
    progress : callable, optional
        Called with the share that is done.

    Raises
    ------
    Interrupted
        With those that went to their end before Ctrl-C.
    """
    ways = contenders(dt)
    results: list[Contest] = []
    try:
        for i, (integrator, drift) in enumerate(ways):
            tick = None if progress is None else partial(_part, progress, i, len(ways))
            found = errors(integrator, drift, dt=dt, steps=steps, progress=tick)
            results.append(Contest(integrator, drift, dt, found, area(integrator, drift, dt=dt)))
    except KeyboardInterrupt as stop:
        raise Interrupted(tuple(results)) from stop
    return tuple(results)


def _part(progress: Callable[[float], object], i: int, count: int, share: float) -> None:
    progress((i + share) / count)
