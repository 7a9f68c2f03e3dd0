"""condyn solvers: what there is to choose from."""

from __future__ import annotations

from rich.table import Column

from condyn_pin.commands.arguments import AsJson
from condyn_pin.commands.output import console, print_json, words

PANEL = "Look"


def solvers(as_json: AsJson = False) -> None:
    """List the solvers: what each takes, what it costs, when to use it, its knobs."""
    from condyn_pin.solver_table import solver_rows

    if as_json:
        print_json(solver_rows())
        return
    table = words("solver", "takes", "cost", "when to use it", Column("knobs", width=24))
    table.show_lines = True
    for row in solver_rows():
        takes = f"{row.kinds}\nredundant rows, singular states: {row.redundant}"
        table.add_row(row.name, takes, row.cost, row.use, row.knobs)
    console.print(table)
