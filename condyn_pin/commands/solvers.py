"""condyn solvers: what there is to choose from."""

from __future__ import annotations

from rich.table import Column, Table

from condyn_pin.commands.output import console

PANEL = "Look"


def solvers() -> None:
    """List the solvers: what each takes, what it costs, when to use it, its knobs."""
    from condyn_pin.solver_table import solver_rows

    table = Table(
        "solver", "takes", "cost", "when to use it", Column("knobs", width=24), show_lines=True
    )
    for row in solver_rows():
        takes = f"{row.kinds}\nredundant rows, singular states: {row.redundant}"
        table.add_row(row.name, takes, row.cost, row.use, row.knobs)
    console.print(table)
