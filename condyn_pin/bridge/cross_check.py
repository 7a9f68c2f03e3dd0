"""CrossCheck: the same question to both engines, term by term.

MuJoCo's terms are brought to Pinocchio's coordinates (`mujoco_terms`). A light link is to count as
a heavy one: with s_i = sqrt(M_ii), M is compared entry by entry relative to s_i s_j, forces as
f_i / s_i and accelerations as s_i a_i, both relative to the largest. Rows of a constraint are
scaled otherwise in MuJoCo, and in other axes; what they span is compared: the share of each row of
one that the other's leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arguments import Arguments
from condyn_pin.arrays import Array
from condyn_pin.bridge.causes import causes
from condyn_pin.bridge.mujoco_terms import LoopRows, MujocoTerms, equalities_of
from condyn_pin.constraints import Loop
from condyn_pin.errors import InvalidArgument
from condyn_pin.names import listed
from condyn_pin.rows.terms import Terms
from condyn_pin.scene import Scene
from condyn_pin.states.gaps import Gap, gaps
from condyn_pin.workspace import Workspace

if TYPE_CHECKING:
    from condyn_pin.bridge.mujoco_bridge import MujocoBridge

# Where nothing acts and nothing moves, forces are compared with those of 1 m/s^2 or 1 rad/s^2 on
# the heaviest joint: rounding is no difference.
_LEAST: Final = 1.0


@dataclass(frozen=True)
class TermCheck:
    """One term in both engines.

    Attributes
    ----------
    term : str
        M, h, passive (springs and damping), a, gap or J.
    error : float
        Relative to the size of the term, light joints counted as heavy ones; of a gap, the
        difference [m, rad].
    where : str
        The joints, or the loop, where it is largest.
    here, there : float or None
        The numbers there, of Pinocchio and of MuJoCo [kg, kg m, kg m^2; N, N m; m/s^2, rad/s^2;
        m, rad]; None of J, whose rows are scaled otherwise in MuJoCo.
    """

    term: str
    error: float
    where: str
    here: float | None
    there: float | None


@dataclass(frozen=True)
class CrossCheck:
    """What both engines say at one state, and where their models differ.

    Attributes
    ----------
    robot : str
    terms : tuple of TermCheck
        M, h, springs and damping, a without constraints, and of loops the gap and the rows.
    causes : tuple of str
        Differences of the models, the root first, a sentence each: a body's mass, an armature, a
        place. Also those that do not show at this state.
    notes : tuple of str
        What MuJoCo's model has beside, and was not compared.
    tolerance : float
        Error that counts as none: relative, of gaps [m, rad].
    """

    robot: str
    terms: tuple[TermCheck, ...]
    causes: tuple[str, ...]
    notes: tuple[str, ...]
    tolerance: float

    @property
    def ok(self) -> bool:
        """Whether every term agrees at this state."""
        return all(term.error <= self.tolerance for term in self.terms)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, for json."""
        return asdict(self) | {"ok": self.ok}

    def __str__(self) -> str:
        found = "agree" if self.ok else "differ"
        lines = [f"{self.robot}: Pinocchio and MuJoCo {found}, to {self.tolerance:g}"]
        lines += [f"{'term':<8} {'error':<8} {'here':>14} {'MuJoCo':>14}  where it is largest"]
        for term in self.terms:
            numbers = (f"{'' if x is None else f'{x:.8g}':>14}" for x in (term.here, term.there))
            mark = "  <-" if not term.error <= self.tolerance else ""
            line = f"{term.term:<8} {term.error:<8.1e} {' '.join(numbers)}  {term.where}{mark}"
            lines.append(line.rstrip())
        lines += [f"differs: {cause}" for cause in self.causes]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])


