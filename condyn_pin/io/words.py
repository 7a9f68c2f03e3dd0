"""How readers list names in their sentences."""

from __future__ import annotations

from collections.abc import Sequence


def few(names: Sequence[str]) -> str:
    """Return up to four names, or how many joints there are."""
    return ", ".join(names) if len(names) <= 4 else f"{len(names)} joints"
