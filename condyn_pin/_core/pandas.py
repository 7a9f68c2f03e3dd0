"""pandas, where it is installed."""

from __future__ import annotations

from typing import Any

from condyn_pin.errors import MissingExtra


def require_pandas() -> Any:
    """Return the module, or raise MissingExtra."""
    try:
        import pandas
    except ImportError as error:
        raise MissingExtra(
            "a data frame needs pandas: python -m pip install 'condyn_pin[pandas]'"
        ) from error
    return pandas
