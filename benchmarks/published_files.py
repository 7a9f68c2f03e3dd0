"""Robots and worlds that others published, read here and by somebody else.

    python benchmarks/published_files.py FOLDER [--quick] [--only WORD]

`FOLDER/owner+name/...` holds the files of the public repositories that `published_sources.txt`
names; none is a part of this project, and one that is not there is said to be missing. The judges
(`judges/files.py`), and what they are asked at random states, closed where there are loops:

    MuJoCo      M, h, springs and dampers, a, gap and rows of loops and couplings, limits, friction.
                It reads MJCF and URDF itself, but for inertias of a URDF that no solid has,
                which it refuses; of an SDF it gets what is drawn
    sums        the mass of all links, where MuJoCo has no such joints: screws, planes, balls in a
                URDF by a YAML beside it
    XML         mimics of a URDF: the other joint, multiplier and offset, beside every judge

An answer that differs is WRONG, unless `Robot.unmodelled` names what may be the cause. What MuJoCo
says otherwise then stands beside it.
"""

from __future__ import annotations

import os
import sys
import warnings
from argparse import ArgumentParser, Namespace
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import script
from judges.files import Unread, compared, mimics, sums
from script import Table

import condyn_pin as cp

SOURCES = Path(__file__).resolve().parent / "judges" / "published_sources.txt"
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
    lines = SOURCES.read_text(encoding="utf-8").splitlines()
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


def measure(given: Namespace) -> script.Saved:
    """Judge every file that is there."""
    if given.folder is None:
        raise SystemExit("a folder with checkouts is needed")
    about, rows = script.measured_on(), []
    for source in sources():
        if given.only not in f"{source.repository}/{source.path}":
            continue
        path = source.within(given.folder)
        verdict = judged(path, source.model) if path.is_file() else Verdict("missing")
        rows.append(asdict(source) | asdict(verdict))
        print(f"{verdict.verdict:9} {source.repository}/{source.path}", file=sys.stderr)
    return {**about, "files": rows}


def table(saved: script.Saved) -> str:
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


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--only", default="", help="a word of their paths; nothing is written")


SUBJECTS = [
    Table(
        "published_files",
        "published URDF, SDF and MJCF files: read here, and by MuJoCo",
        measure,
        table,
        beside=lambda saved: script.write(script.result("published_files", ".md"), table(saved)),
        quick="nothing is written",
        options=_options,
        draft=("quick", "only"),
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
