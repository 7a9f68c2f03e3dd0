"""MJCF that MuJoCo itself compiles, read from the arrays of its model."""

from __future__ import annotations

from os import PathLike

from condyn_pin.errors import MissingExtra
from condyn_pin.io.mjcf_types import Description


def read_compiled(path: str | PathLike[str], reason: str) -> Description:
    """Return what a file says once MuJoCo has compiled it."""
    raise MissingExtra(
        f"{reason}, and only MuJoCo reads that: python -m pip install 'condyn_pin[mjcf]'"
    )
