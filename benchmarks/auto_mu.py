"""Proximal's own mu against every mu by hand; write results/auto_mu.{json,md}, docs.

    python benchmarks/auto_mu.py [--seeds 3] [--families mass_ratio,parallelogram] [--from-json]

Every case of `EXTREMES`, the robots' among them, is answered with mu = "auto" and with 1e-12 to 1,
in 1/kg and as a share of the largest eigenvalue of G, and with up to 20 iterations, 100, and two
refinements. The right answer is that of the stress test: in closed form, or by `Reference`; where
rows contradict each other, it is the a that comes nearest to all of them.

The error of a mu is that of the worst of three states. A mu is tuned for a machine and a posture,
not for one torque: where only rounding of G is left, eps cond(G), every mu over four decades has
the same error on average, and the best of 26 at one state is the luckiest.

An error counts as no worse if it is within 3 times the best, or below 1e-10, a hundredth of what ok
promises. Time is compared with that of the mu of fewest iterations whose error is no worse than
that of "auto" in this sense; both are measured in turn, at each of the states, and added up.
"""

from __future__ import annotations

import argparse
import json
import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import interleaved, machine
from lab.extremes.base import EXTREMES, Case
from lab.extremes.stress import Memory, make, tasks
from lab.extremes.verdicts import Task, error_of, right_answers

RESULTS = Path(__file__).resolve().parent / "results"
WEIGHTS = tuple(float(f"1e{k}") for k in range(-12, 1))
KNOBS: tuple[dict[str, int], ...] = ({}, {"max_iterations": 100}, {"refinements": 2})
WITHIN = 3.0
NOTHING = 1e-10  # an error below is as good as any

# What families of any scene are put on: without redundant rows but zeros, and with.
ROBOTS = ("four_bar", "cassie")

# Families that turn the parameters themselves, and those with numbers that no answer belongs to.
LEFT_OUT = ("weight", "few_iterations", "bad_q", "bad_v", "bad_tau")


Asked = list[tuple[cp.Proximal, cp.dynamics.Solution]]


@dataclass(frozen=True)
class Comparison:
    """One case with one set of other parameters.

    Attributes
    ----------
    task : Task
    parameters : dict
    independent : bool
        Whether no row depends on others.
    error, best : float
        Of a, relative, at the worst state: with "auto", and with the best mu.
    best_mu : float
        [1/kg], at the first state.
    status : str
        Of the answer with "auto" there.
    slower : float
        Time with "auto" over that of the fastest mu that is as good, of all states together; NaN
        where none is.
    """

    task: Task
    parameters: dict[str, int]
    independent: bool
    error: float
    best: float
    best_mu: float
    status: str
    slower: float

    @property
    def error_is_good(self) -> bool:
        """Whether no mu is better by more than is allowed."""
        return self.error <= WITHIN * max(self.best, NOTHING)

    @property
    def time_is_good(self) -> bool:
        """Whether no mu that is as good is faster by more than is allowed."""
        return not self.slower > WITHIN


def compare(
    task: Task, cases: Sequence[Case], parameters: dict[str, int], *, timed: bool
) -> Comparison | None:
    """Return "auto" against every mu on some cases; None where no method has an answer."""
    found = [(case, right) for case in cases if (right := right_answers(case)) and case.scene.rows]
    if not found:
        return None

    def ask(mu: float | None, share: bool = False) -> tuple[float, Asked]:
        """Return the worst error, and the solver and the answer of each case."""
        errors, asked = [], []
        for case, right in found:
            largest = case.scene.nominal.delassus_norm
            solver = cp.Proximal(mu=mu and mu * (largest if share else 1.0), **parameters)  # type: ignore[arg-type]
            workspace = cp.Workspace(case.scene, solver, drift=case.drift)
            solution = workspace.solve(case.q, case.v, case.tau, throw=False)
            errors.append(min(error_of(case, solution.a, a) for a in right))
            asked.append((solver, solution))
        return max(errors), asked

    error, auto = ask(None)
    by_hand = [ask(mu, share) for share in (False, True) for mu in WEIGHTS]
    best, tuned = min(by_hand, key=lambda one: one[0])
    as_good = [asked for other, asked in by_hand if other <= max(error, NOTHING)]
    slower = float("nan")
    if timed and as_good and np.isfinite(error):
        fewest = min(as_good, key=lambda asked: sum(each.iterations for _, each in asked))
        slower = times_slower([case for case, _ in found], auto, fewest)
    (_, solution), best_mu = auto[0], tuned[0][0].mu
    return Comparison(
        task, parameters, found[0][0].scene.nominal.independent, error, best, best_mu,  # type: ignore[arg-type]
        solution.status.name.lower(), slower,
    )  # fmt: skip


