"""Robots and worlds that others published, read here and by somebody else.

    python benchmarks/published_files.py FOLDER [--quick] [--only WORD]
    python benchmarks/published_files.py --from-json

`FOLDER/owner+name/...` holds the files of the public repositories that `published_sources.txt`
names; none is a part of this project, and one that is not there is said to be missing. Writes
benchmarks/results/published_files.{json,md}. The judges, and what they are asked at random states,
closed where there are loops:

    MuJoCo      M, h, springs and dampers, a, gap and rows of loops and couplings, limits, friction.
                It reads MJCF and URDF itself, but for inertias of a URDF that no solid has,
                which it refuses; of an SDF it gets what `published_sdf` reads
    sums        the mass of all links, where MuJoCo has no such joints: screws, planes, balls in a
                URDF by a YAML beside it
    XML         mimics of a URDF: the other joint, multiplier and offset, beside every judge

An answer that differs is WRONG, unless `Robot.unmodelled` names what may be the cause. What MuJoCo
says otherwise then stands beside it.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import script
from published_judge import compared, mimics, sums
from published_sdf import Unread

import condyn_pin as cp

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results" / "published_files.json"
# What may differ where something acts that is named, and where an armature is.
FORCES = ("passive", "a")
INERTIAS = ("M", "h", "joint")
SHOWN = 240  # letters of a verdict in the table; the json has all
KINDS = {
    "agrees": "loads, agrees",
    "lacks": "loads, with a named lack",
    "unjudged": "loads, and nobody could judge it",
    "refused": "refused by name",
}


@dataclass(frozen=True)
class Source:
    """A file of a public repository."""

    repository: str
    path: str
    model: str | None = None  # of an SDF with several

    def within(self, folder: Path) -> Path:
        """Return where its checkout has it."""
        return folder / self.repository.replace("/", "+") / self.path


@dataclass(frozen=True)
class Verdict:
    """What became of a file: missing, agrees, lacks, refused, unjudged, WRONG or crash."""

    verdict: str
    said: str = ""
    judge: str = ""
    worst: float | None = None
    size: tuple[int, int] = (0, 0)  # degrees of freedom; loops and couplings


def sources() -> list[Source]:
    """Return the committed list."""
    lines = (HERE / "published_sources.txt").read_text(encoding="utf-8").splitlines()
    found, repository = [], ""
    for line in lines:
        if line.startswith("    "):
            path, _, model = line.strip().partition(" model=")
            found.append(Source(repository, path, model or None))
        elif line and not line.startswith("#"):
            repository = line
    return found


def judged(path: Path, model: str | None) -> Verdict:
    """Load a file and ask its judge."""
    try:
        with warnings.catch_warnings(action="ignore"):
            robot = cp.load_robot(path, model=model)
    except cp.CondynError as error:
        return Verdict("refused", str(error).replace(f"{path}: ", ""))
    except Exception as error:
        return Verdict("crash", f"{type(error).__name__}: {error}")
    size = (robot.nv, len(robot.loops))
    try:
        judge, worst, found = compared(robot, path, model)
    except Unread as error:
        judge, worst, found = sums(robot, path, str(error))
    found += mimics(robot, path) if path.suffix == ".urdf" else []
    lacks = "; ".join(robot.unmodelled)
    pushed = any(not line.startswith("plugins") for line in robot.unmodelled)
    kinds = {*FORCES * pushed, *INERTIAS * ("armature" in lacks), *("J",) * ("equality" in lacks)}
    excused = [x for x in found if x.partition(" ")[0].rstrip(":") in kinds]
    wrong = [term for term in found if term not in excused]
    if wrong:
        return Verdict("WRONG", "; ".join(wrong), judge, worst, size)
    said = lacks + (f" (in MuJoCo other {', '.join(excused)})" if excused else "")
    kind = "lacks" if lacks else "unjudged" if judge.startswith("sums") else "agrees"
    return Verdict(kind, said, judge, worst, size)


def measure(given: argparse.Namespace) -> Mapping[str, Any]:
    """Judge every file that is there."""
    rows = []
    for source in sources():
        if given.only not in f"{source.repository}/{source.path}":
            continue
        path = source.within(given.folder)
        verdict = judged(path, source.model) if path.is_file() else Verdict("missing")
        rows.append(asdict(source) | asdict(verdict))
        print(f"{verdict.verdict:9} {source.repository}/{source.path}", file=sys.stderr)
    return {"files": rows}


def table(saved: Mapping[str, Any]) -> str:
    """Return a row a file."""
    lines = ["| file | v, loops | verdict | judge | worst |", "|---|---|---|---|---|"]
    for row in saved["files"]:
        model = f", model {row['model']}" if row["model"] else ""
        said = f": {row['said']}" if row["said"] else ""
        worst = "" if row["worst"] is None else f"{row['worst']:.0e}"
        size = ", ".join(map(str, row["size"])) if row["judge"] else ""
        name = f"{row['repository']} {row['path']}{model}"
        text = (KINDS.get(row["verdict"], row["verdict"]) + said).replace("|", "\\|")
        text = text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
        lines.append(f"| {name} | {size} | {text} | {row['judge'].replace('|', ' ')} | {worst} |")
    counts = Counter(row["verdict"] for row in saved["files"])
    total = ", ".join(f"{n} {verdict}" for verdict, n in counts.most_common())
    machine = "{processor}, {system}, Python {python}, Pinocchio {pinocchio}, {date}".format(
        **saved["machine"]
    )
    return "\n".join([*lines, "", f"{len(saved['files'])} files: {total}. {machine}."])


def main(words: Sequence[str] | None = None) -> None:
    """Run."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--only", default="")
    given, rest = parser.parse_known_args(words)
    if given.folder is None and not {"--from-json", "--help", "-h"} & set(rest):
        parser.error("a folder with checkouts is needed")
    script.run(
        rest + (["--quick"] if given.only and "--quick" not in rest else []),
        about=__doc__,
        quick="write nothing",
        path=RESULTS,
        measure=lambda _: measure(given),
        table=table,
        pages=lambda _: {},
    )
    if not given.only and "--quick" not in rest:
        saved = json.loads(RESULTS.read_text(encoding="utf-8"))
        RESULTS.with_suffix(".md").write_text(table(saved) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
