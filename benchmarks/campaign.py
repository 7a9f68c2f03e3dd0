"""Random trees of every joint type with constraints of every kind, against an oracle of their own.

    python benchmarks/campaign.py --seeds 0:4000 [--parts /tmp/parts] [--derivatives 1]
    OPENBLAS_CORETYPE=Prescott python benchmarks/campaign.py --seeds 4000:8000
    python benchmarks/campaign.py --report          # results/campaign.json, .md and docs/results.md

Every seed is one problem (`campaign_problems`): a tree of up to ten joints, masses over up to eight
decades, up to four constraints and some of them twice, external forces, a state on the constraints.
Every exact solver answers it, and `derivatives` are taken by every method that takes them. The
oracle (`campaign_oracle`) knows positions only, in 64 bits of mantissa; of the library's rows, and
of Pinocchio's dynamics, nothing enters.

An answer is wrong if it says ok and a is off by more than it promises, 1e-8 of the larger of |a|
and gravity; derivatives, if they differ along the constraints by more than 1e-6 of the largest
entry, or of |a| / 1000; forces, if what they do to the joints, each at its point and in its axes,
is off by 1e-7 of what M does with that. Where `check=True` says that derivatives differ, by lam or
off the constraints, where the oracle does not look, it is listed: by the differences' own noise, or
not.

A seed's line in `parts` depends on the seed, the Pinocchio and the processor's kernel alone; seeds
that have one are not run again, so that a run may be cut at any time. The script ends with 1 if
anything was wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
from campaign_jets import Array
from campaign_oracle import Oracle, Solved, Undecided, generalised, solve
from campaign_problems import Problem, problem
from campaign_rows import rows

import condyn_pin as cp
from condyn_pin._core.tolerances import DERIVATIVES

RESULTS = Path(__file__).resolve().parent / "results"
PARTS = RESULTS.parent.parent / "build" / "campaign"
KERNEL = os.environ.get("OPENBLAS_CORETYPE", "default")
SOLVERS = [kind() for kind in cp.dynamics.SOLVERS.values() if kind.exact and not kind.missing()]
STEP = 1e-5  # of differences [rad, m, rad/s, m/s]
# Near a singular state rounding of the oracle's own differences is 1 / step of what it solves with:
# derivatives are right if they agree with those of one of these steps.
STEPS = (STEP, 1e-4, 1e-3)

# An acceleration below this is rounding: everything is held, and nothing weighs [rad/s^2, m/s^2].
_STILL = 1e-9

Line = dict[str, Any]


# --- one problem


class Right:
    """What the oracle says about one problem."""

    def __init__(self, p: Problem) -> None:
        self.p, self.model = p, p.scene.robot.model
        self.oracle = Oracle(self.model, p.q, p.v)
        self.J, gamma = rows(self.oracle, p.scene)
        self.pull = self._pull(self.oracle)
        x = p.tau + self.pull - self.oracle.h
        self.answer: Solved = solve(self.oracle.M, x, self.J, gamma)
        gravity = float(np.linalg.norm(self.model.gravity.linear))
        largest = max(float(np.abs(self.answer.a).max(initial=0.0)), gravity)
        self.scale = largest if largest > _STILL else 1.0
        M, torque = np.abs(self.oracle.M), np.abs(p.tau + self.pull)
        self.load = float((M.sum(axis=1) * self.scale + np.abs(self.oracle.h) + torque).max())
        # forces that balance to the last bit leave what their rounding moves
        inverse = solve(self.oracle.M, np.eye(self.model.nv), self.J[:0], gamma[:0]).a
        self.rounding = float(np.finfo(float).eps * (np.abs(inverse) @ torque).max())

    def error(self, a: Array) -> float:
        """Return that of a, relative to the larger of |a| and gravity, but for rounding."""
        off = float(np.abs(a - self.answer.a).max()) - self.rounding
        return max(off, 0.0) / self.scale

    def force_error(self, solution: cp.dynamics.Solution) -> float:
        """Return that of what the forces do to the joints, at their points and in their axes."""
        found = np.zeros(self.model.nv, dtype=np.longdouble)
        for name, force in solution.forces.items():
            constraint = self.p.scene.constraints[self.p.scene.names.index(name)]
            for one in (force, force.on_other()):
                if isinstance(constraint, cp.constraints.Coupling):
                    joint = self.model.joints[self.model.getJointId(one.on)]
                    found[joint.idx_v] += one[0]
                elif one.on != "world":
                    place = self.oracle.frame(one.on)
                    found += generalised(place, one.at, one.in_world(), self.model.nv)
        return float(np.abs(found - self.answer.force).max(initial=0.0) / self.load)

    def derivative(self, dq: Array, dv: Array, dtau: Array, step: float) -> Array:
        """Return the rate of a along a direction of the constraints, by differences."""

        def a(h: float) -> Array:
            q, v = pin.integrate(self.model, self.p.q, h * dq), self.p.v + h * dv
            oracle = Oracle(self.model, q, v)
            J, gamma = rows(oracle, self.p.scene)
            x = self.p.tau + h * dtau + self._pull(oracle) - oracle.h
            kept = self.answer.kept
            return solve(oracle.M, x, J[kept], gamma[kept]).a

        return (8 * (a(step) - a(-step)) - (a(2 * step) - a(-2 * step))) / (12 * step)

    def cancelled(self, dtau: Array) -> float:
        """Return what dtau would move were not everything held; nothing where something is free."""
        if np.shape(self.answer.free)[1]:
            return 0.0
        free = solve(self.oracle.M, dtau, self.J[:0], np.zeros(0)).a
        return float(np.abs(free).max(initial=0.0))

    def directions(self, rng: np.random.Generator) -> Iterator[tuple[Array, Array, Array]]:
        """Yield directions of (q, v, tau) along which c and J v stay zero to first order."""
        n = self.model.nv
        nothing, free = np.zeros(n), np.asarray(self.answer.free, dtype=float)
        dq, dv = (free @ rng.normal(size=free.shape[1]) for _ in range(2))
        yield nothing, nothing, np.sqrt(np.diag(self.oracle.M)).astype(float) * rng.normal(size=n)
        size = float(np.abs(dq).max(initial=0.0))
        if not size:
            return
        yield nothing, dv / np.abs(dv).max(), nothing
        dq = dq / size
        slips = []
        for h in (STEP, -STEP):
            oracle = Oracle(self.model, pin.integrate(self.model, self.p.q, h * dq), self.p.v)
            slips.append(rows(oracle, self.p.scene)[0] @ self.p.v)
        turned, kept = (slips[0] - slips[1]) / (2 * STEP), self.answer.kept
        back = solve(self.oracle.M, np.zeros(n), self.J[kept], turned[kept]).a
        yield dq, np.asarray(back, dtype=float), nothing

    def _pull(self, oracle: Oracle) -> Array:
        found = np.zeros(self.model.nv, dtype=np.longdouble)
        for name, force, of_body in self.p.forces:
            found = found + oracle.pull(name, force, of_body)
        return found


def line(seed: int, with_derivatives: bool) -> Line:
    """Return what became of one seed."""
    try:
        p = problem(seed)
        right = Right(p)
    except (cp.errors.InvalidModel, cp.errors.InvalidConstraint) as error:
        return {"seed": seed, "refused": f"{type(error).__name__}: {error}"}
    except Undecided as error:
        return {"seed": seed, "undecided": str(error)}
    found: Line = {
        "seed": seed,
        "rows": len(right.J),
        "rank": right.answer.rank,
        "smallest": right.answer.smallest,
        "joints": sorted({j.shortname() for j in right.model.joints[1:]}),
        "kinds": sorted({getattr(c, "kind", type(c).__name__) for c in p.scene.constraints}),
        "forces": len(p.forces),
        "solves": [_solved(p, right, solver) for solver in SOLVERS],
    }
    if with_derivatives:
        rng = np.random.default_rng([1, seed])
        along = [(d, cache(partial(right.derivative, *d))) for d in right.directions(rng)]
        found["derivatives"] = [_derived(p, right, m, along) for m in ("kkt", "pinocchio")]
    return found


def _asked(p: Problem) -> tuple[Array, dict[str, Any]]:
    """Return tau and the external forces as the library takes them."""
    if not p.forces:
        return p.tau, {}
    forces = [
        cp.AppliedForce(name, force, frame_of="body" if of_body else "world")
        for name, force, of_body in p.forces
    ]
    return p.tau, {"forces": forces}


def _solved(p: Problem, right: Right, solver: cp.dynamics.Solver) -> Line:
    found: Line = {"solver": type(solver).__name__}
    tau, forces = _asked(p)
    try:
        solution = cp.Workspace(p.scene, solver).solve(p.q, p.v, tau, throw=False, **forces)
    except (cp.errors.UnsupportedConstraint, cp.errors.UnsupportedBackend):
        return found | {"status": "untaken"}
    except Exception as error:  # what it is goes into the report
        return found | {"status": "raised", "said": f"{type(error).__name__}: {error}"[:200]}
    found["status"] = solution.status.name.lower()
    if solution.status.ok:
        found["error"], found["bound"] = right.error(solution.a), solution.error_bound
        found["force_error"] = right.force_error(solution)
    return found


def _derived(
    p: Problem, right: Right, method: str, along: Iterable[tuple[Any, Callable[[float], Array]]]
) -> Line:
    found: Line = {"method": method}
    tau, forces = _asked(p)
    try:
        workspace = cp.Workspace(p.scene)
        d = workspace.derivatives(p.q, p.v, tau, method=method, **forces)
    except (cp.errors.UnsupportedConstraint, cp.InvalidArgument):
        return found | {"status": "untaken"}
    except (cp.SolveFailed, cp.errors.DerivativesDisagree):
        return found | {"status": "no answer"}
    except Exception as error:  # what it is goes into the report
        return found | {"status": "raised", "said": f"{type(error).__name__}: {error}"[:200]}
    errors = []
    for (dq, dv, dtau), derivative in along:
        had = d.da_dq @ dq + d.da_dv @ dv + d.da_dtau @ dtau
        parts = [np.abs(b @ np.diag(x)).max() for b, x in
                 ((d.da_dq, dq), (d.da_dv, dv), (d.da_dtau, dtau))]  # fmt: skip
        least = max(*(float(x) for x in parts), right.scale / 1e3, right.cancelled(dtau))
        error = inf
        for wanted in map(derivative, STEPS):
            size = max(float(np.abs(wanted).max()), least)
            error = min(error, float(np.abs(had - wanted).max()) / size)
            if error <= DERIVATIVES:
                break
        errors.append(error)
    found |= {"status": "ok", "error": max(errors)}
    try:
        workspace.derivatives(p.q, p.v, tau, method=method, check=True, **forces)
    except cp.errors.DerivativesDisagree as error:
        found["checked"] = str(error)[:200]
    return found


# --- many


def run(seeds: range, parts: Path, every: int) -> None:
    """Append a line for each seed that has none."""
    parts.mkdir(parents=True, exist_ok=True)
    path = parts / f"{pin.__version__}-{KERNEL}.jsonl"
    done = {each["seed"] for each in _lines(path)}
    with path.open("a", encoding="utf-8") as out:
        if path.stat().st_size and not path.read_bytes().endswith(b"\n"):
            out.write("\n")  # after a line that was cut
        for seed in seeds:
            if seed not in done:
                out.write(json.dumps(line(seed, every > 0 and seed % every == 0)) + "\n")
                out.flush()


def _lines(path: Path) -> Iterator[Line]:
    """Yield the lines of a file, but for those that were cut."""
    texts = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for text in texts:
        try:
            yield json.loads(text)
        except json.JSONDecodeError:
            continue


def main() -> int:
    """Run some seeds, or report."""
    from campaign_report import report

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", default="0:100", help="first:last+1")
    parser.add_argument("--parts", type=Path, default=PARTS)
    parser.add_argument(
        "--derivatives", type=int, default=1, help="at every so many seeds; 0 never"
    )
    parser.add_argument("--report", action="store_true")
    given = parser.parse_args()
    if not given.report:
        first, last = (int(part) for part in given.seeds.split(":"))
        warnings.simplefilter("error")
        run(range(first, last), given.parts, given.derivatives)
    return report({p.stem: list(_lines(p)) for p in sorted(given.parts.glob("*.jsonl"))},
                  RESULTS if given.report else None)  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
