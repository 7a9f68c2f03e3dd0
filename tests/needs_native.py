"""Tests of the compiled core are left out where it is missing; where CI=true they fail."""

from __future__ import annotations

import os

import pytest

from condyn_pin._core.compiled import compiled, compiled_tick
from condyn_pin.errors import MissingExtra

try:
    HEADERS = compiled().pinocchio
except MissingExtra:
    HEADERS = ""
needs_native = pytest.mark.skipif(
    not HEADERS and os.environ.get("CI") != "true",
    reason="the compiled core is not installed: make native",
)

try:
    compiled_tick()
    _TICKS = True
except MissingExtra:
    _TICKS = False
needs_ticks = pytest.mark.skipif(
    not _TICKS and os.environ.get("CI") != "true",
    reason="the compiled core is not installed: make native",
)
