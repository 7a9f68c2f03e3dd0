"""From the results of all passes to one table, and to speed at equal error."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from peers.harness import REFERENCES

ON_PINOCCHIO = ("condyn_pin", "condyn_pin, compiled", "Pinocchio")
PEERS = (*ON_PINOCCHIO, "MuJoCo", "Crocoddyl", "Drake", "exudyn")
REFERENCE_VERSION = "4.1"
TARGETS = {
    "acceleration": (1e-2, 1e-8),
    "derivatives": (1e-1, 1e-8),
    "motion": (1e-2, 1e-5),
}


@dataclass(frozen=True)
class PeerRow:
    """One method on one scene.

    Attributes
    ----------
    scene, quantity, peer, version, pinocchio, method, note : str
        `pinocchio` is the version in the same environment.
    median_us, min_us, p95_us : float
        [us] a call, of a motion [us] for 1 ms of it: median over the passes of the medians, the
        least of all samples, median over the passes of the 95th percentiles.
    ratio, ratio_low, ratio_high : float
        Least time over that of bare Pinocchio 4.1 in the same pass: median, least and largest of
        the passes. Least times, since what else runs on a machine only adds.
    error_median, error_worst : float
        Over the states.
    """

    scene: str
    quantity: str
    peer: str
    version: str
    pinocchio: str
    method: str
    median_us: float
    min_us: float
    p95_us: float
    ratio: float
    ratio_low: float
    ratio_high: float
    error_median: float
    error_worst: float
    note: str = ""


@dataclass(frozen=True)
class PeerTable:
    """All rows, with what they were measured on and what is missing."""

    rows: tuple[PeerRow, ...]
    machine: dict[str, str]
    skipped: dict[str, str]
    passes: int
    states: int

    def fastest(self, scene: str, quantity: str, peer: str, error: float) -> PeerRow | None:
        """Return a peer's fastest row whose worst error is at most this, if there is one.

        Of Pinocchio and of condyn_pin those on Pinocchio 4.1 are looked at.
        """
        found = [
            row
            for row in self.rows
            if (row.scene, row.quantity, row.peer) == (scene, quantity, peer)
            and row.error_worst <= error
            and (row.pinocchio.startswith(REFERENCE_VERSION) or peer not in ON_PINOCCHIO)
        ]
        return min(found, key=lambda row: row.ratio, default=None)

    def bare_us(self, scene: str, quantity: str) -> float:
        """Return the least time of the reference [us], in its own environment."""
        return next(
            row.min_us
            for row in self.rows
            if row.scene == scene
            and row.method == REFERENCES[quantity]
            and row.version.startswith(REFERENCE_VERSION)
        )

    def to_json(self, path: Path) -> None:
        """Write everything."""
        text = json.dumps({**asdict(self), "rows": [asdict(row) for row in self.rows]}, indent=1)
        path.write_text(text + "\n", encoding="utf-8")

    def to_markdown(self) -> str:
        """Return all rows, scene by scene."""
        lines = ["# Peers: same robot, same state", "", _where(self), ""]
        for scene, quantity in dict.fromkeys((row.scene, row.quantity) for row in self.rows):
            unit = "us for 1 ms" if quantity == "motion" else "us"
            lines += [
                f"## {scene}: {quantity}",
                "",
                f"| peer | method | {unit} | least | x bare | error: median | worst | note |",
                "|---|---|---|---|---|---|---|---|",
            ]
            group = [r for r in self.rows if (r.scene, r.quantity) == (scene, quantity)]
            for row in sorted(group, key=lambda row: row.ratio):
                cells = (
                    f"{row.peer} {row.version}{_beside(row)}",
                    row.method,
                    f"{row.median_us:.1f}",
                    f"{row.min_us:.1f}",
                    f"{row.ratio:.2f} ({row.ratio_low:.2f}-{row.ratio_high:.2f})",
                    f"{row.error_median:.0e}",
                    f"{row.error_worst:.0e}",
                    row.note,
                )
                lines.append("| " + " | ".join(cells) + " |")
            lines.append("")
        lines += ["## Not there", ""]
        lines += [f"- {peer}: {why}" for peer, why in self.skipped.items()]
        return "\n".join(lines) + "\n"

    def at_equal_error(self, targets: Mapping[str, Sequence[float]] = TARGETS) -> str:
        """Return a table: the fastest way of each peer to each error."""
        lines = [
            f"| scene | what | error at most | bare [us] | {' | '.join(PEERS)} |",
            "|---" * (4 + len(PEERS)) + "|",
        ]
        for scene, quantity in dict.fromkeys((row.scene, row.quantity) for row in self.rows):
            bare = self.bare_us(scene, quantity)
            for target in targets[quantity]:
                rows = [self.fastest(scene, quantity, peer, target) for peer in PEERS]
                cells = ["" if row is None else f"{row.ratio:.2f}" for row in rows]
                lines.append(
                    f"| {scene} | {quantity} | {target:.0e} | {bare:.1f} | {' | '.join(cells)} |"
                )
        return "\n".join([*lines, "", _where(self)])


def _beside(row: PeerRow) -> str:
    own = row.peer == "Pinocchio" or row.pinocchio.startswith(REFERENCE_VERSION)
    return "" if own else f" on Pinocchio {row.pinocchio}"


def _where(table: PeerTable) -> str:
    return (
        "`python benchmarks/peers/run.py` (`benchmarks/results/peers.json`) on {processor} "
        "({cores} cores, one thread), {system}, Python {python}, {date}"
    ).format(**table.machine) + f"; {table.passes} passes, {table.states} states."


def gather(passes: Sequence[Sequence[dict[str, Any]]]) -> tuple[PeerRow, ...]:
    """Return one row a method from the results of each script in each pass.

    A pass is a list of what scripts wrote. The reference is taken from the row's own process and
    rounds, if Pinocchio 4.1 is there, and otherwise from the first process of the same pass that
    has it.
    """
    found: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for results in passes:
        seen: set[tuple[str, ...]] = set()
        for result in results:
            for row in result["rows"]:
                version = result["pinocchio"]
                key = tuple(row[k] for k in ("scene", "quantity", "peer", "version", "method"))
                key = (*key, version)
                if key not in seen:
                    seen.add(key)
                    entry = {**row, "pinocchio": version, "ratio": _ratio(row, result, results)}
                    found.setdefault(key, []).append(entry)
    scenes = list(dict.fromkeys(key[0] for key in found))
    quantities = list(TARGETS)
    rows = [_row(entries) for entries in found.values()]
    return tuple(sorted(rows, key=lambda r: (scenes.index(r.scene), quantities.index(r.quantity))))


def _ratio(row: dict[str, Any], result: dict[str, Any], results: Iterable[dict[str, Any]]) -> float:
    if result["pinocchio"].startswith(REFERENCE_VERSION):
        return float(row["min_us"] / row["bare_min_us"])
    for other in results:
        if other["pinocchio"].startswith(REFERENCE_VERSION):
            for near in other["rows"]:
                if all(near[k] == row[k] for k in ("scene", "quantity")):
                    return float(row["min_us"] / near["bare_min_us"])
    raise ValueError(f"no bare Pinocchio {REFERENCE_VERSION} in the pass of {row['method']!r}")


def _row(entries: Sequence[dict[str, Any]]) -> PeerRow:
    first, ratios = entries[0], [entry["ratio"] for entry in entries]
    texts = ("scene", "quantity", "peer", "version", "pinocchio", "method", "note")
    return PeerRow(
        **{key: first[key] for key in texts},
        median_us=median(entry["median_us"] for entry in entries),
        min_us=min(entry["min_us"] for entry in entries),
        p95_us=median(entry["p95_us"] for entry in entries),
        ratio=median(ratios),
        ratio_low=min(ratios),
        ratio_high=max(ratios),
        error_median=max(entry["error_median"] for entry in entries),
        error_worst=max(entry["error_worst"] for entry in entries),
    )


def load(path: Path) -> PeerTable:
    """Return the table that `to_json` wrote."""
    saved = json.loads(path.read_text(encoding="utf-8"))
    return PeerTable(**{**saved, "rows": tuple(PeerRow(**row) for row in saved["rows"])})
