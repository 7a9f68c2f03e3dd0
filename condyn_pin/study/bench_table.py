"""BenchTable: the rows of a benchmark, with the machine that they were measured on."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any, ClassVar

from condyn_pin._core.files.text import parse_json, read_text
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.tables import Columns, Measurements, Record, number


@dataclass(frozen=True)
class BenchRow(Record):
    """One method on one scene; NaN where something was not measured."""

    scene: str
    method: str
    rows: int  # of constraints
    rank: int  # how many of them are independent
    bare_us: float = nan  # Pinocchio's own call with the same settings, unguarded [us]
    bare_p95_us: float = nan
    acceleration_us: float = nan  # `Workspace.acceleration` [us]
    acceleration_p95_us: float = nan
    solve_us: float = nan  # `Workspace.solve`, with its three errors [us]
    to_bare: float = nan  # `acceleration` over the bare call, median of ratios within one round
    solve_to_bare: float = nan
    # The time of the fastest dense method over this method's: how many times faster it is. Dense
    # are `DenseKKT` and the equations by hand, solved by numpy, by LAPACK's sysv and by Pinocchio's
    # contact Cholesky; in C++ that program's own dense method.
    to_dense: float = nan
    error: float = nan  # worst of a against Reference, relative to the larger of |a| and gravity
    dynamics_error: float = nan  # worst residual [N, N m]
    constraint_error: float = nan  # [m/s^2, rad/s^2]
    iterations: int = 0
    status: str = ""  # how many states ended with which; "by hand" where nothing says one
    origin: str = "python"  # or "C++" for rows of the native program


@dataclass(frozen=True)
class BenchTable(Measurements[BenchRow]):
    """Rows of a benchmark, scene by scene, and the machine they were measured on."""

    kind: ClassVar[type[BenchRow]] = BenchRow
    columns: ClassVar[Columns[BenchRow]] = (
        ("method", lambda r: r.method if r.origin == "python" else f"{r.method} ({r.origin})"),
        ("bare", lambda r: number(r.bare_us, ".1f")),
        ("a", lambda r: number(r.acceleration_us, ".1f")),
        ("p95", lambda r: number(r.acceleration_p95_us, ".1f")),
        ("solve", lambda r: number(r.solve_us, ".1f")),
        ("a / bare", lambda r: number(r.to_bare, ".2f")),
        ("solve / bare", lambda r: number(r.solve_to_bare, ".2f")),
        ("x dense", lambda r: number(r.to_dense, ".2f")),
        ("error of a", lambda r: number(r.error, ".0e")),
        ("it.", lambda r: str(r.iterations or "")),
        ("status", lambda r: r.status),
    )

    def by_scene(self) -> dict[str, BenchTable]:
        """Return the table of each scene, by its title: label, rows and rank."""
        found = {}
        for scene in dict.fromkeys(row.scene for row in self.rows):
            rows = tuple(row for row in self.rows if row.scene == scene)
            sizes = next((f": {row.rows} rows, rank {row.rank}" for row in rows if row.rows), "")
            found[scene + sizes] = BenchTable(rows, self.machine)
        return found

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
        except (OSError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as e:
            raise InvalidArgument(
                f"{path}: not a result of benchmarks/native ({e}); `make native-bench` writes one"
            ) from e
        said = {f"native {key}": str(x) for key, x in native.items() if isinstance(x, str)}
        return BenchTable(self.rows + rows, self.machine | said)


# What the native program times beside constrained forward dynamics.
_OTHER_QUESTIONS = ("aba", "computeConstraintDynamicsDerivatives")


def _native_row(row: dict[str, Any], size: dict[str, Any], dense: float | None) -> BenchRow:
    floats = {key: nan if value is None else value for key, value in row.items()}
    is_compared = row["method"] not in _OTHER_QUESTIONS
    return BenchRow(
        scene=row["scene"],
        method=f"{row['method']}, mu {row['mu']:g}" if row["mu"] else row["method"],
        rows=int(size.get("rows", 0)),
        rank=int(size.get("rank", 0)),
        bare_us=float(floats["median_us"]),
        bare_p95_us=float(floats["p95_us"]),
        to_dense=dense / floats["median_us"] if dense and is_compared else nan,
        error=float(floats["error"]),
        dynamics_error=float(floats["dynamics_error"]),
        constraint_error=float(floats["constraint_error"]),
        iterations=int(row["iterations"] or 0),
        origin="C++",
    )
