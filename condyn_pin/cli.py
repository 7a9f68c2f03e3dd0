"""The command line: `condyn_pin.commands` has its commands."""

from __future__ import annotations

import os
import sys
from typing import Annotated

# Before numpy is imported: two threads of a BLAS on a 50 x 50 matrix only make it slower, and
# times are compared on one core.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import typer

from condyn_pin import __version__
from condyn_pin.commands import commands
from condyn_pin.errors import CondynError

app = typer.Typer(
    help="Constrained rigid-body dynamics on Pinocchio: solve it, prove it, time it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for _name, _module in commands().items():
    app.command(rich_help_panel=_module.PANEL)(getattr(_module, _name))


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"condyn_pin {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    """Constrained rigid-body dynamics on Pinocchio: solve it, prove it, time it."""


def main() -> None:
    """Run the command line; an error of this library is a sentence, not a traceback."""
    try:
        app()
    except CondynError as error:
        typer.echo(f"condyn: {error}", err=True)
        sys.exit(2)
