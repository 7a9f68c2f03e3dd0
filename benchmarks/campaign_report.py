"""Counts, worst errors and seeds of a campaign, a table for all parts."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import marks

from condyn_pin._core.tolerances import DERIVATIVES, FORCES, SOLVED

Line = dict[str, Any]
_LISTED = 20


def report(parts: Mapping[str, Sequence[Line]], folder: Path | None) -> int:
    """Print what came out, write it into a folder if one is given; 1 if anything was wrong."""
    summaries = {name: summary(lines) for name, lines in parts.items()}
    print(markdown(summaries))
    wrong = 0
    for name, found in summaries.items():
        for what, cases in found["wrong"].items():
            wrong += len(cases)
            for case in cases[:_LISTED]:
                print(f"{name}: {what}: {case}")
        for case in found["check_disagrees"][:_LISTED]:
            print(f"{name}: check=True: {case}")
    if folder is not None:
        text = json.dumps(summaries, indent=1)
        (folder / "campaign.json").write_text(text + "\n", encoding="utf-8")
        (folder / "campaign.md").write_text(markdown(summaries) + "\n", encoding="utf-8")
        marks.write(pages(summaries))
    return int(wrong > 0)


def load(path: Path) -> dict[str, Line]:
    """Return the summaries that were committed, by Pinocchio and kernel."""
    return dict(json.loads(path.read_text(encoding="utf-8")))


def pages(summaries: Mapping[str, Line]) -> dict[str, dict[str, str]]:
    """Return the blocks of README and docs."""
    return {
        marks.README: {"campaign": sentence(summaries)},
        marks.RESULTS: {"campaign": essence(summaries)},
    }


def sentence(summaries: Mapping[str, Line]) -> str:
    """Return how many answers said ok, and how many of them were wrong, by method."""
    ok: Counter[str] = Counter()
    for found in summaries.values():
        for name, counts in found["statuses"].items():
            ok["derivatives" if name.startswith("derivatives") else "solves"] += counts.get("ok", 0)
    lists = (cases for found in summaries.values() for cases in found["wrong"].values())
    wrong = [case.partition(", ")[2] for cases in lists for case in cases]
    methods = Counter(case.partition(":")[0] for case in wrong)
    named = "; ".join(f"{n} of `{name}`" for name, n in methods.most_common())
    parts = [dict.fromkeys(each) for each in zip(*(n.split("-") for n in summaries), strict=True)]
    return (
        f"{sum(found['problems'] for found in summaries.values())} random problems against an "
        f"oracle that knows only positions: of {ok['solves']} answers and {ok['derivatives']} "
        f"derivatives reported ok **{len(wrong)} were wrong**{f' ({named})' if named else ''}.\n"
        f"`benchmarks/campaign.py`, Pinocchio {' and '.join(parts[0])}, kernels "
        f"{' and '.join(parts[1])}; limits: a {SOLVED:.0e}, forces {FORCES:.0e}, derivatives "
        f"{DERIVATIVES:.0e}."
    )


def essence(summaries: Mapping[str, Line]) -> str:
    """Return a row for each part: how many answers, and how many of them were wrong."""
    lines = [
        "| Pinocchio, kernel | problems | solves | said ok | worst | wrong | derivatives | wrong |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, found in summaries.items():
        solvers = [n for n in found["statuses"] if not n.startswith("derivatives")]
        ok = sum(found["statuses"][n].get("ok", 0) for n in solvers)
        worst = max((found["worst"].get(n, 0.0) for n in solvers), default=0.0)
        wrong = {what: len(cases) for what, cases in found["wrong"].items()}
        lines.append(
            f"| {name} | {found['problems']} | {found['solves']} | {ok} | {worst:.0e} | "
            f"{wrong['solve'] + wrong['force'] + wrong['raised']} | {found['derivative_calls']} | "
            f"{wrong['derivative']} |"
        )
    return "\n".join(lines)


def summary(lines: Sequence[Line]) -> Line:
    """Return counts and worst errors of one part, and the seeds of what was wrong."""
    statuses: dict[str, Counter[str]] = {}
    worst: dict[str, float] = {}
    wrong: dict[str, list[str]] = {k: [] for k in ("solve", "force", "derivative", "raised")}
    derived: Counter[str] = Counter()
    disagreeing: list[str] = []
    joints, kinds = Counter[str](), Counter[str]()
    for each in lines:
        joints.update(each.get("joints", ()))
        kinds.update(each.get("kinds", ()))
        for one in each.get("solves", ()):
            name, status = one["solver"], one["status"]
            statuses.setdefault(name, Counter())[status] += 1
            _verifier(wrong, each["seed"], name, one, SOLVED, "solve")
            if status == "ok":
                worst[name] = max(worst.get(name, 0.0), one["error"])
        for one in each.get("derivatives", ()):
            name = f"derivatives {one['method']}"
            derived[one["status"]] += 1
            statuses.setdefault(name, Counter())[one["status"]] += 1
            _verifier(wrong, each["seed"], name, one, DERIVATIVES, "derivative")
            if one["status"] == "ok":
                worst[name] = max(worst.get(name, 0.0), one["error"])
            if "checked" in one:
                disagreeing.append(f"seed {each['seed']}, {name}: {one['checked']}")
    solvers = [n for n in statuses if not n.startswith("derivatives")]
    return {
        "problems": sum("solves" in each for each in lines),
        "refused": sum("refused" in each for each in lines),
        "undecided": sum("undecided" in each for each in lines),
        "with_forces": sum(bool(each.get("forces")) for each in lines),
        "with_redundant_rows": sum(each.get("rank", 0) < each.get("rows", 0) for each in lines),
        "solves": sum(n for s in solvers for k, n in statuses[s].items() if k != "untaken"),
        "derivative_calls": sum(n for k, n in derived.items() if k != "untaken"),
        "statuses": {name: dict(counts) for name, counts in statuses.items()},
        "worst": worst,
        "joints": dict(joints.most_common()),
        "kinds": dict(kinds.most_common()),
        "wrong": wrong,
        "check_disagrees": disagreeing,
    }


def _verifier(
    wrong: dict[str, list[str]], seed: int, name: str, one: Line, limit: float, what: str
) -> None:
    """Enter an answer into the lists where it is wrong, or raised what it should not."""
    if one["status"] == "raised":
        wrong["raised"].append(f"seed {seed}, {name}: {one['said']}")
    elif one["status"] == "ok":
        if not one["error"] <= limit:
            bound = f", bound {one['bound']:.1e}" if "bound" in one else ""
            wrong[what].append(f"seed {seed}, {name}: {one['error']:.1e}{bound}")
        if not one.get("force_error", 0.0) <= FORCES:
            wrong["force"].append(f"seed {seed}, {name}: {one['force_error']:.1e}")


def markdown(summaries: Mapping[str, Line]) -> str:
    """Return a row for each part and each method."""
    lines = [
        "| Pinocchio, kernel | method | ok | said so | untaken | worst error of ok | wrong |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, found in summaries.items():
        everything = [case for cases in found["wrong"].values() for case in cases]
        for method, counts in sorted(found["statuses"].items()):
            said = sum(n for k, n in counts.items() if k not in ("ok", "untaken", "raised"))
            wrong = sum(f", {method}:" in case for case in everything)
            lines.append(
                f"| {name} | {method} | {counts.get('ok', 0)} | {said} | "
                f"{counts.get('untaken', 0)} | {found['worst'].get(method, 0.0):.0e} | {wrong} |"
            )
    for name, found in summaries.items():
        lines += ["", (
            f"{name}: {found['problems']} problems, {found['solves']} solves, "
            f"{found['derivative_calls']} calls of derivatives; external forces in "
            f"{found['with_forces']}, redundant rows in {found['with_redundant_rows']}; "
            f"{found['refused']} models refused, {found['undecided']} of undecided rank."
        )]  # fmt: skip
    return "\n".join(lines)
