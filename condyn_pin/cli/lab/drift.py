"""condyn lab drift: what integrators and drift schemes do to constraints and energy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from condyn_pin._core.printing import print_whole
from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import check_picture, console, leave, print_json, until_stopped

if TYPE_CHECKING:
    from condyn_pin.lab.drift import Contest, Growth

PANEL = "Simulate"

_RATIOS = (0.5, 1.0, 2.0**0.5, 2.0)  # beta / alpha
_MEANING = (
    "A constraint that is kept to the last digit says nothing about energy. What keeps areas "
    "in the phase plane, as RATTLE does, keeps energy near its value for ever; gains and "
    "projections move the state after the step, and the map that does both is no longer one."
)


def drift(
    steps: Annotated[int, typer.Option(min=10, help="Steps of each long run.")] = 10_000,
    dt: Annotated[float, typer.Option(help="Step of the long runs [s].")] = 1e-2,
    plot: arg.Plot = None,
    as_json: arg.AsJson = False,
) -> None:
    """Show drift, stability limits of gains, and energy, on a pendulum whose rod is a constraint.

    Ctrl-C keeps the finished runs.
    """
    from condyn_pin.errors import InvalidArgument
    from condyn_pin.lab.drift import contest, gap_growth
    from condyn_pin.simulation.integrators.explicit import (
        ExplicitEuler,
        RungeKutta4,
        SemiImplicitEuler,
    )

    if not 0 < dt < float("inf"):
        raise InvalidArgument(f"--dt {dt}: a number > 0 [s] is needed")
    check_picture(plot)
    explicit, semi, rk4 = ExplicitEuler(), SemiImplicitEuler(), RungeKutta4()
    growths = {
        "explicit Euler": gap_growth(explicit, dt=1e-3, steps=10_000),
        "Runge-Kutta 4": gap_growth(rk4, dt=1e-2, steps=2000),
    }
    found, stopped = until_stopped(
        lambda bar: contest(dt, steps, progress=lambda x: bar("pendulum", int(x * 1000), 1000))
    )
    if plot:
        from condyn_pin.lab.drift import save_laboratory

        save_laboratory(growths, (semi, rk4), found, plot)
    if as_json:
        print_json(_facts(growths, (explicit, semi, rk4), found) | {"steps": steps, "dt": dt})
    else:
        for table in _tables(growths, (explicit, semi, rk4), found, steps, dt):
            print_whole(table, console)
        console.print(_MEANING)
    leave(stopped=stopped)


def _facts(
    growths: Mapping[str, Growth], integrators: Sequence[Any], found: Sequence[Contest]
) -> dict[str, Any]:
    from condyn_pin.simulation.stability import stability_limit

    return {
        "growth": {
            name: {"gap": growth.violation[-1], "t": growth.t[-1], "power": growth.power}
            for name, growth in growths.items()
        },
        "stability_limits": {
            integrator.title: stability_limit(integrator) for integrator in integrators
        },
        "runs": {one.title: {"area": one.area, "errors": one.errors} for one in found},
    }


def _tables(
    growths: Mapping[str, Growth],
    integrators: Sequence[Any],
    found: Sequence[Contest],
    steps: int,
    dt: float,
) -> Iterator[Table]:
    from condyn_pin.simulation.stability import stability_limit

    table = Table("without stabilisation", "gap at the end [m]", "grows like")
    for name, growth in growths.items():
        gap = f"{growth.violation[-1]:.1e} at {growth.t[-1]:g} s"
        table.add_row(name, gap, f"t^{growth.power:.2f}")
    yield table

    table = Table("alpha dt of Baumgarte below", *(f"beta = {r:.3g} alpha" for r in _RATIOS))
    for integrator in integrators:
        limits = (stability_limit(integrator, beta_per_alpha=ratio) for ratio in _RATIOS)
        table.add_row(integrator.title, *(f"{limit:.3f}" for limit in limits))
    yield table

    columns = ("gap [m]", "|J v| [m/s]", "energy [J], first tenth", "last tenth", "area per step")
    table = Table(f"{steps} steps of {1e3 * dt:g} ms", *columns, "status")
    for one in found:
        e = one.errors
        numbers = (f"{x:.1e}" for x in (e.violation, e.constraint_velocity, e.early, e.late))
        table.add_row(one.title, *numbers, f"1 {one.area:+.0e}", e.status)
    yield table
