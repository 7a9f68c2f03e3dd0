"""The same question to both engines, term by term.

MuJoCo's terms are brought to Pinocchio's coordinates (`mujoco_terms`). A light link is to count as
a heavy one: with s_i = sqrt(M_ii), M is compared entry by entry relative to s_i s_j, forces as
f_i / s_i and accelerations as s_i a_i, both relative to the largest. Rows of a constraint are
scaled otherwise in MuJoCo, and in other axes; what they span is compared: the share of each row of
one that the other's leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg import counted
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.rows.bound import ConstraintViolation, Terms
from condyn_pin.dynamics.at_state import gaps
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.io.mjcf import Transmissions
from condyn_pin.study.mujoco.causes import causes
from condyn_pin.study.mujoco.cross_check import CrossCheck, TermCheck
from condyn_pin.study.mujoco.mujoco_terms import LoopRows, MujocoTerms, equalities_of

if TYPE_CHECKING:
    from condyn_pin.study.mujoco.mujoco_bridge import MujocoBridge

# Where nothing acts and nothing moves, forces are compared with those of 1 m/s^2 or 1 rad/s^2 on
# the heaviest joint: rounding is no difference.
_LEAST: Final = 1.0

_OTHERS: Final = "loops of other names"


@one_blas_thread
def cross_check(
    bridge: MujocoBridge, q: ArrayLike, v: ArrayLike, tau: ArrayLike, tolerance: float
) -> CrossCheck:
    """Return what both engines say at a state; `MujocoBridge.compare` says more."""
    if not (isinstance(tolerance, (float, int)) and 0.0 < tolerance < 1.0):
        raise InvalidArgument(f"tolerance = {tolerance!r}: a number between 0 and 1 is needed")
    robot = bridge.robot
    workspace = Workspace(Scene(robot, robot.loops))
    q_, v_, tau_ = robot.arguments.check(q, v, tau)
    theirs = MujocoTerms(bridge, q_, v_, tau_)
    terms, passive = workspace.terms(q_, v_), robot.passive_torque(q_, v_)
    a = pin.aba(robot.model, whole_data(robot.model), q_, v_, tau_ + passive)
    labels = _labels(robot.model)
    s = np.sqrt(np.diag(terms.M))
    found = [
        _of_matrix("M", labels, terms.M, theirs.M, s),
        _of_vector("h", labels, terms.h, theirs.h, 1.0 / s, s.max()),
        _of_vector("passive", labels, passive, theirs.passive, 1.0 / s, s.max()),
        _of_vector("a", labels, a, theirs.acceleration(tau_), s, s.max()),
    ]
    loops, notes = _of_loops(workspace, q_, terms, theirs)
    return CrossCheck(
        robot=robot.name,
        terms=(*found, *loops),
        causes=causes(bridge, theirs.data, q_, tolerance),
        notes=(*notes, *_beside(bridge)),
        tolerance=float(tolerance),
    )


def _labels(model: Any) -> list[str]:
    """Return the joint of each entry of v; with its number in joints that have several."""
    joints = ((model.names[i], model.joints[i].nv) for i in range(1, model.njoints))
    return [f"{name}[{k}]" if nv > 1 else str(name) for name, nv in joints for k in range(nv)]


def _of_matrix(term: str, labels: Sequence[str], here: Array, there: Array, s: Array) -> TermCheck:
    errors = np.abs(here - there) / np.outer(s, s)
    i, j = (int(k) for k in np.unravel_index(errors.argmax(), errors.shape))
    where = labels[i] if i == j else f"{labels[i]}, {labels[j]}"
    return TermCheck(term, float(errors[i, j]), where, float(here[i, j]), float(there[i, j]))


def _of_vector(
    term: str, labels: Sequence[str], here: Array, there: Array, scale: Array, heaviest: float
) -> TermCheck:
    largest = max(float(np.abs(scale * here).max()), _LEAST * heaviest)
    errors = np.abs(scale * (here - there)) / largest
    i = int(errors.argmax())
    return TermCheck(term, float(errors[i]), labels[i], float(here[i]), float(there[i]))


def _of_loops(
    workspace: Workspace, q: Array, terms: Terms, theirs: MujocoTerms
) -> tuple[list[TermCheck], list[str]]:
    """Return gaps and rows of each loop that both have by name, rows of the others together."""
    here = _our_loops(workspace, q, terms.J)
    there = _with_hinges(theirs.loops, workspace, here)
    groups, notes = _paired(here, there)
    found = [
        _of_gap(name, here[name].violation, there[name].violation) for name in here if name in there
    ]
    whitened = np.linalg.inv(np.linalg.cholesky(terms.M)).T
    for name, ours, others in groups:
        # of a gear, one row, J does not depend on q
        found_gaps = (rows.violation for rows in (*ours, *others) if len(rows.J) > 1)
        open_by = max(found_gaps, key=lambda gap: gap.size, default=ConstraintViolation(0.0, 0.0))
        if open_by.size > tolerances.CLOSED:
            notes.append(f"J of {name} was not compared: it is open by {open_by}")
        else:
            found.append(_of_rows(name, _stacked(ours, whitened), _stacked(others, whitened)))
    return found, notes


def _paired(
    here: Mapping[str, LoopRows], there: Mapping[str, LoopRows]
) -> tuple[list[tuple[str, list[LoopRows], list[LoopRows]]], list[str]]:
    """Return what to compare with what: loops of one name, and all others together."""
    groups = [(name, [here[name]], [there[name]]) for name in here if name in there]
    mine = [name for name in here if name not in there]
    yours = [name for name in there if name not in here]
    if not (mine or yours):
        return groups, []
    groups.append((_OTHERS, [here[name] for name in mine], [there[name] for name in yours]))
    note = (
        f"loops that only one has by name, here {listed(mine) or 'none'}, in MuJoCo "
        f"{listed(yours) or 'none'}: their rows are compared together"
    )
    return groups, [note]


def _with_hinges(
    loops: Mapping[str, LoopRows], workspace: Workspace, here: Mapping[str, LoopRows]
) -> dict[str, LoopRows]:
    """Return MuJoCo's loops, a hinge's two points of the axis as one; their length is compared."""
    there = dict(loops)
    for bound in workspace.scene.bounds:
        name, axis = bound.name, f"{bound.name}_axis"
        if bound.size == 5 and there.keys() >= {name, axis}:
            J = np.vstack((there[name].J, there.pop(axis).J))
            there[name] = LoopRows(
                J, ConstraintViolation(there[name].violation.length, here[name].violation.angle)
            )
    return there


def _our_loops(workspace: Workspace, q: Array, J: Array) -> dict[str, LoopRows]:
    """Return the loops of the scene, their gaps as MuJoCo counts them."""
    c, found = workspace.violation(q), {}
    opened = gaps(workspace.scene, c)
    for bound in workspace.scene.bounds:
        gap = opened[bound.name]
        if bound.size == 1:
            gap = ConstraintViolation(gap.size, 0.0)
        found[bound.name] = LoopRows(J[bound.rows], gap)
    return found


def _of_gap(name: str, here: ConstraintViolation, there: ConstraintViolation) -> TermCheck:
    apart = float(np.abs(np.subtract(here, there)).max())
    return TermCheck("gap", apart, name, here.size, there.size)


def _stacked(loops: Sequence[LoopRows], whitened: Array) -> Array:
    return np.vstack([np.zeros((0, len(whitened))), *(rows.J @ whitened for rows in loops)])


def _of_rows(name: str, here: Array, there: Array) -> TermCheck:
    error = max(_beyond(here, there), _beyond(there, here))
    return TermCheck("J", error, name, None, None)


def _beyond(A: Array, B: Array) -> float:
    """Return the largest part of a row of A that B does not span, over the largest row."""
    largest = np.linalg.norm(A, axis=1).max(initial=0.0)
    if not largest:
        return 0.0
    _, sigma, Vt = np.linalg.svd(B, full_matrices=False)
    basis = Vt[counted(sigma)]
    return float(np.linalg.norm(A - A @ basis.T @ basis, axis=1).max() / largest)


def _beside(bridge: MujocoBridge) -> Iterator[str]:
    """Say what MuJoCo's model has beside the terms that are compared."""
    mj = bridge.model
    rubbing = [p.name for p in bridge.pairs if mj.dof_frictionloss[p.dof].any()]
    if rubbing:
        yield f"dry friction in MuJoCo only (frictionloss): {listed(rubbing)}"
    forces = {
        "gravity compensation": np.any(mj.body_gravcomp),
        "a medium": mj.opt.density or mj.opt.viscosity,
        "springs or dampers that are polynomials": np.any(getattr(mj, "jnt_stiffnesspoly", 0))
        or np.any(getattr(mj, "dof_dampingpoly", 0)),
        "tendons": Transmissions(mj).lost,
    }
    if any(forces.values()):
        there = listed([name for name, found in forces.items() if found])
        yield f"in MuJoCo only, where they add to passive forces: {there}"
    off = {"actuators": mj.nu, "limits of joints": np.count_nonzero(mj.jnt_limited),
           "contacts": np.count_nonzero(mj.geom_contype | mj.geom_conaffinity)}  # fmt: skip
    if any(off.values()):
        listed_off = listed([name for name, number in off.items() if number])
        yield f"switched off in MuJoCo for this: {listed_off}"
    if mj.neq:
        yield "equalities give way in MuJoCo: accelerations with closed loops are not compared"
        unlike = mj.neq - len(equalities_of(mj))
        if unlike:
            yield f"{unlike} equalities other than connect, weld and joint were not compared"
    if bridge.without:
        yield f"held where they are in MuJoCo: {listed(bridge.without)}"
