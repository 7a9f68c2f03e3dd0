"""Answers at states that leave loops a little open, against those of the closed machine.

    python benchmarks/noise.py errors [--quick]
    python benchmarks/noise.py promise 5000 [--seed 0] [machine ...]

errors: a state on the constraints is disturbed in q and v, as an encoder or a file with few digits
does. The right answer is that of the closed machine beside the disturbed state: its q is found by
Gauss-Newton steps, and its v by projection, both in the metric of M, with the rank that J has on
the constraints. All by dense singular values here, so that nothing is judged by itself. Errors are
relative to the larger of |a| and gravity; those of forces to the largest force.

promise: machines and states are drawn at random, for every solver, and answers are counted that are
ok and further from the closed machine's than three times what `Solution.closed` says, or by more
than a third.
"""

from __future__ import annotations

import json
import os
import sys
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
import script
from judges.machines import DRAWN, SHIPPED, Machine, of_family, peaucellier
from scipy.linalg import solve_triangular
from script import Printed, Table

import condyn_pin as cp

Array = np.ndarray
State = tuple[Array, Array, Array]  # q, v, tau

NOISES = tuple(10.0**k for k in range(-12, -1))
DIFFERENT = (1e-8, 1e-4)  # noises at which derivatives and solvers are measured
ROUNDING = 1e-10  # of singular values of J on the constraints, relative

# What counts as a wrong answer that is ok. Beside a dead point rounding of q alone changes a, by
# 1e-16 / sigma^3 for the smallest singular value sigma of J, relative to the largest.
TIMES, LEAST, MOST, ROUNDED = 3.0, 1e-8, 1 / 3, 1e-15


def _drawn(family: str, seed: int) -> Callable[[], Machine]:
    return lambda: of_family(family)(np.random.default_rng(seed))


MACHINES: dict[str, Callable[[], Machine]] = {
    **{name: lambda make=make: (make(), None) for name, make in SHIPPED.items()},
    "Bennett": _drawn("bennett", 1),
    "Sarrus": _drawn("sarrus", 3),
    "spherical four-bar": _drawn("spherical", 2),
    "guide and crank": _drawn("guided", 1),
    "Peaucellier": lambda: peaucellier("planar"),
}


class Closed(NamedTuple):
    """The machine that is closed beside a state, and its answer."""

    q: Array
    v: Array
    a: Array
    lam: Array
    moved: float  # the last step of Gauss and Newton


