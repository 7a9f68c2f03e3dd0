"""BenchTable: the rows of a benchmark, with the machine that they were measured on."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from condyn_pin._core.files.beside import write_text
from condyn_pin._core.files.text import parse_json, read_text
from condyn_pin._core.table_text import nulled, write_csv
from condyn_pin._core.timing import Times
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class BenchRow:
    """One method on one scene; NaN where something was not measured.

    Attributes
    ----------
    scene, method : str
    rows, rank : int
        Constraint rows, and how many of them are independent.
    bare_us, bare_p95_us : float
        Pinocchio's own call with the same settings, unguarded [us].
    acceleration_us, acceleration_p95_us : float
        `Workspace.acceleration` [us].
    solve_us : float
        `Workspace.solve`, with its three errors [us].
    to_bare, solve_to_bare : float
        `acceleration` and `solve` over the bare call, medians of ratios within one round.
    to_dense : float
        The time of the fastest dense method over this method's: how many times faster it is. Dense
        are `DenseKKT` and the equations by hand, solved by numpy, by LAPACK's sysv and by
        Pinocchio's contact Cholesky; in C++ that program's own dense method.
    error : float
        Worst error of a against Reference, relative to the larger of |a| and gravity.
    dynamics_error, constraint_error : float
        Worst residuals [N, N m] and [m/s^2, rad/s^2].
    iterations : int
    status : str
        How many states ended with which status; "by hand" where nothing says one.
    origin : str
        "python", or "C++" for rows of the native program.
    """

    scene: str
    method: str
    rows: int
    rank: int
    bare_us: float = math.nan
    bare_p95_us: float = math.nan
    acceleration_us: float = math.nan
    acceleration_p95_us: float = math.nan
    solve_us: float = math.nan
    to_bare: float = math.nan
    solve_to_bare: float = math.nan
    to_dense: float = math.nan
    error: float = math.nan
    dynamics_error: float = math.nan
    constraint_error: float = math.nan
    iterations: int = 0
    status: str = ""
    origin: str = "python"

    def timed(self, hot: Times, full: Times, bare: Times | None, dense: Times | None) -> BenchRow:
        """Return the row with its times."""
        row = replace(
            self,
            acceleration_us=hot.median,
            acceleration_p95_us=hot.p95,
            solve_us=full.median,
            to_dense=dense.ratio(hot) if dense else math.nan,
        )
        if bare is None:
            return row
        return replace(
            row,
            bare_us=bare.median,
            bare_p95_us=bare.p95,
            to_bare=hot.ratio(bare),
            solve_to_bare=full.ratio(bare),
        )


@dataclass(frozen=True)
class BenchTable:
    """Rows, and the machine they were measured on."""

    rows: tuple[BenchRow, ...]
    machine: dict[str, str]

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, after comment lines with the machine."""
        columns = [field.name for field in fields(BenchRow)]
        write_csv(path, self.machine, columns, (asdict(row) for row in self.rows))

    def to_json(self, path: str | Path) -> None:
        """Write machine and rows; what was not measured is null."""
        write_text(path, json.dumps(self.as_dict(), indent=1) + "\n")

    def as_dict(self) -> dict[str, Any]:
        """Return machine and rows as plain values."""
        return {"machine": self.machine, "rows": [nulled(asdict(row)) for row in self.rows]}

    def with_native(self, path: str | Path) -> BenchTable:
        """Return the table with the rows that `benchmarks/native` wrote to a json file."""
        try:
            native = parse_json(read_text(path))
            sizes = {scene["scene"]: scene for scene in dict(native).get("scenes", ())}
            dense = {r["scene"]: r["median_us"] for r in native["rows"] if r["method"] == "dense"}
            rows = tuple(
                _native_row(row, sizes.get(row["scene"], {}), dense.get(row["scene"]))
                for row in native["rows"]
            )
        except (
            OSError,
            ArithmeticError,
            AttributeError,
            LookupError,
            TypeError,
            ValueError,
        ) as error:
            raise InvalidArgument(
                f"{path}: not a result of benchmarks/native ({error}); `make native` writes one"
            ) from error
        known = {
            f"native {key}": str(value) for key, value in native.items() if isinstance(value, str)
        }
        return BenchTable(self.rows + rows, self.machine | known)


# What the native program times beside constrained forward dynamics.
_OTHER_QUESTIONS = ("aba", "computeConstraintDynamicsDerivatives")


def _native_row(row: dict[str, Any], size: dict[str, Any], dense: float | None) -> BenchRow:
    number = {key: math.nan if value is None else value for key, value in row.items()}
    is_compared = row["method"] not in _OTHER_QUESTIONS
    return BenchRow(
        scene=row["scene"],
        method=f"{row['method']}, mu {row['mu']:g}" if row["mu"] else row["method"],
        rows=int(size.get("rows", 0)),
        rank=int(size.get("rank", 0)),
        bare_us=float(number["median_us"]),
        bare_p95_us=float(number["p95_us"]),
        to_dense=dense / number["median_us"] if dense and is_compared else math.nan,
        error=float(number["error"]),
        dynamics_error=float(number["dynamics_error"]),
        constraint_error=float(number["constraint_error"]),
        iterations=int(row["iterations"] or 0),
        origin="C++",
    )
