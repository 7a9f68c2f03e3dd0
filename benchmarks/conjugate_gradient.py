"""Compare `ConjugateGradient` with SciPy's cg and MINRES on long chains; write docs/results.md.

    python benchmarks/conjugate_gradient.py [--joints 10 30 100]

All of them apply M^-1, J and J^T by the same sweeps over the tree, and no matrix is formed at a
state. cg solves G lam = b with G = J M^-1 J^T; MINRES solves both equations at once,

    [ M  J^T ] [  a  ]   [ tau - h ]
    [ J   0  ] [ -lam ] = [ -gamma  ].

Preconditioned is G by its inverse at the nominal state, and M by the articulated body algorithm.
Each iterates until |J a + gamma| is what `ConjugateGradient` asks for, or the residual of both is a
billionth of the right side. With --from-json nothing is run.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np
from scipy.sparse.linalg import LinearOperator, cg, minres

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import interleaved, machine
from condyn_pin.dynamics.matrix_free import inverse_delassus

JSON = Path(__file__).resolve().parent / "results" / "conjugate_gradient.json"
JOINTS = (10, 30, 100, 400)
MOST_IN_CELLS = 100  # joints: MINRES alone would take minutes with more
MOST = 5  # iterations of SciPy's methods, times unknowns

State = tuple[Array, Array, Array]
Solve = Callable[[Array, Array, Array], tuple[Array, int]]


@dataclass(frozen=True)
class Row:
    """One method on one scene.

    Attributes
    ----------
    scene : str
    joints, rows, rank : int
    method : str
    iterations : int
    us : float
        Least time of 15 samples [us].
    to_ours : float
        Over that of `ConjugateGradient`.
    error : float
        Of a, against `Reference`, relative to the larger of |a| and gravity.
    """

    scene: str
    joints: int
    rows: int
    rank: int
    method: str
    iterations: int
    us: float
    to_ours: float
    error: float


class Sweeps:
    """The operators of a scene by sweeps over the tree."""

    def __init__(self, scene: cp.Scene) -> None:
        self.scene, self.model = scene, scene.robot.model
        self.data, self.still = self.model.createData(), np.zeros(self.model.nv)
        self.equations = cp.Workspace(scene, cp.dynamics.NullSpace()).equations
        self.weightless = pin.Model(self.model)
        self.weightless.gravity = pin.Motion.Zero()
        self.P = inverse_delassus(scene.nominal)
        self.enough = scene.nominal.estimator.enough / 10

    def free(self, q: Array, v: Array, tau: Array, lam: Array) -> Array:
        """Return M^-1 (tau + J^T lam - h)."""
        forces, wrenches = tau + self.equations.torque(lam), self.equations.wrenches(lam)
        return np.array(pin.aba(self.model, self.data, q, v, forces, wrenches))

    def delassus(self, q: Array) -> Callable[[Array], Array]:
        """Return x to J M^-1 J^T x."""

        def product(x: Array) -> Array:
            torque, wrenches = self.equations.torque(x), self.equations.wrenches(x)
            a = pin.aba(self.weightless, self.data, q, self.still, torque, wrenches)
            return self.equations.jacobian_product(q, a)

        return product

    def kkt(self, q: Array) -> Callable[[Array], Array]:
        """Return (a, -lam) to (M a - J^T lam, J a)."""
        n = self.model.nv

        def product(x: Array) -> Array:
            a, lam = x[:n], -x[n:]
            slips = self.equations.jacobian_product(q, a)
            wrenches = self.equations.wrenches(lam)
            forces = pin.rnea(self.weightless, self.data, q, self.still, a, wrenches)
            return np.concatenate([forces - self.equations.torque(lam), slips])

        return product


def by_cg(sweeps: Sweeps, *, preconditioned: bool) -> Solve:
    """Return SciPy's cg for lam."""
    m = sweeps.scene.rows

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, int]:
        count = [0]
        target = sweeps.equations.target(q, v)
        b = target - sweeps.equations.jacobian_product(q, sweeps.free(q, v, tau, np.zeros(m)))
        lam, _ = cg(
            LinearOperator((m, m), sweeps.delassus(q), dtype=np.float64),
            b,
            rtol=0.0,
            atol=sweeps.enough,
            maxiter=MOST * m,
            M=sweeps.P if preconditioned else None,
            callback=lambda _: count.__setitem__(0, count[0] + 1),
        )
        return sweeps.free(q, v, tau, lam), count[0]

    return solve