class Judge:
    """Dense algebra of a machine at the rank that it has on its constraints."""

    def __init__(self, scene: cp.Scene, q: Array) -> None:
        self.equations = cp.Workspace(scene, cp.dynamics.Reference()).equations
        self.model = scene.robot.model
        self.gravity = float(np.linalg.norm(self.model.gravity.linear))
        S = self._whitened(q)[2]
        self.rank = int(np.count_nonzero(ROUNDING * S[0] < S))

    def _whitened(self, q: Array) -> tuple[Array, Array, Array, Array]:
        """Return L of M = L L^T, and J L^-T = U S V^T."""
        L = np.linalg.cholesky(self.equations.mass(q))
        J = self.equations.jacobian(q)
        return L, *np.linalg.svd(solve_triangular(L, J.T, lower=True).T, full_matrices=False)

    def _least(self, q: Array, s: Array) -> Array:
        """Return the least d with J d = s, at the known rank."""
        L, U, S, Vt = self._whitened(q)
        r = self.rank
        return solve_triangular(L.T, Vt[:r].T @ (U[:, :r].T @ s / S[:r]))

    def closed(self, q: Array, v: Array, tau: Array) -> Closed:
        """Return the closed machine beside a state."""
        step, before = 0.0, np.inf
        c, rate = self.equations.gaps(q, v)
        if np.abs(c).max() <= 1e-13 and np.abs(rate).max() <= 1e-11:  # closed to rounding
            return Closed(q, v, *self.answer(q, v, tau), step)
        for _ in range(25):
            d = self._least(q, self.equations.violation(q))
            q, step = pin.integrate(self.model, q, -d), float(np.abs(d).max())
            if step < 1e-15 or 1e-12 > step >= before:
                break
            before = step
        rate = self.equations.jacobian(q) @ v - self.equations.wanted[1]
        v = v - self._least(q, rate)
        return Closed(q, v, *self.answer(q, v, tau), step)

    def answer(self, q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
        """Return a, and the smallest lam, of the rows that count."""
        terms = self.equations.terms(q, v)
        L, U, S, Vt = self._whitened(q)
        U, S, V = U[:, : self.rank], S[: self.rank], Vt[: self.rank].T
        free = solve_triangular(L, tau - terms.h, lower=True)
        x = free - V @ (V.T @ free) + V @ (U.T @ (terms.a_ref - terms.gamma) / S)
        return solve_triangular(L.T, x), U @ (V.T @ (x - free) / S)

    def smallest(self, q: Array) -> float:
        """Return the smallest singular value that counts, relative to the largest."""
        S = self._whitened(q)[2]
        return float(S[self.rank - 1] / S[0])

    def size(self, a: Array) -> float:
        """Return what errors of a are relative to."""
        return max(float(np.abs(a).max()), self.gravity)

    def off(self, a: Array, right: Array) -> float:
        """Return the error of a."""
        return float(np.abs(a - right).max()) / self.size(right)

    def disturbed(self, state: State, rng: np.random.Generator, q: float, v: float) -> State:
        """Return a state whose q and v are off by noise [rad, m; rad/s, m/s]."""
        nv = self.model.nv
        moved = pin.integrate(self.model, state[0], q * rng.normal(size=nv))
        return moved, state[1] + v * rng.normal(size=nv), state[2]


class Subject(NamedTuple):
    """A machine that is measured."""

    name: str
    scene: cp.Scene
    judge: Judge
    states: list[State]

    @classmethod
    def of(cls, name: str, count: int) -> Subject:
        """Return a machine with some closed states."""
        rng = np.random.default_rng(0)
        scene, q = MACHINES[name]()
        judge = Judge(scene, scene.sample(rng)[0] if q is None else q)
        nv, states = scene.robot.nv, []
        for _ in range(count):
            start = scene.sample(rng)[0] if q is None else q
            found = judge.closed(start, rng.normal(size=nv), tau := rng.normal(size=nv))
            states.append((found.q, found.v, tau))
        return cls(name, scene, judge, states)


def relative(lam: Array, right: Array) -> float:
    """Return the error of forces, relative to the largest."""
    return float(np.abs(lam - right).max(initial=0.0) / max(np.abs(right).max(initial=0.0), 1e-9))


def over_noise(subject: Subject) -> list[dict[str, Any]]:
    """Return the worst errors by noise: as it is, and if every row counts."""
    robot, found = subject.scene.robot, []
    exact = cp.Scene(cp.model.Robot(**_fields(robot), precision=0.0), subject.scene.constraints)
    for noise in NOISES:
        rng, a, lam, before, ok = np.random.default_rng(1), 0.0, 0.0, 0.0, 0
        for state in subject.states:
            noisy = subject.judge.disturbed(state, rng, noise, noise)
            right = subject.judge.closed(*noisy)
            answer = cp.solve(subject.scene, *noisy, throw=False)
            a = max(a, subject.judge.off(answer.a, right.a))
            lam, ok = max(lam, relative(answer.lam, right.lam)), ok + answer.status.ok
            plain = cp.solve(exact, *noisy, throw=False).a
            before = max(before, subject.judge.off(plain, right.a))
        found.append(
            {"machine": subject.name, "rows": subject.scene.rows, "rank": subject.judge.rank}
            | {"noise": noise, "states": len(subject.states), "ok": ok, "a": a, "lam": lam}
            | {"all_rows": before}
        )
    return found


def _fields(robot: cp.Robot) -> dict[str, Any]:
    from dataclasses import fields

    return {f.name: getattr(robot, f.name) for f in fields(robot) if f.name != "precision"}


def of_derivatives(subject: Subject) -> dict[str, float]:
    """Return the worst error of da_dq by noise, relative to its largest entry."""
    found = {}
    for noise in DIFFERENT:
        rng, worst = np.random.default_rng(2), 0.0
        for state in subject.states[:5]:
            noisy = subject.judge.disturbed(state, rng, noise, noise)
            right = subject.judge.closed(*noisy)
            wanted = cp.derivatives(subject.scene, right.q, right.v, noisy[2]).da_dq
            da_dq = cp.derivatives(subject.scene, *noisy).da_dq
            worst = max(worst, float(np.abs(da_dq - wanted).max() / np.abs(wanted).max()))
        found[f"{noise:g}"] = worst
    return found


def of_solvers(subjects: Sequence[Subject]) -> list[dict[str, Any]]:
    """Return the worst error of a by solver, over the machines that it takes."""
    found = []
    for kind in cp.dynamics.SOLVERS.values():
        for noise in DIFFERENT:
            row: Counter[str] = Counter()
            worst = 0.0
            for subject in subjects:
                rng = np.random.default_rng(3)
                for state in subject.states[:5]:
                    noisy = subject.judge.disturbed(state, rng, noise, noise)
                    try:
                        answer = cp.solve(subject.scene, *noisy, solver=kind(), throw=False)
                    except cp.CondynError:
                        row["refused"] += 1
                        continue
                    row["states"] += 1
                    if answer.status.ok:
                        row["ok"] += 1
                        right = subject.judge.closed(*noisy)
                        worst = max(worst, subject.judge.off(answer.a, right.a))
            counts = {name: row[name] for name in ("states", "ok", "refused")}
            found.append({"solver": kind.title, "noise": noise, "a": worst, **counts})
    return found


def _off(noise: float) -> str:
    return f"{_power(noise)} rad and rad/s"


def must(count: int) -> list[dict[str, Any]]:
    """Return the worst errors over states that come from files and sensors."""
    rows = [("Cassie", "a file in float32", None, None)]
    rows += [("Cassie", _off(noise), noise, noise) for noise in (1e-4, 1e-3)]
    for name in ("Bricard", "Bennett", "Delta", "Stewart with hinges"):
        rows += [(name, _off(noise), noise, noise) for noise in (1e-8, 1e-4)]
    rows += [("Talos on eight points", "0.1 rad/s", 0.0, 0.1)]
    subjects: dict[str, Subject] = {}
    found = []
    for name, what, q_noise, v_noise in rows:
        subject = subjects.setdefault(name, Subject.of(name, count))
        rng, judge = np.random.default_rng(4), subject.judge
        a, lam, smallest, ok, doubt = 0.0, 0.0, 0.0, 0, 0.0
        for state in subject.states:
            if q_noise is None or v_noise is None:
                noisy = *(x.astype(np.float32).astype(float) for x in state[:2]), state[2]
            else:
                noisy = judge.disturbed(state, rng, q_noise, v_noise)
            right, answer = judge.closed(*noisy), cp.solve(subject.scene, *noisy, throw=False)
            a, lam = max(a, judge.off(answer.a, right.a)), max(lam, relative(answer.lam, right.lam))
            ok, doubt = ok + answer.status.ok, max(doubt, answer.doubt)
            if q_noise == 0.0:  # the smallest forces of the state as it is
                smallest = max(smallest, relative(answer.lam, judge.answer(*noisy)[1]))
        found.append(
            {"machine": name, "state": what, "states": len(subject.states), "ok": ok}
            | {"a": a, "lam": lam, "smallest": smallest, "doubt": doubt}
        )
    return found


def errors(given: Namespace) -> script.Saved:
    """Measure everything."""
    about, count = script.measured_on(), 3 if given.quick else 20
    subjects = [Subject.of(name, count) for name in MACHINES]
    return {
        **about,
        "must": must(5 if given.quick else 100),
        "noise": [row for subject in subjects for row in over_noise(subject)],
        "derivatives": {subject.name: of_derivatives(subject) for subject in subjects},
        "solvers": of_solvers(subjects),
    }


# Tables and the figure


def _power(x: float) -> str:
    return f"{x:.0e}".replace("e-0", "e-").replace("e+0", "e") if x else "0"


def table(saved: Mapping[str, Any]) -> str:
    """Return the table of the page."""
    lines = [
        "| machine | state off by | ok | error of a | error of forces |",
        "|---|---|---|---|---|",
    ]
    for row in saved["must"]:
        forces = f"{_power(row['lam'])}"
        if row["smallest"]:
            forces += f"; {_power(row['smallest'])} from the smallest"
        lines.append(
            f"| {row['machine']} | {row['state']} | {row['ok']} of {row['states']} "
            f"| {_power(row['a'])} | {forces} |"
        )
    return "\n".join(lines)


def solver_table(saved: Mapping[str, Any]) -> str:
    """Return the errors of each solver at 1e-4, and of derivatives, for the eye."""
    lines = [
        f"{row['solver']:22s} {row['noise']:g}: ok {row['ok']} of {row['states']}, refused "
        f"{row['refused']}, a {_power(row['a'])}"
        for row in saved["solvers"]
    ]
    lines += [f"da_dq {name}: {found}" for name, found in saved["derivatives"].items()]
    return "\n".join(lines)


def draw(saved: Mapping[str, Any], path: Path) -> None:
    """Draw the error of a over noise, a line a machine."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    from condyn_pin._core.show import labelled_axes, line

    fig, ax = plt.subplots(figsize=(6.3, 4.4), layout="constrained")
    for i, name in enumerate(MACHINES):
        rows = [row for row in saved["noise"] if row["machine"] == name]
        noise = [row["noise"] for row in rows]
        all_rows = [row["all_rows"] for row in rows]
        ax.loglog(noise, all_rows, color="0.7", ls="--", lw=0.8, zorder=1)
        ax.loglog(noise, [max(row["a"], 1e-16) for row in rows], label=name, **line(i), zorder=2)
    ax.plot([], [], color="0.7", ls="--", lw=0.8, label="every row counts")
    labelled_axes(ax, title="", x="noise of q and v [rad, m; and per second]", y="worst error of a")
    ax.set_ylim(1e-16, 1e4)
    ax.legend(fontsize=6.5, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    fig.savefig(path, dpi=200)
    plt.close(fig)


# The promise


def promise(count: int, seed: int, names: Sequence[str]) -> Counter[str]:
    """Return counts of answers at random states of random machines; print those that are wrong."""
    rng, counts = np.random.default_rng(seed), Counter[str]()
    shipped: dict[str, tuple[cp.Scene, Judge]] = {}
    solvers = [kind() for name, kind in cp.dynamics.SOLVERS.items() if name != "soft"]
    while counts["states"] < count:
        name, draws = str(rng.choice(names)), int(rng.integers(2**31))
        one = np.random.default_rng(draws)
        try:
            if name in SHIPPED:
                if name not in shipped:
                    scene = SHIPPED[name]()
                    shipped[name] = scene, Judge(scene, scene.sample(one)[0])
                (scene, judge), q = shipped[name], shipped[name][0].sample(one)[0]
            else:
                scene, q = DRAWN[name](one)
                judge = Judge(scene, q)
        except cp.NotAssembled:
            counts["not drawn"] += 1
            continue
        for _ in range(16):
            state = int(rng.integers(2**31))
            said = _one(scene, judge, q, np.random.default_rng(state), solvers, name)
            counts["states"] += 1
            counts[said] += 1
            if said.startswith("wrong"):
                print(f"{said}: {name}, machine {draws}, state {state}", flush=True)
    return counts


def _one(
    scene: cp.Scene,
    judge: Judge,
    q: Array,
    rng: np.random.Generator,
    solvers: Sequence[cp.dynamics.Solver],
    name: str,
) -> str:
    """Return what an answer at one random state is."""
    nv = scene.robot.nv
    noise = [10.0 ** rng.uniform(-12, -2), 10.0 ** rng.uniform(-12, -1)]
    noise = [0.0 if rng.random() < 0.1 else size for size in noise]
    if name == "flat":  # no more than ten times the distance from the singular posture
        noise[0] = min(noise[0], 10.0 ** rng.uniform(-12, -1) * float(abs(q[0])))
    tau = rng.normal(size=nv)
    start = judge.closed(q, rng.normal(size=nv), tau)
    state = judge.disturbed((start.q, start.v, tau), rng, *noise)
    solver = None if rng.random() < 0.7 else solvers[int(rng.integers(len(solvers)))]
    try:
        found = cp.solve(scene, *state, solver=solver, throw=False)
    except cp.CondynError:
        return "refused"
    if not found.status.ok:
        return "not ok"
    right, closed = judge.closed(*state), found.closed()
    size = judge.size(right.a)
    off = float(np.abs(found.a - right.a).max())
    told = float(np.abs(found.a - closed.a).max())
    if off > MOST * size:
        return "wrong: by a third"
    allowed = LEAST + ROUNDED / judge.smallest(right.q) ** 3
    return "wrong: more than told" if off > TIMES * told + allowed * size else "right"


def promised(given: Namespace) -> int:
    """Print the counts; 1 if an answer is wrong."""
    counts = promise(given.count, given.seed, given.machines or [*SHIPPED, *DRAWN])
    print(json.dumps(counts, indent=1))
    return int(any(said.startswith("wrong") for said in counts))


def _promise_options(parser: ArgumentParser) -> None:
    parser.add_argument("count", type=int)
    parser.add_argument("machines", nargs="*")
    parser.add_argument("--seed", type=int, default=0)


SUBJECTS = [
    Table(
        "noise errors",
        "states that leave loops open, against the closed machine",
        errors,
        lambda saved: f"{table(saved)}\n{solver_table(saved)}",
        pages=lambda saved: {script.RESULTS_PAGE: {"noise": table(saved)}},
        beside=lambda saved: draw(saved, script.result("noise errors", ".png")),
        quick="five and three states; nothing is written",
    ),
    Printed("noise promise", "wrong answers that are ok, counted", promised, _promise_options),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
