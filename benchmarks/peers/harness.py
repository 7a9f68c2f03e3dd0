"""The clock that all peers share: interleaved, in one thread, medians over rounds.

A peer's script says what it can do with a scene::

    def candidates(scene: Exported) -> list[Candidate]: ...

    if __name__ == "__main__":
        main("MuJoCo", mujoco.__version__, candidates)

1. `call(i)` does the whole job at state i, from numpy arrays in memory to the answer in memory. It
   sets the state: a user's state changes from call to call.
2. `answer(i)` does the same and returns the answer in Pinocchio's coordinates. It is not timed.
3. Memory, models and options are made once, before.
4. Bare Pinocchio is timed in the same rounds, wherever it can be imported: the reference.
5. A round takes one sample of every candidate, in an order that turns. A sample is the mean of a
   sweep over the states, or of as many sweeps as fit into a millisecond: nothing is warm-started
   from its own answer.
6. The clock counts the processor's time of the process and all its threads: what others do on the
   machine is not in it, and a second thread is.
7. Before each sample a vector product is taken: some libraries leave the processor's AVX registers
   in a state that slows down the next one's SSE code.
"""

from __future__ import annotations

import argparse
import gc
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from peers.exported import MOTION, Exported, load

SAMPLE = 1e-3  # [s]
MOST_SWEEPS = 3
ROUNDS = {"acceleration": 100, "derivatives": 25, "motion": 8}
REFERENCES = {  # what a time is divided by
    "acceleration": "constraintDynamics, settings of condyn_pin",
    "derivatives": "constraintDynamics + computeConstraintDynamicsDerivatives",
    "motion": "constraintDynamics, settings of condyn_pin",
}


@dataclass(frozen=True)
class Candidate:
    """One way to compute one quantity.

    Parameters
    ----------
    quantity : str
        ACCELERATION, DERIVATIVES or MOTION.
    method : str
        With every parameter that matters.
    call, answer : callable
        Rules 1 and 2.
    note : str
        What this computes that others do not, or the other way round.
    peer : str
        Whose it is; by default that of the script.
    """

    quantity: str
    method: str
    call: Callable[[int], object]
    answer: Callable[[int], Any]
    note: str = ""
    peer: str = ""


def samples(scene: Exported, found: Sequence[Candidate], rounds: int) -> list[list[float]]:
    """Return times a call [us], a list of samples for each candidate."""
    sweeps = [_sweep(scene, candidate) for candidate in found]
    times: list[list[float]] = [[] for _ in found]
    vector = np.ones(64)
    collecting = gc.isenabled()
    gc.disable()
    try:
        for r in range(rounds):
            for k in np.roll(np.arange(len(found)), r):
                call, states = found[k].call, sweeps[k]
                vector @ vector
                call(states[-1])  # the first call after another candidate finds cold caches
                start = process_time()
                for i in states:
                    call(i)
                times[k].append(1e6 * (process_time() - start) / len(states))
    finally:
        if collecting:
            gc.enable()
    return times


def _sweep(scene: Exported, candidate: Candidate) -> list[int]:
    """Return the states of a sample, from a sweep that also warms up."""
    states = list(range(1 if candidate.quantity == MOTION else scene.count))
    start = process_time()
    for i in states:
        candidate.call(i)
    return states * int(np.clip(SAMPLE / (process_time() - start), 1, MOST_SWEEPS))


def measure(scene: Exported, found: Sequence[Candidate], effort: float) -> list[dict[str, Any]]:
    """Return a row for each candidate: times [us] and errors; a motion's times are per ms of it."""
    rows = []
    for quantity, rounds in ROUNDS.items():
        group = [candidate for candidate in found if candidate.quantity == quantity]
        if not group:
            continue
        references = [c for c in found if c.method == REFERENCES[quantity] and c not in group]
        together = [*group, *references]
        timed = samples(scene, together, max(3, int(effort * rounds)))
        errors = [_errors(scene, candidate) for candidate in group]
        methods = [candidate.method for candidate in together]
        bare = timed[methods.index(REFERENCES[quantity])] if REFERENCES[quantity] in methods else 0
        per = 1e3 * scene.duration if quantity == MOTION else 1.0
        for candidate, times, error in zip(group, timed[: len(group)], errors, strict=True):
            scaled = np.array(times) / per
            rows.append(
                {
                    "scene": scene.name,
                    "quantity": quantity,
                    "peer": candidate.peer,
                    "method": candidate.method,
                    "note": candidate.note,
                    "median_us": float(np.median(scaled)),
                    "min_us": float(scaled.min()),
                    "p95_us": float(np.percentile(scaled, 95)),
                    "bare_min_us": float(np.min(bare)) if bare else None,
                    "error_median": float(np.median(error)),
                    "error_worst": float(np.max(error)),
                }
            )
    return rows


def _errors(scene: Exported, candidate: Candidate) -> list[float]:
    states = range(1 if candidate.quantity == MOTION else scene.count)
    return [scene.error(candidate.quantity, i, candidate.answer(i)) for i in states]


def bare_pinocchio(scene: Exported) -> list[Candidate]:
    """Return the references, if Pinocchio is here."""
    try:
        from peers.bare import references
    except ImportError:
        return []
    return references(scene)


def main(peer: str, version: str, candidates: Callable[[Exported], list[Candidate]]) -> None:
    """Measure one peer on exported scenes: ``script FOLDER... --output FILE``."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--effort", type=float, default=1.0, help="share of the usual rounds")
    arguments = parser.parse_args()
    rows, pinocchio = [], ""
    for folder in arguments.folders:
        scene = load(folder)
        reference = bare_pinocchio(scene)
        if reference:
            import pinocchio as pin

            pinocchio = pin.__version__
        for row in measure(scene, [*reference, *candidates(scene)], arguments.effort):
            row["version"] = version if not row["peer"] else pinocchio
            row["peer"] = row["peer"] or peer
            rows.append(row)
    result = {"peer": peer, "version": version, "pinocchio": pinocchio, "rows": rows}
    arguments.output.write_text(json.dumps(result), encoding="utf-8")
