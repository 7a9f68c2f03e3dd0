"""What Pinocchio answers without a warning, and what condyn_pin does.

    python benchmarks/truth.py

    M(q) a + h(q, v) = tau + J(q)^T lam,    J(q) a + gamma(q, v) = a_ref

Each case puts one question to Pinocchio as its examples do, and the same one to condyn_pin. Errors
are relative to the larger of |a| and gravity (of derivatives: to the largest), the worst over the
states. The last row of the README's table is of results/peers.json.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin
import script
from script import Table

import condyn_pin as cp

STATES = 10  # of a case
GRAVITY = 9.81  # [m/s^2]
Case = dict[str, Any]


class Bare:
    """Pinocchio 4's own objects for a scene, with nothing around them."""

    def __init__(self, scene: cp.Scene, q: np.ndarray) -> None:
        self.model = scene.robot.model
        self.data, placed = self.model.createData(), self.model.createData()
        pin.framesForwardKinematics(self.model, placed, q)
        self.models = pin.StdVec_RigidConstraintModel()
        self.datas = pin.StdVec_RigidConstraintData()
        for constraint in scene.constraints:
            rows = "CONTACT_3D" if constraint.rows == 3 else "CONTACT_6D"
            if isinstance(constraint, cp.Loop):
                ends = [self._end(constraint.frame_a), self._end(constraint.frame_b)]
            else:
                frame = self.model.getFrameId(constraint.frame)
                ends = [self._end(constraint.frame), (0, placed.oMf[frame])]
            self.models.append(
                pin.RigidConstraintModel(
                    getattr(pin.ContactType, rows), self.model, *ends[0], *ends[1],
                    pin.ReferenceFrame.LOCAL,
                )
            )  # fmt: skip
            self.datas.append(self.models[len(self.models) - 1].createData())
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)
        pin.computeJointMinimalOrdering(self.model, self.data, self.models)

    def _end(self, name: str) -> tuple[int, pin.SE3]:
        frame = self.model.frames[self.model.getFrameId(name)]
        return frame.parentJoint, frame.placement

    def ask(self, call: Callable[..., Any], state: Any, settings: pin.ProximalSettings) -> Any:
        """Return what one of its algorithms gives, in an array of its own."""
        found = call(self.model, self.data, *state, self.models, self.datas, settings)
        return found.copy()


def off(a: np.ndarray, right: np.ndarray, least: float = GRAVITY) -> float:
    """Return the error of a."""
    return float(np.abs(a - right).max() / max(np.abs(right).max(), least))


def states(scene: cp.Scene) -> list[tuple[np.ndarray, ...]]:
    """Return closed states in motion under random torques of the motors."""
    rng = np.random.default_rng(0)
    at = [scene.robot.model.joints[scene.robot.model.getJointId(j)] for j in scene.robot.actuated]
    found = []
    for _ in range(STATES):
        tau = np.zeros(scene.robot.nv)
        tau[[joint.idx_v for joint in at]] = rng.uniform(-10.0, 10.0, len(at))
        found.append((*scene.sample(rng), tau))
    return found


def right(scene: cp.Scene, state: Any) -> np.ndarray:
    """Return the accelerations by the reference: rank-revealing, with exact sums."""
    return cp.solve(scene, *state, solver=cp.dynamics.Reference()).a


def defaults(bar: cp.Scene) -> Case:
    """Ask a planar loop with the settings that Pinocchio has by default."""
    theirs, ours = 0, 0.0
    for state in states(bar):
        a = Bare(bar, state[0]).ask(pin.constraintDynamics, state, pin.ProximalSettings())
        theirs += bool(np.isnan(a).all())
        ours = max(ours, off(cp.solve(bar, *state).a, right(bar, state)))
    return {"nan": theirs, "ours": ours}


def second_call(stance: cp.Scene) -> Case:
    """Ask `lcaba` twice for the same."""
    theirs, ours = 0.0, 0.0
    workspace = cp.Workspace(stance, cp.LCABA())
    for state in states(stance):
        bare, settings = Bare(stance, state[0]), pin.ProximalSettings(1e-12, 0.0, 1e-6, 20)
        twice = [bare.ask(pin.lcaba, state, settings) for _ in range(2)]
        a = right(stance, state)
        assert off(twice[0], a) < 1e-5  # the first call is right
        theirs = max(theirs, off(twice[1], a))
        ours = max(ours, *(off(workspace.acceleration(*state), a) for _ in range(2)))
    return {"theirs": theirs, "ours": ours}


def small_mu(legs: cp.Scene) -> Case:
    """Ask `lcaba` with a mu that other scenes like; `slack` is max |J a + gamma| over max |a|."""
    theirs, slack, said, ours = 0.0, 0.0, set(), 0.0
    for state in states(legs):
        a, terms = right(legs, state), cp.Workspace(legs).terms(*state[:2])
        bare = Bare(legs, state[0])
        found = bare.ask(pin.lcaba, state, pin.ProximalSettings(1e-12, 0.0, 1e-8, 20))
        slack = max(slack, float(np.abs(terms.J @ found + terms.gamma).max() / np.abs(a).max()))
        theirs = max(theirs, off(found, a))
        said.add(cp.solve(legs, *state, solver=cp.LCABA(mu=1e-8), throw=False).status.name.lower())
        ours = max(ours, off(cp.solve(legs, *state).a, a))
    return {"theirs": theirs, "slack": slack, "said": sorted(said), "ours": ours}


