"""The command line: its commands are in `condyn_pin.cli.commands`."""

from __future__ import annotations

import os
import sys
import traceback
from typing import Annotated, NoReturn

from condyn_pin._core.threads import decided

# Before numpy is imported, for the processes of workers too: times are compared on one core.
if not decided():
    os.environ["OMP_NUM_THREADS"] = "1"

import typer

from condyn_pin import __version__
from condyn_pin.cli.commands import PANELS
from condyn_pin.cli.output import INTERRUPTED, warn
from condyn_pin.errors import CondynError

# Exit codes; 0 and 1 are given by the commands themselves.
_CANNOT = 2
_UNEXPECTED = 3

_EPILOG = """
**First steps**

    condyn doctor                      what is installed, how to repair it
    condyn show cassie                 rows, rank, redundant rows, what is not used
    condyn view cassie                 see it in the browser, until Ctrl-C
    condyn assemble cassie             close the loops from a posture
    condyn solve cassie --json         accelerations, forces, and their errors
    condyn solve cassie --variant springs=locked --solver nullspace

**Robots** are names of `condyn robots`, or paths: a URDF, an SDF, an MJCF, or a folder with a
robot.toml.

**Exit codes**

    0     the answer
    1     the answer is not ok: singular, inaccurate, loops left open
    2     the command cannot be run as given; a line on stderr says what would work
    3     a bug in condyn_pin; add --debug to see where
    130   interrupted; what was measured is kept

**Output**: with `--json` there is json on stdout and nothing else; options that take a path write a
file. **Completion**: `condyn --install-completion` completes commands and the names they take.
"""


app = typer.Typer(
    epilog=_EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _panel, _commands in PANELS.items():
    for _command in _commands:
        app.command(rich_help_panel=_panel)(_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"condyn_pin {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Anywhere on the line: show the traceback of an error.")
    ] = False,
) -> None:
    """Constrained rigid-body dynamics on Pinocchio: solve it, prove it, time it.

    M(q) a + h(q, v) = tau + J(q)^T lam,   J(q) a + gamma(q, v) = a_ref

    For closed chains and for legged machines. `condyn COMMAND --help` has the options of each.
    """


def main() -> None:
    """Run the command line."""
    run(app, _of_today([word for word in sys.argv[1:] if word != "--debug"]), "condyn")


def run(app: typer.Typer, words: list[str], program: str) -> NoReturn:
    """Run a line of commands; errors are one line, with a traceback only under --debug."""
    words = [word for word in words if word != "--debug"] or ["--help"]
    name = program.rpartition("/")[2]
    try:
        code = app(words, prog_name=program, standalone_mode=False)
        sys.stdout.flush()  # a full disk, while it can still be told
    except KeyboardInterrupt:
        code = INTERRUPTED
    except Exception as error:
        if say := getattr(error, "format_message", None):  # a line that Typer cannot read
            known = getattr(typer.main.get_command(app), "commands", {})
            named = [word for word in words[:1] if word in known]
            command = " ".join([program, *named, "--help"])
            _exit_with_error(f"{say().rstrip('.')}; `{command}` says what there is", _CANNOT, name)
        if "--debug" in sys.argv:
            warn(traceback.format_exc())
            sys.exit(1)
        if isinstance(error, (CondynError, OSError)):  # the second: a disk that is full
            _exit_with_error(str(error), _CANNOT, name)
        _exit_with_error(
            f"{type(error).__name__}: {error}; this is a bug: the same line with "
            "--debug shows where",
            _UNEXPECTED,
            name,
        )
    if code == INTERRUPTED:
        _exit_with_error("interrupted", INTERRUPTED, name)
    sys.exit(code or 0)


def _of_today(words: list[str]) -> list[str]:
    """Command line of the last version in today's words, with a warning; gone with the next."""
    match words:
        case ["lab", *rest]:
            _end_in_checkout(rest)
        case ["drift" | "problem" | "stress", *_]:
            _end_in_checkout(words)
        case ["show", *rest] if "--ladder" in rest:
            _end_in_checkout(["ladder", *(word for word in rest if word != "--ladder")])
        case ["tune", *rest]:
            now = ["trade", "--tune", *("--json=-" if word == "--json" else word for word in rest)]
        case _:
            return words
    warn(f"condyn: this is `condyn {' '.join(now)}` now")
    return now


def _end_in_checkout(words: list[str]) -> NoReturn:
    """Exit 2 with the line that runs a command of the laboratory from a checkout."""
    line = " ".join(["python benchmarks/lab", *words])
    _exit_with_error(f"this measures the library and lives in a checkout: `{line}`", _CANNOT)


def _exit_with_error(text: str, code: int, name: str = "condyn") -> NoReturn:
    """Leave with one line on stderr."""
    warn(f"{name}: {' '.join(text.split())}")
    try:
        sys.stdout.flush()
    except OSError:  # Python would try again at its end, and leave with a code of its own
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)
