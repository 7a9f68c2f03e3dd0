"""Put every contact solver through every hard contact problem; write results, docs.

    python benchmarks/contact_stress.py [--seeds 1] [--from-json]

Lines of other versions of Pinocchio are kept: run it once with each. A few minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
from stress import RESULTS, load, markdown, summary

from condyn_pin._core._pin import VERSION_TEXT
from lab import CONTACT_EXTREMES
from lab.extremes.report import maps, write_csv
from lab.extremes.stress import stress, tasks

JSON = RESULTS / "contact_stress.json"


def pages(runs: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the block of the docs."""
    text = markdown(runs).replace("`make stress`", "`benchmarks/contact_stress.py`")
    return {marks.RESULTS: {"contact_stress": text}}


def main() -> int:
    """Run, write, and update the docs; 1 if there is a defect."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    bad = 0
    if not arguments.from_json:
        outcomes = stress(tasks(tuple(CONTACT_EXTREMES), seeds=arguments.seeds))
        for outcome in outcomes:
            if outcome.verdict.defect:
                print(outcome.verdict.name, outcome.method, outcome.task, outcome.said)
                bad = 1
        write_csv(maps(outcomes), RESULTS / "contact_stress.csv", VERSION_TEXT)
        run = summary(outcomes, arguments.seeds)
        runs = dict(sorted((load(JSON) | {VERSION_TEXT: run}).items()))
        JSON.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")
    marks.write(pages(load(JSON)))
    print(markdown(load(JSON)))
    return bad


if __name__ == "__main__":
    sys.exit(main())