def not_a_residual(stance: cp.Scene) -> Case:
    """Read the residual of answers that are right: the least of it, and the largest of ours."""
    theirs, ours = np.inf, 0.0
    for state in states(stance):
        settings = pin.ProximalSettings(1e-12, 1e-9, 1e-8, 20)
        a = Bare(stance, state[0]).ask(pin.constraintDynamics, state, settings)
        assert off(a, right(stance, state)) < 1e-10
        theirs = min(theirs, float(settings.absolute_residual))
        ours = max(ours, cp.solve(stance, *state).constraint_error)
    return {"theirs": float(theirs), "ours": ours}


def first_column(bar: cp.Scene) -> Case:
    """Ask for da/dq along the loop, where the first joint turns; by central differences, too."""
    theirs, ours = 0.0, 0.0
    for state in states(bar):
        along = np.linalg.svd(cp.Workspace(bar).terms(*state[:2]).J)[2][-1]  # J along = 0
        wanted = cp.derivatives(bar, *state, method="differences").da_dq @ along
        bare = Bare(bar, state[0])
        settings = pin.ProximalSettings(1e-12, 1e-12, 1e-10, 20)
        bare.ask(pin.constraintDynamics, state, settings)
        pin.computeConstraintDynamicsDerivatives(
            bare.model, bare.data, bare.models, bare.datas, settings
        )
        theirs = max(theirs, off(bare.data.ddq_dq @ along, wanted, 0.0))
        ours = max(ours, off(cp.derivatives(bar, *state).da_dq @ along, wanted, 0.0))
    return {"theirs": theirs, "ours": ours}


def long_quaternion(stance: cp.Scene) -> Case:
    """Ask with a quaternion of norm 2."""
    theirs, refused = 0.0, 0
    for q, v, tau in states(stance):
        double = q.copy()
        double[3:7] *= 2.0
        settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 20)
        a = Bare(stance, q).ask(pin.constraintDynamics, (double, v, tau), settings)
        theirs = max(theirs, off(a, right(stance, (q, v, tau))))
        try:
            cp.solve(stance, double, v, tau)
        except cp.InvalidArgument:
            refused += 1
    return {"theirs": theirs, "refused": refused}


def cases() -> dict[str, Case]:
    """Put every question."""
    bar, talos, cassie = cp.model.four_bar(), cp.load_robot("talos"), cp.load_robot("cassie")
    linkage, stance, legs = (
        cp.Scene(bar, bar.loops), cp.Scene(talos, talos.contacts), cp.Scene(cassie, cassie.loops)
    )  # fmt: skip
    return {
        "defaults": defaults(linkage),
        "second_call": second_call(stance),
        "small_mu": small_mu(legs),
        "not_a_residual": not_a_residual(stance),
        "first_column": first_column(linkage),
        "long_quaternion": long_quaternion(stance),
    }


def best(peers: Mapping[str, Any], peer: str) -> float:
    """Return the least error of a that a peer reaches on Cassie's loops, with any setting."""
    asked = ("cassie, loops", "acceleration", peer)
    rows = (r for r in peers["rows"] if (r["scene"], r["quantity"], r["peer"]) == asked)
    return float(min(row["error_worst"] for row in rows))


def essence(saved: script.Saved) -> str:
    """Return the README's table: a row a question."""
    peers = script.load("peers")
    f, page = saved["cases"], "docs/pitfalls.md"
    soft = [best(peers, peer) for peer in ("MuJoCo", "Drake", "condyn_pin")]
    rows = [
        (
            f"[four-bar, default settings]({page}#1-nan-from-the-default-settings)",
            "NaN",
            f"a to {f['defaults']['ours']:.0e}; the redundant row is named",
        ),
        (
            f"[Talos, `lcaba` called twice]({page}#2-lcaba-is-right-on-its-first-call)",
            f"the second a is off by {f['second_call']['theirs']:.0%}",
            f"both to {f['second_call']['ours']:.0e}",
        ),
        (
            f"[Cassie's loops, `lcaba`, mu = 1e-8]({page}#4-j-a--gamma--0-and-a-is-wrong)",
            f"J a + gamma = 0 to {f['small_mu']['slack']:.0e}, "
            f"a is off by {f['small_mu']['theirs']:.0%}",
            f"`{'`, `'.join(f['small_mu']['said'])}`; by default a to {f['small_mu']['ours']:.0e}",
        ),
        (
            f"[four-bar, da/dq along its loop]({page}#5-a-wrong-first-column-of-the-derivatives)",
            f"off by {f['first_column']['theirs']:.1f} times itself",
            f"within {f['first_column']['ours']:.0e} of differences",
        ),
        (
            f"[Talos, a quaternion of norm 2]({page}#9-a-quaternion-that-is-not-normalised-a-nan)",
            f"a is off by {f['long_quaternion']['theirs']:.0%}",
            "refused; the error names the entry",
        ),
        (
            "[Cassie's loops, MuJoCo; Drake](docs/simulators.md)",
            f"a is off by {soft[0]:.0e}; {soft[1]:.0e} at best: soft rows, no defect",
            f"a to {soft[2]:.0e}",
        ),
    ]
    where = (
        f"{script.source('truth', saved['machine'], script.SHORT)}, worst of {STATES} states; the "
        "last row `benchmarks/results/peers.json`."
    )
    lines = ["| question | elsewhere, without a warning | here |", "|---|---|---|"]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines, "", where])


SUBJECTS = [
    Table(
        "truth",
        "what others answer wrongly without a warning",
        lambda _: {**script.measured_on(), "cases": cases()},
        essence,
        pages=lambda saved: {script.README: {"truth": essence(saved)}},
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