def cross_check(
    bridge: MujocoBridge, q: ArrayLike, v: ArrayLike, tau: ArrayLike, tolerance: float
) -> CrossCheck:
    """Return what both engines say at a state; `MujocoBridge.compare` has the words."""
    if not (isinstance(tolerance, (float, int)) and 0.0 < tolerance < 1.0):
        raise InvalidArgument(f"tolerance = {tolerance!r}: a number between 0 and 1 is needed")
    robot = bridge.robot
    workspace = Workspace(Scene(robot, robot.loops))
    q_, v_, tau_ = Arguments(robot.model).check(q, v, tau)
    theirs = MujocoTerms(bridge, q_, v_, tau_)
    terms, passive = workspace.terms(q_, v_), robot.passive_torque(q_, v_)
    a = pin.aba(robot.model, robot.model.createData(), q_, v_, tau_ + passive)
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
    """Return gaps and rows of each loop that both have by name; rows of the others together."""
    here, there = _our_loops(workspace, q, terms.J), dict(theirs.loops)
    for loop in workspace.scene.robot.loops:
        axis = f"{loop.name}_axis"
        if isinstance(loop, Loop) and loop.kind == "hinge" and there.keys() >= {loop.name, axis}:
            point, second = there[loop.name], there.pop(axis)  # two points of its axis
            gap = Gap(point.gap.length, here[loop.name].gap.angle)
            there[loop.name] = LoopRows(np.vstack((point.J, second.J)), gap)
    both = [name for name in here if name in there]
    found = [_of_gap(name, here[name].gap, there[name].gap) for name in both]
    groups = [(name, [here[name]], [there[name]]) for name in both]
    mine, others = ([n for n in each if n not in both] for each in (here, there))
    notes = []
    if mine or others:
        nothing = LoopRows(np.zeros((0, terms.h.size)), Gap(0.0, 0.0))
        ours, theirs_ = [here[n] for n in mine], [there[n] for n in others]
        groups.append(("loops of other names", [nothing, *ours], [nothing, *theirs_]))
        notes.append(
            f"loops that only one has by name, here {listed(mine) or 'none'}, in MuJoCo "
            f"{listed(others) or 'none'}: their rows are compared together"
        )
    whitened = np.linalg.inv(np.linalg.cholesky(terms.M)).T
    for name, *sides in groups:
        bodies = (rows.gap.size for side in sides for rows in side if len(rows.J) > 1)
        open_by = max(bodies, default=0.0)  # of a gear J does not depend on q
        if open_by > tolerances.CLOSED:
            notes.append(f"J of {name} was not compared: it is open by {open_by:.2g} m or rad")
        else:
            J, J_there = (np.vstack([rows.J @ whitened for rows in side]) for side in sides)
            error = max(_beyond(J, J_there), _beyond(J_there, J))
            found.append(TermCheck("J", error, name, None, None))
    return found, notes


def _our_loops(workspace: Workspace, q: Array, J: Array) -> dict[str, LoopRows]:
    """Return the loops of the scene, their gaps as MuJoCo counts them."""
    c, found = workspace.violation(q), {}
    opened = gaps(workspace.scene, c)
    for bound in workspace.scene.bounds:
        gap = opened[bound.name]
        if bound.size == 6:  # between the ends of a weld, not along its twist
            gap = Gap(float(np.linalg.norm(pin.exp6(-c[bound.rows]).translation)), gap.angle)
        elif bound.size == 1:
            gap = Gap(gap.size, 0.0)
        found[bound.name] = LoopRows(J[bound.rows], gap)
    return found


def _of_gap(name: str, here: Gap, there: Gap) -> TermCheck:
    apart = float(np.abs(np.subtract(here, there)).max())
    return TermCheck("gap", apart, name, here.size, there.size)


def _beyond(A: Array, B: Array) -> float:
    """Return the largest part of a row of A that B does not span, over the largest row."""
    largest = np.linalg.norm(A, axis=1).max(initial=0.0)
    if not largest:
        return 0.0
    _, sigma, Vt = np.linalg.svd(B, full_matrices=False)
    basis = Vt[sigma > tolerances.RANK * sigma.max(initial=0.0)]
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
        "tendons": mj.ntendon,
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
