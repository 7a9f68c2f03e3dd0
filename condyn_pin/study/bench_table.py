"""BenchTable: the rows of a benchmark, with the machine that they were measured on."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import ClassVar

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
    # contact Cholesky; in C++ the whole matrix by Eigen's LDLT and its blocks by LLT.
    to_dense: float = nan
    error: float = nan  # worst of a against Reference, relative to the larger of |a| and gravity
    dynamics_error: float = nan  # worst residual [N, N m]
    constraint_error: float = nan  # [m/s^2, rad/s^2]
    iterations: int = 0
    status: str = ""  # how many states ended with which; "by hand" where nothing says one
    origin: str = "python"  # or "C++", for what is compiled: then `bare_us` is its time


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

    def of_origin(self, origin: str) -> BenchTable:
        """Return the rows of Python, or of C++."""
        return BenchTable(tuple(r for r in self.rows if r.origin == origin), self.machine)

    def by_scene(self) -> dict[str, BenchTable]:
        """Return the table of each scene, by its title: label, rows and rank."""
        found = {}
        for scene in dict.fromkeys(row.scene for row in self.rows):
            rows = tuple(row for row in self.rows if row.scene == scene)
            sizes = next((f": {row.rows} rows, rank {row.rank}" for row in rows if row.rows), "")
            found[scene + sizes] = BenchTable(rows, self.machine)
        return found
