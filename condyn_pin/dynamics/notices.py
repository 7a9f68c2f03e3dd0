"""Notices: what deserves attention in an answer, a sentence each."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import largest_violation
from condyn_pin.dynamics.at_state import by_digits, equations_of, gaps, left_out_at
from condyn_pin.dynamics.solution import Sites, Solution, Status, pulling
from condyn_pin.dynamics.workspace import solve
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.model.soundness import massless_motion

# Forces, as a multiple of the weight, that deserve a look at the singular values.
_HEAVY: Final = 1e3

# Doubt from which on a notice states how a state was answered: a is off by some 1e-2 of itself.
_NOTICED: Final = 1e-2

# Joints that a notice names: this many, unless their torque is a small share of the largest.
_LISTED: Final = 3
_SMALL: Final = 1e-3


def notices_of(solution: Solution, sites: Sites) -> tuple[str, ...]:
    """Return the notices of an answer whose constraints act at these sites."""
    digits = solution.scene.nominal.digits
    said = (digits.note,) if digits else ()
    finite = bool(np.isfinite(solution.a).all())
    why = undetermined(solution) if finite else ""
    try:
        off = _off_the_constraints(solution, why) if finite else ()
    except InvalidModel:  # M is singular at q, which `_rank_notes` names
        off = ()
    wrong_forces = () if why else _wrong_forces(solution)
    slack = _left_out_of_tau(solution) if finite else ()
    found = slack + pulling(solution.forces, sites) + wrong_forces + said + off
    explained = bool(off) and (solution.status.ok or bool(why))
    return tuple(dict.fromkeys(found + _rank_notes(solution, explained)))


def _left_out_of_tau(solution: Solution) -> tuple[str, ...]:
    """Notice of springs and dampers that tau lacks, where a would change with them."""
    # tau certainly lacks them at joints where it is zero and they are not.
    scene, (q, v, tau, forces, drift) = solution.scene, solution.question
    of_springs = scene.robot.passive_torque(q, 0 * v)
    passive = scene.robot.passive_torque(q, v)
    lacking = np.abs(tau) <= tolerances.SOLVED * np.abs(passive)
    missing = np.where(lacking, passive, 0.0)
    if not missing.any() or not np.isfinite(passive).all():
        return ()
    answer = partial(solve, scene, q, v, forces=forces, drift=drift, throw=False)
    without, with_them = answer(tau).a, answer(tau + missing).a
    size = max(float(np.abs(without).max()), scene.nominal.gravity)
    change = float(np.abs(with_them - without).max())
    if not change > tolerances.LEFT_OUT_OF_TAU * size:
        return ()
    model = scene.robot.model
    by_joint = {
        model.names[j.id]: float(np.abs(missing[j.idx_v : j.idx_v + j.nv]).max())
        for j in list(model.joints)[1:]
    }
    largest = sorted(by_joint, key=by_joint.__getitem__, reverse=True)[:_LISTED]
    least = _SMALL * by_joint[largest[0]]
    joints = ", ".join(
        f"{by_joint[name]:.3g} at {name}" for name in largest if by_joint[name] > least
    )
    are_springs = bool(np.abs(of_springs[lacking]).max() > 0.0)
    are_dampers = bool(np.abs((passive - of_springs)[lacking]).max() > 0.0)
    kinds = " and ".join(["springs"] * are_springs + ["dampers"] * are_dampers)
    return (
        f"tau lacks the {kinds} of the robot ({joints} N m or N), with which a differs by up to "
        f"{change:.3g} rad/s^2 or m/s^2: pass tau + robot.passive_torque(q, v), as simulate does",
    )


def _wrong_forces(solution: Solution) -> tuple[str, ...]:
    """Notice of wrong forces, where they alone keep an answer from being ok."""
    if solution.status is not Status.INACCURATE or not solution.error_bound <= tolerances.SOLVED:
        return ()
    return (
        f"a is right to {solution.error_bound:.1e}, the forces are not: the equation of a joint is "
        f"off by {solution.dynamics_error:.1e} N or N m, more than {tolerances.FORCES:g} of the "
        "largest torque",
    )


def undetermined(solution: Solution) -> str:
    """Reason that no acceleration belongs to the state at its precision; empty if one does."""
    scene, doubt, off = solution.scene, solution.doubt, solution.state_error
    if solution.status is not Status.INACCURATE or not scene.robot.precision or not scene.rows:
        return ""
    if doubt >= tolerances.DOUBT:
        name, gap = largest_violation(gaps(scene, equations_of(scene).violation(solution.q)))
        return (
            f"closing the loops ({gap} at {name}) leads {doubt:.2g} of the way to a singular "
            "posture: no a belongs to this state at its precision; Scene.assemble(q) closes them"
        )
    if max(off) <= tolerances.NOT_ROUNDING or not solution.error_bound < tolerances.DOUBT / 10:
        return ""
    nominal, v, a = scene.nominal, solution.v, solution.a
    left = left_out_at(scene, solution.q)
    if nominal.redundancy.blurred(left, v, a, nominal.gravity) >= tolerances.DOUBT:
        return (
            "the posture is so near to a singular one that rounding of q decides a off the "
            "constraints; Scene.assemble and mechanism.project_velocity put the state onto them"
        )
    size = max(float(np.abs(a).max()), nominal.gravity)
    change = float(np.abs(a - solution.closed().a).max())
    if change < tolerances.DOUBT * size:
        return ""
    return (
        f"on the constraints, {np.abs(off.q).max():.2g} rad or m and {np.abs(off.v).max():.2g} "
        f"rad/s or m/s away, a differs by {change / size:.2g} of itself: none belongs to this "
        "state at its precision; Scene.assemble and mechanism.project_velocity put it there"
    )


def _off_the_constraints(solution: Solution, why: str) -> tuple[str, ...]:
    """Notice of a state that leaves loops open, or whose velocity contradicts the rows."""
    # `why` no acceleration belongs to it, if none does, is all of it.
    if why:
        return (why,)
    scene, doubt, rest, off = solution.scene, solution.doubt, solution.rest, solution.state_error
    moves = max(np.abs(off.q).max(initial=0.0), np.abs(off.v).max(initial=0.0))
    if by_digits(scene) and moves <= tolerances.OPEN:
        return ()  # digits of the file leave it open at every state, and have a notice
    is_open = off.position > tolerances.OPEN
    gap = (
        largest_violation(gaps(scene, equations_of(scene).violation(solution.q)))
        if is_open
        else None
    )
    missed = ", ".join(f"{row} by {abs(by):.2g}" for row, by in rest.items())
    if gap and (doubt >= _NOTICED or missed):
        joint, by = _largest(scene.robot.model, solution.state_error.q)
        text = (
            f"loops are open by {gap[1]} ({gap[0]}): answered as the machine that is closed by "
            f"moves of at most {by:.2g} rad or m ({joint})"
        )
        if missed:
            text += f"; left out as redundant there: {missed} m/s^2 or rad/s^2"
        return (text,)
    if missed:
        joint, by = _largest(scene.robot.model, solution.state_error.v)
        return (
            f"velocities contradict the constraints: rows are missed ({missed} m/s^2 or rad/s^2); "
            f"mechanism.project_velocity takes off at most {by:.2g} rad/s or m/s ({joint})",
        )
    return ()


def _largest(model: Any, move: Array) -> tuple[str, float]:
    """Joint that a move (nv,) moves most, and by how much."""
    i = int(np.abs(move).argmax())
    joint = next(j for j in model.joints if j.idx_v <= i < j.idx_v + j.nv)
    return model.names[joint.id], float(abs(move[i]))


def _rank_notes(solution: Solution, explained: bool) -> tuple[str, ...]:
    """Return the notes of `Scene.rank` where it is singular, or the answer is in doubt."""
    # Not of an answer that is so because of its state, if another notice has `explained` that.
    scene, ok = solution.scene, solution.status.ok
    if not ok:
        share = tolerances.NEARLY_MASSLESS
        if said := massless_motion(scene.robot.model, solution.q, share=share):
            return (said,)
    if not scene.rows:
        return ()
    nominal = scene.nominal
    heavy = np.abs(solution.lam).max(initial=0.0) > _HEAVY * nominal.weight
    scale = max(float(np.abs(solution.a).max()), nominal.estimator.gravity)
    # of contradicting rows the best a is still unique, and may be ok
    missed = max(map(abs, solution.rest.values()), default=0.0)
    unmet = max(solution.constraint_error, missed) > tolerances.SOLVED * scale
    try:
        at = scene.rank(solution.q)
    except (InvalidModel, InvalidArgument):  # numbers that nothing can be said of
        return ()
    if heavy or at.singular or at.conflict or (not explained and (unmet or not ok)):
        return at.notes
    return ()
