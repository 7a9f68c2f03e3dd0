"""What the README says of errors that come without a warning: a table of committed answers.

Every figure is one of results/truth.json, which truth.py writes, or of results/peers.json.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import marks

RESULTS = Path(__file__).resolve().parent / "results"
STATES = 10  # of a case


def best(peers: Mapping[str, Any], peer: str) -> float:
    """Return the least error of a that a peer reaches on Cassie's loops, with any setting."""
    asked = ("cassie, loops", "acceleration", peer)
    rows = (r for r in peers["rows"] if (r["scene"], r["quantity"], r["peer"]) == asked)
    return float(min(row["error_worst"] for row in rows))


def essence(saved: Mapping[str, Any], peers: Mapping[str, Any]) -> str:
    """Return the README's table: a row a question."""
    f, page = saved["cases"], "docs/pitfalls.md"
    soft = [best(peers, peer) for peer in ("MuJoCo", "Drake", "condyn_pin")]
    rows = [
        (
            f"[four-bar, default settings]({page}#1-nan-from-the-default-settings)",
            "NaN",
            f"a to {f['defaults']['ours']:.0e}; the redundant row is named",
        ),
        (
            f"[Talos, `lcaba` called twice]({page}#2-lcaba-is-right-on-its-first-call)",
            f"the second a is off by {f['second_call']['theirs']:.0%}",
            f"both to {f['second_call']['ours']:.0e}",
        ),
        (
            f"[Cassie's loops, `lcaba`, mu = 1e-8]({page}#4-j-a--gamma--0-and-a-is-wrong)",
            f"J a + gamma = 0 to {f['small_mu']['slack']:.0e}, "
            f"a is off by {f['small_mu']['theirs']:.0%}",
            f"`{'`, `'.join(f['small_mu']['said'])}`; by default a to {f['small_mu']['ours']:.0e}",
        ),
        (
            f"[Talos, `absolute_residual` of a right a]({page}#3-a-residual-that-is-not-one)",
            f"{f['not_a_residual']['theirs']:.0f} or more",
            f"{f['not_a_residual']['ours']:.0e} at most, recomputed",
        ),
        (
            f"[four-bar, da/dq along its loop]({page}#5-a-wrong-first-column-of-the-derivatives)",
            f"off by {f['first_column']['theirs']:.1f} times itself",
            f"within {f['first_column']['ours']:.0e} of differences",
        ),
        (
            f"[Talos, a quaternion of norm 2]({page}#9-a-quaternion-that-is-not-normalised-a-nan)",
            f"a is off by {f['long_quaternion']['theirs']:.0%}",
            "refused; the error names the entry",
        ),
        (
            "[Cassie's loops, MuJoCo; Drake](docs/simulators.md)",
            f"a is off by {soft[0]:.0e}; {soft[1]:.0e} at best: soft rows, no defect",
            f"a to {soft[2]:.0e}",
        ),
    ]
    where = (
        f"`python benchmarks/truth.py`, worst of {STATES} states, on "
        "{processor}, {system}, Python {python}, Pinocchio {pinocchio}, {date}; the last row "
    ).format(**saved["machine"])
    where += "`benchmarks/peers/run.py` on {processor}, {date}.".format(**peers["machine"])
    lines = ["| asked | elsewhere, without a warning | here |", "|---|---|---|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines, "", where])


def load() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the committed answers, and those of the peers."""
    saved, peers = (
        json.loads((RESULTS / name).read_text(encoding="utf-8"))
        for name in ("truth.json", "peers.json")
    )
    return saved, peers


def pages(saved: Mapping[str, Any], peers: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the README's block."""
    return {marks.README: {"truth": essence(saved, peers)}}
