"""The clock that all peers share in contact: one thread, MuJoCo's default beside every run.

A peer's script says in which ways it can step through a scene::

    def ways(scene: ContactScene) -> list[Way]: ...

    if __name__ == "__main__":
        main("MuJoCo", mujoco.__version__, ways)

1. `play()` starts anew, steps to the end, and returns where the bodies were, and the processor time
   that the steps took: of the process and all its threads.
2. Models, options and memory are made once, before.
3. The reference is `mj_step` with MuJoCo's defaults and dt = 1 ms, through the same scene, in the
   same process, before each run. A ratio is of least times a step.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from peers.contact.scene import ContactScene, load

Played = tuple[np.ndarray, float]  # (times, bodies, 3) [m], and [s]

RUNS = 3
LONG = 2.0  # runs that take longer are not repeated [s]


@dataclass(frozen=True)
class Way:
    """One way to step through a scene: a method, a step [s], and rule 1."""

    method: str
    dt: float
    play: Callable[[], Played]


def played(
    scene: ContactScene,
    dt: float,
    advance: Callable[[int], object],
    centres: Callable[[], np.ndarray],
) -> Played:
    """Return what `Way.play` does, of an engine that `advance`s by steps and says its `centres`."""
    found, took = [], 0.0
    for count in scene.counts(dt):
        begun = process_time()
        advance(count)
        took += process_time() - begun
        found.append(centres())
    return np.array(found), took


def measure(scene: ContactScene, found: Sequence[Way]) -> list[dict[str, Any]]:
    """Return a row for each way: error [m], time for a step [us], and its ratio."""
    from peers.contact.with_mujoco import REFERENCE, way

    reference = way(scene, REFERENCE, 1e-3)
    rows = []
    for each in found:
        times, bare, positions = [], [], None
        while len(times) < RUNS and sum(times) < LONG:
            bare.append(reference.play()[1])
            positions, took = each.play()
            times.append(took)
        step = 1e6 * min(times) * each.dt / scene.duration
        rows.append(
            {
                "scene": scene.name,
                "method": each.method,
                "dt": each.dt,
                "error": scene.distance(positions),
                "step_us": step,
                "ratio": step / (1e6 * min(bare) * reference.dt / scene.duration),
            }
        )
    return rows


def main(peer: str, version: str, ways: Callable[[ContactScene], list[Way]]) -> None:
    """Measure one peer on exported scenes: ``script FOLDER... --output FILE``."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--effort", type=float, default=1.0, help="below 1: steps of 2 ms only")
    given = parser.parse_args()
    rows = []
    for folder in given.folders:
        scene = load(folder)
        found = [way for way in ways(scene) if given.effort >= 1 or way.dt == 2e-3]
        about = {"peer": peer, "version": version}
        rows += [about | row for row in measure(scene, found)]
    result = {"peer": peer, "version": version, "rows": rows}
    given.output.write_text(json.dumps(result), encoding="utf-8")
