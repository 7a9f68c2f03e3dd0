"""Compare `crocoddyl_action` with crocoddyl, in an environment where both can be imported.

    python benchmarks/crocoddyl_action.py [--folder build/peers]

The environment is made in the folder, and kept; `peers/with_crocoddyl_action.py` says what is
compared there, and fails where something does not hold.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from peers.environments import CONDYN_ALONE, Environment

ROOT = Path(__file__).resolve().parent.parent
# crocoddyl's loaders ask for descriptions before 6: condyn_pin is not installed, but on the path
ENVIRONMENT = Environment(
    "crocoddyl_action",
    ("crocoddyl==3.2.1", "pin==4.0.0", "libpinocchio==4.0.0", *CONDYN_ALONE),
    ("with_crocoddyl_action",),
)


def main() -> int:
    """Run the comparison, and return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "peers")
    folder = parser.parse_args().folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    python = ENVIRONMENT.make(folder)
    paths = os.pathsep.join([str(ROOT / "benchmarks"), str(ROOT)])
    return subprocess.run(
        [str(python), "-m", f"peers.{ENVIRONMENT.scripts[0]}"],
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": paths},
        cwd=folder,
    ).returncode


if __name__ == "__main__":
    sys.exit(main())
