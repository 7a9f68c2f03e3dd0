"""The command line as a user has it, in this process."""

from __future__ import annotations

from typer.testing import CliRunner

from condyn_pin.cli.main import app


def condyn(*words: str):
    """Run `condyn` with these words."""
    return CliRunner().invoke(app, list(words))
