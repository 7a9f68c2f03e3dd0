"""The clock that controllers share: Pinocchio's ABA beside every tick, in one thread.

A peer's script says what it does with a question::

    def contender(question: Question) -> Contender: ...

    if __name__ == "__main__":
        main("tsid", version, contender)

1. `tick(i)` is one whole tick at state i, as a user writes it: it sets the state, computes terms,
   solves, and has torques in numpy. It returns the seconds that its solver took, NaN if the
   library does not let that be told apart.
2. `answer(i)` does the same and returns a, tau of all joints, and the feet's wrenches as they act
   on the joints, J^T f (nv,). It is not timed.
3. A round is all states in order, as under a controller: what a library keeps from the last tick,
   it may use. Between two states of a peer ABA is called at the same ones, interleaved.
4. Times are wall-clock times of one call; of each the least and the median over all rounds.
5. Of further questions each is asked once, at its first state, where inequalities are active: the
   objective of the tasks is that of the answer, by this environment's own Pinocchio. A question
   whose mass has to move with infinite weight may have no answer: a peer that has none says why,
   in the ValueError that `answer` raises.
6. Errors are of the equations of motion, by Newton-Euler in this environment's own Pinocchio, of
   the feet, which are not to accelerate, and of the centre of mass: how far from what is wanted.
"""

from __future__ import annotations

import argparse
import gc
import json
import multiprocessing
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin

from peers.control.question import Question, load

ROUNDS = 15
LONGEST = 20.0  # [s] of one question where inequalities are active


@dataclass(frozen=True)
class Contender:
    """One library at work on the question: rules 1 and 2, and the size of its program."""

    tick: Callable[[int], float]
    answer: Callable[[int], tuple[np.ndarray, np.ndarray, np.ndarray]]
    size: str
    note: str = ""


def model_of(question: Question) -> Any:
    """Return the robot in this environment's Pinocchio."""
    model = pin.buildModelFromUrdf(question.urdf, pin.JointModelFreeFlyer())
    model.armature = question.armature
    return model


def timed(question: Question, found: Contender, rounds: int) -> dict[str, float]:
    """Return the times of a tick, of its solver and of ABA [us], the least and the median."""
    model = model_of(question)
    data, still = model.createData(), np.zeros(model.nv)
    times: dict[str, list[float]] = {"tick": [], "program": [], "aba": []}
    states = range(len(question.q))
    gc.collect()
    gc.disable()
    try:
        for number in range(rounds + 1):
            for i in states:
                q, v = question.q[i], question.v[i]
                pin.aba(model, data, q, v, still)  # warm
                start = perf_counter()
                pin.aba(model, data, q, v, still)
                between = perf_counter()
                program = found.tick(i)
                end = perf_counter()
                if number:  # the first round warms up
                    times["aba"].append(between - start)
                    times["tick"].append(end - between)
                    times["program"].append(program)
    finally:
        gc.enable()
    found_times = {}
    for name, values in times.items():
        each = 1e6 * np.array(values).reshape(rounds, -1)
        # of each state the least over the rounds: what else runs on a machine only adds
        found_times[f"{name}_min_us"] = float(np.mean(each.min(axis=0)))
        found_times[f"{name}_median_us"] = float(np.median(each))
    return found_times


def errors(question: Question, found: Contender) -> dict[str, float]:
    """Return the worst errors over the states: of the motion, of the feet, of the mass."""
    model, wish = model_of(question), question.wish
    data = model.createData()
    worst = {"dynamics": 0.0, "feet": 0.0, "com": 0.0, "torque": 0.0}
    for i in range(len(question.q)):
        q, v = question.q[i], question.v[i]
        a, tau, felt = found.answer(i)
        left = pin.rnea(model, data, q, v, a) - tau - felt
        worst["dynamics"] = max(worst["dynamics"], float(np.abs(left).max()))
        pin.forwardKinematics(model, data, q, v, a)
        for foot in question.feet:
            frame = model.getFrameId(foot)
            slips = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).vector
            worst["feet"] = max(worst["feet"], float(np.abs(slips).max()))
        pin.centerOfMass(model, data, q, v, a)
        c, velocity = np.array(data.com[0]), np.array(data.vcom[0])
        wanted = wish.com_kp * (question.com - c) - 2 * np.sqrt(wish.com_kp) * velocity
        worst["com"] = max(worst["com"], float(np.abs(np.array(data.acom[0]) - wanted).max()))
        worst["torque"] = max(worst["torque"], float(np.abs(tau[6:]).max()))
    return worst


def judged(question: Question, contender: Callable[[Question], Contender]) -> dict[str, Any]:
    """Return the objective of an answer at rest in the posture, what is active, and its errors.

    sum w |J a - wanted|^2 of mass, trunk and joints, without what regularises
    """
    found = contender(question)
    try:
        a, tau, felt = found.answer(0)
    except ValueError as why:
        return {"title": question.title, "answer": str(why).split(": ", 1)[-1]}
    model, wish, q = model_of(question), question.wish, question.q[0]
    data, v = model.createData(), question.v[0]
    left = float(np.abs(pin.rnea(model, data, q, v, a) - tau - felt).max())
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    trunk = model.getFrameId(question.trunk)
    turns = pin.getFrameClassicalAcceleration(model, data, trunk, pin.LOCAL_WORLD_ALIGNED).angular
    pin.centerOfMass(model, data, q, v, a)
    wanted = wish.com_kp * (question.com - np.array(data.com[0]))
    off = float(((np.array(data.acom[0]) - wanted) ** 2).sum())
    objective = 0.0 if np.isinf(wish.com_weight) else wish.com_weight * off
    objective += wish.trunk_weight * float(turns @ turns)
    objective += wish.posture_weight * float(a[6:] @ a[6:])
    spent = np.abs(tau[6:]) / question.effort[6:]
    return {
        "title": question.title, "answer": "ok", "objective": objective, "com": float(np.sqrt(off)),
        "dynamics": left, "torque": float(spent.max()),
        "motors": int(np.count_nonzero(spent > 1 - 1e-6)),
    }  # fmt: skip


def within_time(question: Question, contender: Callable[[Question], Contender]) -> dict[str, Any]:
    """Return what `judged` does, in a process of its own: not every solver ends."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    asked = context.Process(target=lambda: there.send(judged(question, contender)))
    asked.start()
    if here.poll(LONGEST):
        row: dict[str, Any] = here.recv()
    else:
        asked.kill()
        row = {"title": question.title, "answer": f"does not end within {LONGEST:g} s"}
    asked.join()
    return row


def main(peer: str, version: str, contender: Callable[[Question], Contender]) -> None:
    """Measure one library: ``script QUESTION [ACTIVE ...] --output FILE``."""
    parser = argparse.ArgumentParser()
    parser.add_argument("questions", nargs="+", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--effort", type=float, default=1.0, help="share of the usual rounds")
    arguments = parser.parse_args()
    question = load(arguments.questions[0])
    found = contender(question)
    rounds = max(3, int(arguments.effort * ROUNDS))
    row: dict[str, Any] = timed(question, found, rounds) | errors(question, found)
    row["active"] = [within_time(load(path), contender) for path in arguments.questions[1:]]
    about = {"peer": peer, "version": version, "pinocchio": pin.__version__}
    row |= about | {"size": found.size, "note": found.note}
    arguments.output.write_text(json.dumps(row), encoding="utf-8")
