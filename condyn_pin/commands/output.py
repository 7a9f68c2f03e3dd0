"""What all commands share: where they print, and which files they may write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from condyn_pin.errors import InvalidArgument

# Tables keep their columns: a narrow terminal, or a file, gets long lines rather than cut numbers.
console = Console(width=max(Console().width, 118), markup=False)


def check_files(
    csv: Path | None, as_json: Path | None, plot: Path | None, native: Path | None
) -> None:
    """Refuse what would only fail when everything has been measured."""
    from condyn_pin.bench_table import BenchTable
    from condyn_pin.plots import PICTURES, require_matplotlib

    for path in (csv, as_json, plot):
        if path and not path.absolute().parent.is_dir():
            raise InvalidArgument(f"{path}: there is no folder {path.parent}; make it first")
    if plot:
        require_matplotlib()
        if plot.suffix not in PICTURES:
            raise InvalidArgument(f"{plot}: the ending says the format: {', '.join(PICTURES)}")
    if native:
        BenchTable((), {}).with_native(native)


def finite(value: Any) -> Any:
    """Return the value with None in place of what json has no word for."""
    if isinstance(value, list):
        return [finite(entry) for entry in value]
    return value if -float("inf") < value < float("inf") else None
