"""Climb down every ladder and write benchmarks/results/ladder.{csv,json,png}.

python benchmarks/ladder.py [--quick]
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from condyn_pin.climbing import FULL, QUICK, ladder
from condyn_pin.ladder_plot import save_ladders
from condyn_pin.ladder_table import write_csv
from condyn_pin.ladders import LADDERS

RESULTS = Path(__file__).resolve().parent / "results"


def main() -> None:
    """Run, write, print the tables for the README."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer states and rounds")
    effort = QUICK if parser.parse_args().quick else FULL
    tables = [ladder(name, effort=effort) for name in LADDERS]
    write_csv(tables, RESULTS / "ladder.csv")
    text = json.dumps([table.as_dict() for table in tables], indent=1)
    (RESULTS / "ladder.json").write_text(text + "\n", encoding="utf-8")
    save_ladders(tables, RESULTS / "ladder.png")
    for table in tables:
        print(table.markdown(), end="\n\n")


if __name__ == "__main__":
    main()
