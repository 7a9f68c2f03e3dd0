"""What the docs say of the study: tables made of committed rows, between marks.

Every figure in a block is one of a row of results/trade.json or of results/cheapest.csv.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from cheapest import LEVELS, Verdict
from marks import SOLVERS as PAGE

import condyn_pin as cp
from condyn_pin.study.printing import timed
from condyn_pin.study.tables import pareto_front


def pages(
    table: cp.study.Table, found: Sequence[Verdict], shown: Sequence[str]
) -> dict[str, dict[str, str]]:
    """Return the blocks of the page on solvers, by name."""
    return {
        PAGE: {
            "choices": f"{choices(found)}\n\n{where(table)}",
            "wins": wins(found),
            "methods": methods(table),
            "exact": exact(table, shown),
            "failures": failures(table),
        },
    }


def choices(found: Sequence[Verdict]) -> str:
    """Return the cheapest solver of each scene, a column an error."""
    lines = ["| scene | " + " | ".join(f"error {level:g}" for level in LEVELS) + " |"]
    lines.append("|---" * (1 + len(LEVELS)) + "|")
    for scene in dict.fromkeys(one.scene for one in found):
        mine = {one.error: one for one in found if one.scene == scene}
        rows = next(iter(mine.values())).rows
        cells = [f"{scene} ({rows} rows)", *(_choice(mine[level]) for level in LEVELS)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _choice(one: Verdict) -> str:
    if not one.solver:
        return "none"
    return f"`{one.solver}` {one.us:.1f} us, {one.worst:.0e}" + ("" if one.holds else " (missed)")


def where(table: cp.study.Table) -> str:
    """Return what was measured how, and on what."""
    machine = (
        "`python benchmarks/trade.py` on {processor} ({cores} cores, one thread), {system}, "
        "Python {python}, Pinocchio {pinocchio}, {date}."
    ).format(**table.machine)
    n, states = table.rows[0].n, table.rows[0].states
    loads = "" if "under" in states else (
        " All of these were in motion under random torques of the motors: at rest, or where the "
        "motors carry the weight, the error of an early stop may be a thousand times larger, and "
        "`tune` would choose otherwise."
    )  # fmt: skip
    return (
        f"{machine} Median time of `Workspace.acceleration`; worst error at 1000 states that "
        f"neither the study ({n} states) nor the choice (200) had seen.{loads} {timed(table)}"
    )


def wins(found: Sequence[Verdict]) -> str:
    """Return how often each method is the cheapest, by error."""
    names = Counter(one.solver.split("(")[0] for one in found if one.solver)
    lines = ["| method | " + " | ".join(f"error {level:g}" for level in LEVELS) + " |"]
    lines.append("|---" * (1 + len(LEVELS)) + "|")
    for name, _ in names.most_common():
        mine = Counter(one.error for one in found if one.solver.split("(")[0] == name)
        lines.append(f"| `{name}` | " + " | ".join(str(mine[level]) for level in LEVELS) + " |")
    return "\n".join(lines)


def methods(table: cp.study.Table) -> str:
    """Return of every method how it does with its default parameters, over all scenes."""
    lines = [
        "| method, default parameters | scenes with every answer ok "
        "| times slower than the fastest "
        "that is ok: least, median, most | worst error |",
        "|---|---|---|---|",
    ]
    fastest = {
        scene: min(
            (r.us for r in table.rows if r.scene == scene and r.comparable and r.ok),
            default=None,
        )
        for scene in dict.fromkeys(row.scene for row in table.rows)
    }
    plain = [row for row in table.rows if row.short.endswith("()")]
    for name in dict.fromkeys(row.short for row in plain):
        rows = [row for row in plain if row.short == name]
        good = [row for row in rows if row.ok and row.comparable]
        times = sorted(row.us / (fastest[row.scene] or 1.0) for row in good)
        spread = f"{times[0]:.2f}, {times[len(times) // 2]:.2f}, {times[-1]:.2f}" if times else ""
        worst = f"{max(row.error_worst for row in good):.0e}" if good else ""
        lines.append(f"| `{name}` | {len(good)} of {len(rows)} | {spread} | {worst} |")
    return "\n".join(lines)


def exact(table: cp.study.Table, shown: Sequence[str]) -> str:
    """Return the front of some scenes: what each further digit costs."""
    lines = ["| scene | solver | time [us] | worst error |", "|---|---|---|---|"]
    for scene in shown:
        for row in pareto_front([r for r in table.rows if r.scene == scene]):
            time, error = row.us, row.error_worst
            lines.append(f"| {scene} | `{row.short}` | {time:.1f} | {error:.0e} |")
    return "\n".join(lines)


def failures(table: cp.study.Table) -> str:
    """Return which methods do not answer on which scenes, with their default parameters."""
    lines = ["| method | scene | statuses |", "|---|---|---|"]
    for row in table.rows:
        if row.short.endswith("()") and not row.answered:
            said = ", ".join(f"{n} {status}" for status, n in row.statuses.items())
            lines.append(f"| `{row.short}` | {row.scene} | {said} |")
    return "\n".join(lines)
