"""Time condyn_pin and its peers on the same states; write results/peers.{json,md} and docs.

    python benchmarks/peers/run.py [--quick] [--passes 5] [--only mujoco] [--folder build/peers]

With --from-json the tables are made from the committed results, without running anything.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))

import marks  # noqa: E402

from peers.environments import ENVIRONMENTS, LEFT_OUT, Environment, Missing, last_line  # noqa: E402
from peers.table import TARGETS, PeerTable, gather, load  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results"
TIME_LIMIT = 600  # [s] for one script
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def run_script(
    python: Path, script: str, scenes: Sequence[Path], output: Path, effort: float
) -> dict[str, Any]:
    """Return what a peer's script measured.

    Raises
    ------
    Missing
        If it fails, crashes, or does not end.
    """
    command = [str(python), "-m", f"peers.{script}", *map(str, scenes)]
    command += ["--output", str(output), "--effort", str(effort)]
    paths = os.pathsep.join([str(HERE.parent), str(ROOT)])
    try:
        done = subprocess.run(
            command,
            env={**os.environ, **ONE_THREAD, "PYTHONPATH": paths},
            cwd=output.parent,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
        )
    except subprocess.TimeoutExpired:
        raise Missing(f"did not end within {TIME_LIMIT} s") from None
    if done.returncode < 0:
        raise Missing(f"crashes with {signal.Signals(-done.returncode).name}")
    if done.returncode:
        raise Missing(f"fails: {last_line(done.stderr)}")
    result: dict[str, Any] = json.loads(output.read_text(encoding="utf-8"))
    return result


def measure(
    environments: Sequence[Environment], folder: Path, passes: int, effort: float
) -> PeerTable:
    """Make environments, export scenes, and pass over all peers several times, or until Ctrl-C."""
    from condyn_pin._core.timing import machine
    from peers import export

    folder.mkdir(parents=True, exist_ok=True)
    skipped = dict(LEFT_OUT)
    scenes = [
        export.export_scene(folder / "scenes", name, scene)
        for name, scene in export.scenes().items()
    ]
    jobs = []
    for environment in environments:
        print(f"{environment.name}: {', '.join(environment.requirements)}", flush=True)
        try:
            python = environment.make(folder)
            jobs += [(environment.name, python, script) for script in environment.scripts]
        except Missing as missing:
            skipped[environment.name] = str(missing)
    gathered: list[list[dict[str, Any]]] = []
    try:
        for number in range(passes):
            results = []
            for name, python, script in jobs:
                print(f"pass {number + 1} of {passes}: {script} in {name}", flush=True)
                output = folder / f"{name}-{script}.json"
                try:
                    results.append(run_script(python, script, scenes, output, effort))
                except Missing as missing:
                    skipped[f"{script} in {name}"] = str(missing)
            gathered.append(results)
    except KeyboardInterrupt:
        if not gathered:
            raise
        print(f"stopped; whole passes are kept: {len(gathered)}", flush=True)
    return PeerTable(gather(gathered), machine(), skipped, len(gathered), export.STATES)


def pages(table: PeerTable) -> dict[str, dict[str, str]]:
    """Return the blocks of the docs: the first error that is asked for, and every one."""
    first = {quantity: targets[:1] for quantity, targets in TARGETS.items()}
    return {
        marks.SIMULATORS: {"peers": table.at_equal_error(first)},
        marks.RESULTS: {"peers": table.at_equal_error()},
    }


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one pass with few rounds")
    parser.add_argument("--passes", type=int, default=5, help="passes over all peers")
    parser.add_argument("--only", nargs="+", help="names of environments")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "peers")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    if arguments.from_json:
        table = load(RESULTS / "peers.json")
    else:
        only = arguments.only or [environment.name for environment in ENVIRONMENTS]
        # the reference is always there
        chosen = [e for e in ENVIRONMENTS if e.name in only or e is ENVIRONMENTS[0]]
        passes, effort = (1, 0.1) if arguments.quick else (arguments.passes, 1.0)
        table = measure(chosen, arguments.folder.resolve(), passes, effort)
    if arguments.quick or arguments.only:
        print(table.to_markdown())
        return
    table.to_json(RESULTS / "peers.json")
    (RESULTS / "peers.md").write_text(table.to_markdown(), encoding="utf-8")
    marks.write(pages(table))
    print(table.at_equal_error())


if __name__ == "__main__":
    main()
