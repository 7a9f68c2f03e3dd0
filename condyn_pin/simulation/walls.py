"""The names of `stability` in the last version; they go with the next."""

from __future__ import annotations

from typing import Any
from warnings import warn

from condyn_pin.simulation import stability

_NOW = {
    "wall": "stability_limit",
    "check_wall": "check_stability_limit",
    "growth": "growth",
    "is_beyond": "is_beyond",
}


def __getattr__(name: str) -> Any:
    if name not in _NOW:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    text = f"{__name__}.{name} is {stability.__name__}.{_NOW[name]} now"
    warn(text, DeprecationWarning, stacklevel=2)
    return getattr(stability, _NOW[name])