def by_minres(sweeps: Sweeps, *, preconditioned: bool) -> Solve:
    """Return SciPy's MINRES for a and lam at once."""
    n, m = sweeps.model.nv, sweeps.scene.rows

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, int]:
        count = [0]
        h = pin.nonLinearEffects(sweeps.model, sweeps.data, q, v)
        y = np.concatenate([tau - h, sweeps.equations.target(q, v)])

        def precondition(r: Array) -> Array:
            a = pin.aba(sweeps.weightless, sweeps.data, q, sweeps.still, np.array(r[:n]))
            return np.concatenate([a, sweeps.P @ r[n:]])

        x, _ = minres(
            LinearOperator((n + m, n + m), sweeps.kkt(q), dtype=np.float64),
            y,
            rtol=1e-9,
            maxiter=MOST * (n + m),
            M=LinearOperator((n + m, n + m), precondition, dtype=np.float64)
            if preconditioned
            else None,
            callback=lambda _: count.__setitem__(0, count[0] + 1),
        )
        return x[:n], count[0]

    return solve


def ours(scene: cp.Scene, solver: cp.dynamics.Solver) -> Solve:
    """Return a solver of this library."""
    workspace = cp.Workspace(scene, solver)

    def solve(q: Array, v: Array, tau: Array) -> tuple[Array, int]:
        return workspace.acceleration(q, v, tau), 0

    return solve


def scenes(joints: int) -> Iterator[tuple[str, cp.Scene]]:
    """Yield a chain whose tip is held, and cells side by side, of about so many joints."""
    chain = cp.model.chain(joints)
    yield "chain, tip held", cp.Scene(chain, [cp.PointContact(chain.model.frames[-1].name)])
    if joints <= MOST_IN_CELLS:
        cells = cp.model.n_four_bar(max(1, joints // 2))
        yield "four-bars in a row", cp.Scene(cells, cells.loops)


def measure(label: str, scene: cp.Scene) -> Iterator[Row]:
    """Measure all methods on a scene, at one state."""
    q = scene.assemble(bent(scene)).q
    state = (q, np.zeros(scene.robot.nv), np.zeros(scene.robot.nv))
    truth = cp.Workspace(scene, cp.dynamics.Reference()).solve(*state, throw=False)
    sweeps = Sweeps(scene)
    methods: dict[str, Solve] = {
        "ConjugateGradient": ours(scene, cp.dynamics.ConjugateGradient()),
        "NullSpace, dense": ours(scene, cp.dynamics.NullSpace()),
        "scipy cg": by_cg(sweeps, preconditioned=False),
        "scipy cg, preconditioned": by_cg(sweeps, preconditioned=True),
        "scipy MINRES": by_minres(sweeps, preconditioned=False),
        "scipy MINRES, preconditioned": by_minres(sweeps, preconditioned=True),
    }
    found = {name: solve(*state) for name, solve in methods.items()}
    times = interleaved(methods, [state], rounds=15, repeats=5, enough=0.003)
    # the least: other programs make times longer, never shorter
    least = {name: min(found.samples) for name, found in times.items()}
    iterations = (
        cp.Workspace(scene, cp.dynamics.ConjugateGradient()).solve(*state, throw=False).iterations
    )
    scale = max(np.abs(truth.a).max(), scene.nominal.estimator.gravity)
    for name, (a, count) in found.items():
        yield Row(
            label, scene.robot.nv, scene.rows, scene.nominal.rank, name,
            iterations if name == "ConjugateGradient" else count,
            least[name], least[name] / least["ConjugateGradient"],
            float(np.abs(a - truth.a).max() / scale),
        )  # fmt: skip


def bent(scene: cp.Scene) -> Array:
    """Return a configuration near the nominal one: a chain that hangs straight is singular."""
    q, v = scene.state()
    step = 0.02 * np.random.default_rng(0).normal(size=len(v))
    return np.array(pin.integrate(scene.robot.model, q, step))


def markdown(rows: list[Row], about: dict[str, str]) -> str:
    """Return the table."""
    lines = [
        "| scene | joints | rows | method | iterations | time [us] | to ours | error of a |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = (
            row.scene, row.joints, row.rows, row.method, row.iterations or "",
            f"{row.us:.0f}", f"{row.to_ours:.2f}", f"{row.error:.0e}",
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    where = (
        "`python benchmarks/conjugate_gradient.py` on {processor}, one thread, Python {python}, "
        "Pinocchio {pinocchio}, {date}. At rest, without torques; the least of 15 times; error "
        "against `Reference`, relative to the larger of abs(a) and gravity."
    ).format(**about)
    return "\n".join([*lines, "", where])


def pages(rows: list[Row], about: dict[str, str]) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"conjugate_gradient": markdown(rows, about)}}


def load() -> tuple[list[Row], dict[str, str]]:
    """Return the committed results."""
    saved = json.loads(JSON.read_text(encoding="utf-8"))
    return [Row(**row) for row in saved["rows"]], saved["machine"]


def main() -> None:
    """Run, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--joints", nargs="*", type=int, default=JOINTS)
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    arguments = parser.parse_args()
    if not arguments.from_json:
        rows = []
        for joints in arguments.joints:
            for label, scene in scenes(joints):
                for row in measure(label, scene):
                    print(row, flush=True)
                    rows.append(row)
        saved = {"machine": machine(), "rows": [asdict(row) for row in rows]}
        JSON.write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")
    marks.write(pages(*load()))


if __name__ == "__main__":
    main()
