"""Notices: what deserves attention in a trajectory, a sentence each."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.violation import ConstraintViolation, beyond_text, worst
from condyn_pin.dynamics.scene import Scene
from condyn_pin.mechanism.check import check
from condyn_pin.model.limits import Limits
from condyn_pin.simulation.tensile_contacts import tensile_contact_notices
from condyn_pin.simulation.verify import solver_notices

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

# A gap that is larger than that of an open start by this factor has opened on the way: one that
# closes at a critical rate grows first by what its velocity brings.
_LARGER = 2.0


def notices_of(trajectory: Trajectory) -> tuple[str, ...]:
    """Return what there is to say: of its end, gaps, solver, pulls, energy and joint limits."""
    said = []
    if not trajectory.status.ok:
        said.append(f"{trajectory.status}; {trajectory.reason}")
    said += _open_constraints(trajectory)
    said += _coarse_turns(trajectory) + _differenced(trajectory)
    said += solver_notices(trajectory) + tensile_contact_notices(trajectory)
    energy = trajectory.energy
    error, scale = float(np.abs(energy.error).max()), energy.scale
    if error > max(tolerances.BALANCED * scale, energy.kept, _hardly_lifted(trajectory.scene)):
        said.append(
            f"{error:.3g} J of energy came or went without work, of {scale:.3g} J exchanged"
        )
    if beyond := _beyond_limits(trajectory):
        said.append(f"{beyond_text(beyond)}; the dynamics know no limits")
    return tuple(said)


def _open_constraints(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the largest gap, if it is larger than a closed state has."""
    violation, run = trajectory.violation, trajectory.run
    largest, first = float(violation.max()), float(violation[0])
    if not largest > tolerances.NEARLY_CLOSED:
        return []
    if first > tolerances.NEARLY_CLOSED and largest < _LARGER * first:
        left = float(violation[-1])
        return [
            f"the constraints were open by {first:.2g} m or rad at the start, as close_start=False "
            f"allows, and are by {left:.2g} at the end"
        ]
    when = int(violation.argmax())
    scenes = [
        p.scene for p in trajectory.phases if when in range(*p.samples.indices(len(violation)))
    ]
    open_by = [worst(check(scene, trajectory.q[when], None).violation) for scene in scenes]
    name, gap = max(open_by, key=lambda item: item[1].size)
    remedy = "use a smaller dt, a higher order, or another drift scheme"
    if not run.solver.exact:
        remedy = f"{run.solver.title} lets them give way; use a stiffer solref"
    return [f"{name} is open by {gap} at t = {trajectory.t[when]:.4g} s: {remedy}"]


def _coarse_turns(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the joint that turns fastest, if by half a turn a step or more."""
    run, model = trajectory.run, trajectory.scene.robot.model
    if run.integrator.is_adaptive:
        return []
    speed = np.abs(trajectory.v).max(axis=0)
    turns = {
        model.names[i]: float(speed[joint.idx_v + k])
        for i, joint in enumerate(list(model.joints)[1:], start=1)
        for k, length in enumerate(lengths(joint))
        if not length and speed[joint.idx_v + k] * run.dt > pi
    }
    if not turns or not trajectory.status.ok:
        return []
    joint = max(turns, key=turns.__getitem__)
    return [
        f"joint {joint!r} turns by {turns[joint] * run.dt:.3g} rad in a step of {run.dt:.3g} s, "
        "and what its angle does to other joints is not seen: take dt below "
        f"{pi / turns[joint]:.2g} s"
    ]


def _differenced(trajectory: Trajectory) -> list[str]:
    """Return a sentence on torques that were stiff, and what their differences cost."""
    calls, nv = trajectory.run.differenced, trajectory.scene.robot.nv
    if not calls:
        return []
    return [
        f"tau(t, q, v) is stiff, and was called {calls} times for its differences, {2 * nv + 1} "
        "times a step: jacobian=... saves them"
    ]


def _hardly_lifted(scene: Scene) -> float:
    """Return what lifts the robot by a nanometre [J]; one at rest may have no energies at all."""
    gravity = float(np.linalg.norm(scene.robot.model.gravity.linear))
    return tolerances.ENERGY_KEPT * scene.robot.mass * gravity


def _beyond_limits(trajectory: Trajectory) -> dict[str, ConstraintViolation]:
    """Return the joints that leave their limits, and how far at most, unless they began so."""
    q, limits = trajectory.q, Limits.of(trajectory.scene.robot.model)
    inside = limits.beyond(q[0]).keys()
    most = limits.beyond(q.min(axis=0)) | limits.beyond(q.max(axis=0))
    return {
        joint: gap
        for joint, gap in most.items()
        if joint not in inside and gap.size > tolerances.CLOSED
    }
