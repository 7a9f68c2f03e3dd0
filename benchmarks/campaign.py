"""Random trees of every joint type with constraints of every kind, against an oracle of their own.

    python benchmarks/campaign.py trees --seeds 0:4000 [--parts /tmp/parts] [--derivatives 1]
    OPENBLAS_CORETYPE=Prescott python benchmarks/campaign.py trees --seeds 4000:8000
    python benchmarks/campaign.py trees --report          # from the parts: results and pages
    python benchmarks/campaign.py held [--seeds 0:3000]   # on each Pinocchio

trees: every seed is one problem (`judges/trees.py`): a tree of up to ten joints, masses over up to
eight decades, up to four constraints and some of them twice, external forces, a state on the
constraints. Every exact solver answers it, and `derivatives` are taken by every method that takes
them. The oracle (`judges/oracle.py`) knows positions only, in 64 bits of mantissa; of the library's
rows, and of Pinocchio's dynamics, nothing enters.

An answer is wrong if it says ok and a is off by more than it promises, 1e-8 of the larger of |a|
and gravity; derivatives, if they differ along the constraints by more than 1e-6 of the largest
entry, or of |a| / 1000; forces, if what they do to the joints, each at its point and in its axes,
is off by 1e-7 of what M does with that. Where `check=True` says that derivatives differ, by lam or
off the constraints, where the oracle does not look, it is listed: by the differences' own noise, or
not. A seed's line in `parts` depends on the seed, the Pinocchio and the processor's kernel alone;
seeds that have one are not run again, so that a run may be cut at any time.

held: ConstrainedABA and PV on such trees, of every joint type that is compiled, against Reference.
On them are one to four contacts: points, welds, edges and plates by their four corners, some of
them twice.

Both end with 1 if anything was wrong.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
import script
from judges.oracle import Array, Oracle, Solved, Undecided, generalised, rows, solve
from judges.trees import Problem, configuration, placement, problem, tree
from script import Printed, Table

import condyn_pin as cp
from condyn_pin._core.compiled import constrained_aba
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import DERIVATIVES, FORCES, SOLVED

PARTS = script.ROOT / "build" / "campaign"
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
        return found | {"status": "unsupported"}
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
        return found | {"status": "unsupported"}
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


def trees(given: Namespace) -> int:
    """Run some seeds, or write what all parts say; 1 if anything was wrong."""
    if given.from_json:
        script.fill(pages(script.load("campaign trees")))
        return 0
    if not given.report:
        first, last = (int(part) for part in given.seeds.split(":"))
        warnings.simplefilter("error")
        run(range(first, last), given.parts, given.derivatives)
    parts = {path.stem: list(_lines(path)) for path in sorted(given.parts.glob("*.jsonl"))}
    return report(parts, script.RESULTS if given.report else None)


# --- report

LISTED = 20


def report(parts: Mapping[str, Sequence[Line]], folder: Path | None) -> int:
    """Print what came out, write it into a folder if one is given; 1 if anything was wrong."""
    summaries = {name: summary(lines) for name, lines in parts.items()}
    print(methods_table(summaries))
    wrong = 0
    for name, found in summaries.items():
        for what, cases in found["wrong"].items():
            wrong += len(cases)
            for case in cases[:LISTED]:
                print(f"{name}: {what}: {case}")
        for case in found["check_disagrees"][:LISTED]:
            print(f"{name}: check=True: {case}")
    if folder is not None:
        script.write(folder / "campaign_trees.json", summaries)
        script.write(folder / "campaign_trees.md", methods_table(summaries))
        script.fill(pages(summaries))
    return int(wrong > 0)


def pages(summaries: Mapping[str, Line]) -> script.Pages:
    """Return the blocks of README and docs."""
    return {
        script.RESULTS_PAGE: {
            "campaign": essence(summaries),
            "campaign_total": sentence(summaries),
        },
    }


def sentence(summaries: Mapping[str, Line]) -> str:
    """Return how many answers said ok, and how many of them were wrong, by method."""
    ok: Counter[str] = Counter()
    for found in summaries.values():
        for name, counts in found["statuses"].items():
            ok["derivatives" if name.startswith("derivatives") else "solves"] += counts.get("ok", 0)
    lists = (cases for found in summaries.values() for cases in found["wrong"].values())
    wrong = [case.partition(", ")[2] for cases in lists for case in cases]
    methods = Counter(case.partition(":")[0] for case in wrong)
    named = "; ".join(f"{n} of `{name}`" for name, n in methods.most_common())
    parts = [dict.fromkeys(each) for each in zip(*(n.split("-") for n in summaries), strict=True)]
    return (
        f"{sum(found['problems'] for found in summaries.values())} random problems against an "
        f"oracle that knows only positions: of {ok['solves']} answers and {ok['derivatives']} "
        f"derivatives reported ok **{len(wrong)} were wrong**{f' ({named})' if named else ''}.\n"
        f"`python benchmarks/campaign.py trees` (`benchmarks/results/campaign_trees.json`), "
        f"Pinocchio {' and '.join(parts[0])}, kernels {' and '.join(parts[1])}; limits: a "
        f"{SOLVED:.0e}, forces {FORCES:.0e}, derivatives {DERIVATIVES:.0e}."
    )


def essence(summaries: Mapping[str, Line]) -> str:
    """Return a row for each part: how many answers, and how many of them were wrong."""
    lines = [
        "| Pinocchio, kernel | problems | solves | said ok | worst | wrong | derivatives | wrong |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, found in summaries.items():
        solvers = [n for n in found["statuses"] if not n.startswith("derivatives")]
        ok = sum(found["statuses"][n].get("ok", 0) for n in solvers)
        worst = max((found["worst"].get(n, 0.0) for n in solvers), default=0.0)
        wrong = {what: len(cases) for what, cases in found["wrong"].items()}
        lines.append(
            f"| {name} | {found['problems']} | {found['solves']} | {ok} | {worst:.0e} | "
            f"{wrong['solve'] + wrong['force'] + wrong['raised']} | {found['derivative_calls']} | "
            f"{wrong['derivative']} |"
        )
    return "\n".join(lines)


def summary(lines: Sequence[Line]) -> Line:
    """Return counts and worst errors of one part, and the seeds of what was wrong."""
    statuses: dict[str, Counter[str]] = {}
    worst: dict[str, float] = {}
    wrong: dict[str, list[str]] = {k: [] for k in ("solve", "force", "derivative", "raised")}
    derived: Counter[str] = Counter()
    disagreeing: list[str] = []
    joints, kinds = Counter[str](), Counter[str]()
    for each in lines:
        joints.update(each.get("joints", ()))
        kinds.update(each.get("kinds", ()))
        for one in each.get("solves", ()):
            name, status = one["solver"], one["status"]
            statuses.setdefault(name, Counter())[status] += 1
            _verifier(wrong, each["seed"], name, one, SOLVED, "solve")
            if status == "ok":
                worst[name] = max(worst.get(name, 0.0), one["error"])
        for one in each.get("derivatives", ()):
            name = f"derivatives {one['method']}"
            derived[one["status"]] += 1
            statuses.setdefault(name, Counter())[one["status"]] += 1
            _verifier(wrong, each["seed"], name, one, DERIVATIVES, "derivative")
            if one["status"] == "ok":
                worst[name] = max(worst.get(name, 0.0), one["error"])
            if "checked" in one:
                disagreeing.append(f"seed {each['seed']}, {name}: {one['checked']}")
    solvers = [n for n in statuses if not n.startswith("derivatives")]
    return {
        "problems": sum("solves" in each for each in lines),
        "refused": sum("refused" in each for each in lines),
        "undecided": sum("undecided" in each for each in lines),
        "with_forces": sum(bool(each.get("forces")) for each in lines),
        "with_redundant_rows": sum(each.get("rank", 0) < each.get("rows", 0) for each in lines),
        "solves": sum(n for s in solvers for k, n in statuses[s].items() if k != "unsupported"),
        "derivative_calls": sum(n for k, n in derived.items() if k != "unsupported"),
        "statuses": {name: dict(counts) for name, counts in statuses.items()},
        "worst": worst,
        "joints": dict(joints.most_common()),
        "kinds": dict(kinds.most_common()),
        "wrong": wrong,
        "check_disagrees": disagreeing,
    }


def _verifier(
    wrong: dict[str, list[str]], seed: int, name: str, one: Line, limit: float, what: str
) -> None:
    """Enter an answer into the lists where it is wrong, or raised what it should not."""
    if one["status"] == "raised":
        wrong["raised"].append(f"seed {seed}, {name}: {one['said']}")
    elif one["status"] == "ok":
        if not one["error"] <= limit:
            bound = f", bound {one['bound']:.1e}" if "bound" in one else ""
            wrong[what].append(f"seed {seed}, {name}: {one['error']:.1e}{bound}")
        if not one.get("force_error", 0.0) <= FORCES:
            wrong["force"].append(f"seed {seed}, {name}: {one['force_error']:.1e}")


def methods_table(summaries: Mapping[str, Line]) -> str:
    """Return a row for each part and each method."""
    lines = [
        "| Pinocchio, kernel | method | ok | said so | unsupported | worst error of ok | wrong |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, found in summaries.items():
        everything = [case for cases in found["wrong"].values() for case in cases]
        for method, counts in sorted(found["statuses"].items()):
            said = sum(n for k, n in counts.items() if k not in ("ok", "unsupported", "raised"))
            wrong = sum(f", {method}:" in case for case in everything)
            refused, worst = counts.get("unsupported", 0), found["worst"].get(method, 0.0)
            lines.append(
                f"| {name} | {method} | {counts.get('ok', 0)} | {said} | {refused} | "
                f"{worst:.0e} | {wrong} |"
            )
    for name, found in summaries.items():
        lines += ["", (
            f"{name}: {found['problems']} problems, {found['solves']} solves, "
            f"{found['derivative_calls']} calls of derivatives; external forces in "
            f"{found['with_forces']}, redundant rows in {found['with_redundant_rows']}; "
            f"{found['refused']} models refused, {found['undecided']} of undecided rank."
        )]  # fmt: skip
    return "\n".join(lines)


# --- held


HELD_SOLVERS = (cp.dynamics.ConstrainedABA, cp.dynamics.PV, cp.Proximal)


def held(seed: int) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray] | None:
    """Return a scene with a state on its constraints; None with joints that are not compiled."""
    rng = np.random.default_rng([20261, seed])
    model = tree(rng)
    if any(j.shortname() not in constrained_aba().joints for j in list(model.joints)[1:]):
        return None
    q = configuration(model, rng)
    names = [frame.name for frame in model.frames if frame.name.startswith("body")]
    constraints: list[Any] = []
    for k in range(int(rng.integers(1, 5))):
        name = names[int(rng.integers(len(names)))]
        constraints += _contacts(model, name, f"c{k}", rng)
    scene = cp.Scene(cp.Robot("random", model, postures={"here": q}), constraints)
    v = rng.normal(scale=float(rng.choice([0.0, 1.0, 10.0])), size=model.nv)
    v = cp.mechanism.project_velocity(scene, q, v)
    tau = cp.Workspace(scene).terms(q, v).M @ rng.normal(scale=10.0, size=model.nv)
    return scene, q, v, tau


def _contacts(model: Any, frame: str, name: str, rng: np.random.Generator) -> list[Any]:
    """Return what holds one frame: a point, a weld, an edge or corners; or some of it twice."""
    pick = int(rng.integers(4))
    if pick == 0:
        offset = tuple(placement(rng).translation)
        made = [cp.PointContact(frame, offset=offset, name=name)]
    elif pick == 1:
        made = [cp.SurfaceContact(frame, name=name)]
    elif pick == 2:
        made = [cp.constraints.LineContact(frame, "xyz"[int(rng.integers(3))], name=name)]
    else:
        length, width = rng.uniform(0.01, 0.3, size=2)
        corners = [(x * length, y * width, 0.0) for x in (-1, 1) for y in (-1, 1)]
        made = [
            cp.PointContact(frame, offset=corner, name=f"{name}.{i}")
            for i, corner in enumerate(corners)
        ]
    if rng.random() < 0.2:
        made.append(cp.PointContact(frame, name=f"{name} again"))
    return made


def run_held(seeds: range) -> dict[str, dict[str, Any]]:
    """Return what became of each solver: statuses, wrong ones, and the worst that was ok."""
    said = {kind.__name__: Counter[str]() for kind in HELD_SOLVERS}
    worst = dict.fromkeys(said, 0.0)
    for seed in seeds:
        try:
            drawn = held(seed)
        except (cp.errors.InvalidModel, cp.errors.InvalidConstraint):
            drawn = None
        if drawn is None:
            continue
        scene, *state = drawn
        right = cp.solve(scene, *state, solver=cp.dynamics.Reference(), throw=False)
        if not right.status.ok:
            continue
        size = max(float(np.abs(right.a).max()), scene.nominal.estimator.gravity)
        for kind in HELD_SOLVERS:
            name = kind.__name__
            found = cp.solve(scene, *state, solver=kind(), throw=False)
            said[name][found.status.name.lower()] += 1
            if found.status.ok:
                error = float(np.abs(found.a - right.a).max()) / size if size else 0.0
                worst[name] = max(worst[name], error)
                if error > SOLVED:
                    said[name]["wrong"] += 1
                    print(f"seed {seed}, {name}: ok and off by {error:.1e}", flush=True)
    return {
        name: {"problems": sum(count.values()) - count["wrong"], "worst": worst[name], **count}
        for name, count in said.items()
    }


def all_held(given: Namespace) -> script.Saved:
    """Run some seeds on the Pinocchio that is installed; rows of others stay."""
    kept = script.load("campaign held") if script.result("campaign held").exists() else {}
    first, last = map(int, given.seeds.split(":"))
    here = {"machine": machine(), "solvers": run_held(range(first, last))}
    return dict(sorted((kept | {pin.__version__: here}).items()))


def held_table(saved: script.Saved) -> str:
    """Return a row a solver on each Pinocchio."""
    lines = [
        "| solver | Pinocchio | scenes | ok | of these wrong | not ok | worst error of ok |",
        "|---|---|---|---|---|---|---|",
    ]
    for version, here in saved.items():
        for name, row in here["solvers"].items():
            ok, wrong = row.get("ok", 0), row.get("wrong", 0)
            cells = (row["problems"], ok, wrong, row["problems"] - ok, f"{row['worst']:.0e}")
            lines.append(f"| `{name}` | {version} | " + " | ".join(map(str, cells)) + " |")
    where = next(iter(saved.values()))["machine"]
    return "\n".join([*lines, "", f"{script.source('campaign held', where, script.SHORT)}."])


def _trees_options(parser: ArgumentParser) -> None:
    parser.add_argument("--seeds", default="0:100", help="first:last+1")
    parser.add_argument("--parts", type=Path, default=PARTS)
    parser.add_argument(
        "--derivatives", type=int, default=1, help="at every so many seeds; 0 never"
    )
    parser.add_argument("--report", action="store_true", help="write what all parts say")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")


def _held_options(parser: ArgumentParser) -> None:
    parser.add_argument("--seeds", default="0:3000", help="first:last+1")


SUBJECTS = [
    Printed("campaign trees", "every solver on random trees", trees, _trees_options),
    Table(
        "campaign held",
        "ConstrainedABA and PV on trees that are held at the world",
        all_held,
        held_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"campaign_held": held_table(saved)}},
        options=_held_options,
        wrong=lambda saved: any(
            row.get("wrong", 0) for here in saved.values() for row in here["solvers"].values()
        ),
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
