"""condyn solvers: the solvers of constrained dynamics."""

from __future__ import annotations

from dataclasses import dataclass

from rich.table import Table

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import console, print_json, text_table

PANEL = "Look"


def solvers(as_json: arg.AsJson = False) -> None:
    """List the solvers: what each takes, what it costs, when to use it, its parameters."""
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

    table = text_table("solver", "redundant: rows that depend on others, and singular states")
    table.show_lines = True
    for row in solver_rows():
        table.add_row(row.name, facts(row))
    console.print(table)


@dataclass(frozen=True)
class SolverRow:
    """One solver in words, as it declares itself."""

    name: str  # as `cp.NAME()` and, in any case of letters, for ``--solver``
    kinds: str  # of constraints that it takes
    redundant: str  # what it makes of redundant rows, and of states where rows become so
    cost: str
    use: str
    parameters: str  # its fields with their defaults, one a line; None is found on the scene


def solver_rows() -> tuple[SolverRow, ...]:
    """Return a row for every solver."""
    from condyn_pin.dynamics.solvers import SOLVERS
    from condyn_pin.dynamics.solvers.solver import parameter_fields
    from condyn_pin.dynamics.workspace import constraint_kinds_of

    rows = []
    for kind in SOLVERS.values():
        singular = "mu > 0, else singular" if hasattr(kind, "mu") else "singular"
        default = kind()
        values = ((f.name, getattr(default, f.name)) for f in parameter_fields(kind))
        rows.append(
            SolverRow(
                kind.__name__,
                constraint_kinds_of(kind),
                "yes" if kind.takes_redundant else singular,
                kind.cost,
                kind.use,
                "\n".join(f"{name}={value!r}" for name, value in values),
            )
        )
    return tuple(rows)
