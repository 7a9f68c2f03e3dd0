"""condyn solvers: the solvers of constrained dynamics."""

from __future__ import annotations

from rich.table import Table

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import console, print_json, words

PANEL = "Look"


def solvers(as_json: arg.AsJson = False) -> None:
    """List the solvers: what each takes, what it costs, when to use it, its parameters."""
    from condyn_pin.study.printing import SolverRow, solver_rows

    if as_json:
        print_json(solver_rows())
        return

    def facts(row: SolverRow) -> Table:
        lines = Table.grid(padding=(0, 2, 0, 0))
        lines.add_row("takes", row.kinds)
        lines.add_row("redundant", row.redundant)
        lines.add_row("cost", row.cost)
        lines.add_row("use", row.use)
        lines.add_row("parameters", row.parameters.replace("\n", ", "))
        return lines

    table = words("solver", "redundant: rows that depend on others, and singular states")
    table.show_lines = True
    for row in solver_rows():
        table.add_row(row.name, facts(row))
    console.print(table)
