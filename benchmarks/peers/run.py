"""Time condyn_pin and its peers on the same states.

    python benchmarks/peers/run.py [--quick] [--passes 5] [--only mujoco] [--folder build/peers]

`results/peers.json` and `peers.md` have every row; the docs the fastest way of each to an error.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))

import script  # noqa: E402
from script import Table  # noqa: E402

from peers.environments import ENVIRONMENTS, LEFT_OUT, Environment, Missing, last_line  # noqa: E402
from peers.table import TARGETS, PeerTable, gather, load  # noqa: E402

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


def pages(table: PeerTable) -> script.Pages:
    """Return the blocks of the docs: the first error that is asked for, and every one."""
    first = {quantity: targets[:1] for quantity, targets in TARGETS.items()}
    return {
        script.SIMULATORS_PAGE: {"peers": table.at_equal_error(first)},
        script.RESULTS_PAGE: {"peers": table.at_equal_error()},
    }


def run(given: Namespace) -> PeerTable:
    """Measure the environments that are asked for; the reference is always there."""
    only = given.only or [environment.name for environment in ENVIRONMENTS]
    chosen = [e for e in ENVIRONMENTS if e.name in only or e is ENVIRONMENTS[0]]
    passes, effort = (1, 0.1) if given.quick else (given.passes, 1.0)
    return measure(chosen, given.folder.resolve(), passes, effort)


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("--passes", type=int, default=5, help="passes over all peers")
    parser.add_argument("--only", nargs="+", help="names of environments; nothing is written")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "peers")


SUBJECTS = [
    Table(
        "peers",
        "MuJoCo, Drake, Crocoddyl, exudyn beside us",
        run,
        PeerTable.to_markdown,
        pages=pages,
        beside=lambda table: script.write(script.result("peers", ".md"), table.to_markdown()),
        quick="one pass with few rounds; nothing is written",
        options=_options,
        draft=("quick", "only"),
        read=load,
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