def times_slower(cases: Sequence[Case], auto: Asked, by_hand: Asked) -> float:
    """Return the time of one over that of the other, of all cases together."""
    took = {"auto": 0.0, "by hand": 0.0}
    for case, (one, _), (other, _) in zip(cases, auto, by_hand, strict=True):
        solvers = {"auto": one, "by hand": other}
        calls = {
            name: cp.Workspace(case.scene, solver, drift=case.drift).acceleration
            for name, solver in solvers.items()
        }
        times = interleaved(calls, [(case.q, case.v, case.tau)], rounds=20, repeats=3)
        took = {name: took[name] + times[name].median for name in took}
    return took["auto"] / took["by hand"]


def comparisons(
    todo: Sequence[Task], *, seeds: int = 1, timed: bool = True
) -> Iterator[Comparison]:
    """Yield all comparisons of some cases; those that are refused are left out."""
    memory = Memory()
    for task in todo:
        if task.family in LEFT_OUT:
            continue
        made = [make(replace(task, seed=task.seed + k), memory)[0] for k in range(seeds)]
        for parameters in KNOBS:
            try:
                found = compare(task, [case for case in made if case], parameters, timed=timed)
            except cp.CondynError:
                continue
            if found:
                yield found


def markdown(found: Sequence[Comparison], where: dict[str, Any]) -> str:
    """Return a line a family, and a line for each case that is worse."""
    lines = [
        f'{len(found)} comparisons of "auto" with {2 * len(WEIGHTS)} values of mu; '
        f"within {WITHIN:g} times: {sum(c.error_is_good for c in found)} in error, "
        f"{sum(c.time_is_good for c in found)} in time.",
        "",
        "| family | cases | error within 3 x | time within 3 x | slowest |",
        "|---|---|---|---|---|",
    ]
    for family in dict.fromkeys(c.task.family for c in found):
        own = [c for c in found if c.task.family == family]
        slowest = max((c.slower for c in own if c.slower > 0), default=float("nan"))
        lines.append(
            f"| {family} | {len(own)} | {sum(c.error_is_good for c in own)} "
            f"| {sum(c.time_is_good for c in own)} | {slowest:.1f} |"
        )
    lines += ["", "Where it is worse:", ""]
    lines += [
        f"- {c.task.family} {c.task.robot} {c.task.severity:g}, {c.parameters or 'defaults'}: "
        f"{c.error:.1e} ({c.status}) against {c.best:.1e} with {c.best_mu:.1e}; "
        f"time x {c.slower:.1f}"
        for c in found
        if not (c.error_is_good and c.time_is_good)
    ]
    text = "{processor}, {system}, Python {python}, Pinocchio {pinocchio}, {date}."
    return "\n".join([*lines, "", text.format(**where), ""])


def _numbers(each: Comparison) -> dict[str, Any]:
    """Return a comparison for JSON, which has no NaN and no infinity."""
    found = asdict(each)
    return {k: None if isinstance(x, float) and not np.isfinite(x) else x for k, x in found.items()}


def load(path: Path) -> tuple[list[Comparison], dict[str, Any]]:
    """Return the comparisons of a file, and what they ran on."""
    report = json.loads(path.read_text(encoding="utf-8"))
    nan = float("nan")
    found = [
        Comparison(
            **{k: nan if x is None else x for k, x in each.items()} | {"task": Task(**each["task"])}
        )
        for each in report["comparisons"]
    ]
    return found, report["machine"]


def pages(found: Sequence[Comparison], where: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the sentence of the page on solvers."""
    families = len({c.task.family for c in found})
    errors, times = sum(c.error_is_good for c in found), sum(c.time_is_good for c in found)
    said = (
        "`Proximal` chooses its mu itself. Compared with the best of "
        f"{2 * len(WEIGHTS)} values set by hand, on {families} families of hard cases,\n"
        f"its error is at most {WITHIN:g} times as large in {errors} of {len(found)} comparisons "
        f"(errors below {NOTHING:g} count as equal), its time at most {WITHIN:g} times\n"
        f"as long in {times} "
        "(`benchmarks/auto_mu.py` on {processor}, {system}, Python {python}, Pinocchio "
        "{pinocchio}, {date})."
    )
    return {marks.SOLVERS: {"auto_mu": said.format(**where)}}


def main() -> None:
    """Compare, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="states of a case")
    parser.add_argument("--families", default="", help="some of EXTREMES, separated by commas")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    if arguments.from_json:
        marks.write(pages(*load(RESULTS / "auto_mu.json")))
        return
    families = [name for name in arguments.families.split(",") if name] or list(EXTREMES)
    warnings.simplefilter("ignore")
    found: list[Comparison] = []
    for family in families:
        found += comparisons(tasks([family], robots=ROBOTS), seeds=arguments.seeds)
        report = {"machine": machine(), "comparisons": [_numbers(each) for each in found]}
        text = json.dumps(report, indent=0) + "\n"
        (RESULTS / "auto_mu.json").write_text(text, encoding="utf-8")
        (RESULTS / "auto_mu.md").write_text(markdown(found, machine()), encoding="utf-8")
    if not arguments.families:
        marks.write(pages(found, machine()))
    print(markdown(found, machine()))


if __name__ == "__main__":
    main()
