"""condyn drift: what integrators and drift schemes do to constraints and energy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from condyn_pin.commands.arguments import AsJson
from condyn_pin.commands.output import check_files, console, print_json

PANEL = "Simulate"


def drift(
    steps: Annotated[int, typer.Option(min=10, help="Of the long runs.")] = 10_000,
    dt: Annotated[float, typer.Option(help="Of the long runs [s].")] = 1e-2,
    plot: Annotated[Path | None, typer.Option(help="Draw it (png, svg, pdf).")] = None,
    as_json: AsJson = False,
) -> None:
    """Show drift, walls of gains, and energy on a pendulum whose rod is a constraint."""
    from condyn_pin.plots_drift import save_laboratory, title
    from condyn_pin.simulation.integrators.explicit_euler import ExplicitEuler
    from condyn_pin.simulation.integrators.runge_kutta4 import RungeKutta4
    from condyn_pin.simulation.integrators.semi_implicit_euler import SemiImplicitEuler
    from condyn_pin.simulation.laboratory import contest, gap_growth
    from condyn_pin.simulation.walls import wall

    check_files(None, None, plot, None)
    integrators = (ExplicitEuler(), SemiImplicitEuler(), RungeKutta4())
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("a pendulum on a rod", total=1.0)
        growths = {
            "explicit Euler": gap_growth(ExplicitEuler(), dt=1e-3, steps=10_000),
            "Runge-Kutta 4": gap_growth(RungeKutta4(), dt=1e-2, steps=2000),
        }
        found = contest(dt, steps, progress=lambda done: progress.update(task, completed=done))

    if plot:
        save_laboratory(growths, integrators[1:], found, plot)
    if as_json:
        grown = {
            name: {"gap": growth.gap[-1], "t": growth.t[-1], "power": growth.power}
            for name, growth in growths.items()
        }
        limits = {integrator.title: wall(integrator) for integrator in integrators}
        runs = {title(one): {"area": one.area, "errors": one.errors} for one in found}
        print_json({"growth": grown, "walls": limits, "steps": steps, "dt": dt, "runs": runs})
        return
    table = Table("without stabilisation", "gap at the end [m]", "grows like")
    for name, growth in growths.items():
        table.add_row(name, f"{growth.gap[-1]:.1e} at {growth.t[-1]:g} s", f"t^{growth.power:.2f}")
    console.print(table)

    ratios = (0.5, 1.0, 2.0**0.5, 2.0)
    table = Table("alpha dt of Baumgarte below", *(f"beta = {r:.3g} alpha" for r in ratios))
    for integrator in integrators:
        walls = (wall(integrator, beta_per_alpha=ratio) for ratio in ratios)
        table.add_row(integrator.title, *(f"{limit:.3f}" for limit in walls))
    console.print(table)

    heading = f"{steps} steps of {1e3 * dt:g} ms"
    columns = ("gap [m]", "slip [m/s]", "energy [J], first tenth", "last tenth", "area a step")
    table = Table(heading, *columns, "status")
    for one in found:
        e = one.errors
        numbers = (f"{x:.1e}" for x in (e.gap, e.slip, e.early, e.late))
        table.add_row(title(one), *numbers, f"1 {one.area:+.0e}", e.status)
    console.print(table)
    console.print(
        "A constraint that is kept to the last digit says nothing about energy. What keeps areas "
        "in the phase plane, as RATTLE does, keeps energy near its value for ever; gains and "
        "projections move the state after the step, and the map that does both is no longer one."
    )
