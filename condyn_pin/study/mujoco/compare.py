"""Comparison of a robot with the same robot in MuJoCo: differing terms, and their causes.

The same question to both engines, term by term.

MuJoCo's terms are brought to Pinocchio's coordinates (`bridge`). A light link is to count as
a heavy one: with s_i = sqrt(M_ii), M is compared entry by entry relative to s_i s_j, forces as
f_i / s_i and accelerations as s_i a_i, both relative to the largest. Rows of a constraint are
scaled otherwise in MuJoCo, and in other axes; what they span is compared: the share of each row of
one that the other's leave.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import above_tolerance
from condyn_pin._core.models import whole_data
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import ConstraintViolation, Terms
from condyn_pin.dynamics.at_state import gaps
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.io.mjcf import Transmissions
from condyn_pin.io.mjcf_file import body_names, disabled
from condyn_pin.io.mjcf_write import scalar_axis
from condyn_pin.study.mujoco.bridge import (
    JointPair,
    LoopRows,
    MujocoBridge,
    MujocoTerms,
    axes,
    equalities_of,
    last_moving_joint,
)

# Where nothing acts and nothing moves, forces are compared with those of 1 m/s^2 or 1 rad/s^2 on
# the heaviest joint: rounding is no difference.
_LEAST: Final = 1.0

_OTHERS: Final = "loops of other names"


@one_blas_thread
def cross_check(
    bridge: MujocoBridge, q: ArrayLike, v: ArrayLike, tau: ArrayLike, tolerance: float
) -> CrossCheck:
    """Return the terms of both engines at a state, compared; see `MujocoBridge.compare`."""
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
        notes=(*notes, *_notes_on_uncompared(bridge)),
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
    groups, notes = _loop_pairs(here, there)
    found = []
    for name in (name for name in here if name in there):
        ours, others = here[name].violation, there[name].violation
        apart = float(np.abs(np.subtract(ours, others)).max())
        found.append(TermCheck("gap", apart, name, ours.size, others.size))
    whitened = np.linalg.inv(np.linalg.cholesky(terms.M)).T
    for name, mine, yours in groups:
        # of a gear, one row, J does not depend on q
        found_gaps = (rows.violation for rows in (*mine, *yours) if len(rows.J) > 1)
        open_by = max(found_gaps, key=lambda gap: gap.size, default=ConstraintViolation(0.0, 0.0))
        if open_by.size > tolerances.CLOSED:
            notes.append(f"J of {name} was not compared: it is open by {open_by}")
        else:
            A, B = _stacked_rows(mine, whitened), _stacked_rows(yours, whitened)
            found.append(
                TermCheck("J", max(_unspanned_part(A, B), _unspanned_part(B, A)), name, None, None)
            )
    return found, notes


def _loop_pairs(
    here: Mapping[str, LoopRows], there: Mapping[str, LoopRows]
) -> tuple[list[tuple[str, list[LoopRows], list[LoopRows]]], list[str]]:
    """Pairs of loops to compare: each shared name alone, all others together; and notes."""
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


def _stacked_rows(loops: Sequence[LoopRows], whitened: Array) -> Array:
    return np.vstack([np.zeros((0, len(whitened))), *(rows.J @ whitened for rows in loops)])


def _unspanned_part(A: Array, B: Array) -> float:
    """Return the largest part of a row of A that B does not span, over the largest row."""
    largest = np.linalg.norm(A, axis=1).max(initial=0.0)
    if not largest:
        return 0.0
    _, sigma, Vt = np.linalg.svd(B, full_matrices=False)
    basis = Vt[above_tolerance(sigma)]
    return float(np.linalg.norm(A - A @ basis.T @ basis, axis=1).max() / largest)


def _notes_on_uncompared(bridge: MujocoBridge) -> Iterator[str]:
    """Notes on parts of MuJoCo's model that are not compared, a sentence each."""
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
        yield "equalities are soft in MuJoCo: accelerations with closed loops are not compared"
        unlike = mj.neq - len(equalities_of(mj))
        if unlike:
            yield f"{unlike} equalities other than connect, weld and joint were not compared"
    if bridge.without:
        yield f"held where they are in MuJoCo: {listed(bridge.without)}"


# Why two engines differ: what their models say of each joint and each body, side by side.
#
# Joints are looked at from the root outwards. Where a joint stands elsewhere, all that it carries
# does too: of that, only what does not depend on the place is compared, so that the first cause is
# not followed by its consequences.
#
# What a joint carries is, in MuJoCo, its body and all that is fixed to it:
#
#     m = sum m_b,    m c = sum m_b c_b,    I = sum (R_b diag(I_b) R_b' + m_b (|d|^2 1 - d d')),
#     d = c_b - c.


def causes(bridge: MujocoBridge, data: Any, q: Array, tolerance: float) -> tuple[str, ...]:
    """Return the differences of the models, a sentence each, the root first."""
    # `data` has MuJoCo's placements of the bodies at q; the tolerance is relative.
    return tuple(_Causes(bridge, data, q, tolerance).all())


class _Causes:
    """Both models at one configuration."""

    def __init__(self, bridge: MujocoBridge, data: Any, q: Array, tolerance: float) -> None:
        self.robot, self.model, self.mj = bridge.robot, bridge.robot.model, bridge.model
        self.pairs, self.data, self.tolerance = bridge.pairs, data, tolerance
        self.bodies, self.had = body_names(self.mj), Transmissions(self.mj)
        self.placed = whole_data(self.model)
        pin.forwardKinematics(self.model, self.placed, q)
        among = {pair.there: pair.here for pair in self.pairs}
        self.holders = [last_moving_joint(self.mj, body, among) for body in range(self.mj.nbody)]
        # lengths are compared with the largest one in the robot [m], of a lone body with its own
        placements = (M.translation for M in tuple(self.model.jointPlacements)[1:])
        bodies = tuple(self.model.inertias)
        own = (np.sqrt(np.abs(Y.inertia).max() / Y.mass) for Y in bodies if Y.mass)
        lengths = (*placements, *(Y.lever for Y in bodies), *own)
        self.length = max(float(np.abs(x).max()) for x in lengths)

    def all(self) -> Iterator[str]:
        ours = self.model.gravity.linear
        theirs = self.mj.opt.gravity * (not disabled(self.mj, "GRAVITY"))
        if self._differ(ours, theirs):
            yield f"gravity: {_text(ours)} m/s^2 here, {_text(theirs)} in MuJoCo"
        displaced: set[int] = set()
        for pair in self.pairs:
            yield from self._joint(pair)
            elsewhere = self.model.parents[pair.here] in displaced
            moved = "" if elsewhere else self._place(pair) or self._zero(pair)
            carried = self._carried(pair, placed=not (elsewhere or moved))
            if moved:
                yield f"joint {pair.name}: {moved}; places of what it carries were not compared"
            if elsewhere or moved:
                displaced.add(pair.here)
            body = self.bodies[self.mj.jnt_bodyid[pair.there]]
            yield from (f"body {body} (joint {pair.name}): {said}" for said in carried)

    def _differ(self, ours: Any, theirs: Any, scale: float | None = None) -> bool:
        """True if numbers differ by more than tolerance times scale, by default the largest."""
        if scale is None:
            scale = max(float(np.abs(ours).max()), float(np.abs(theirs).max()))
        return float(np.abs(np.subtract(ours, theirs)).max()) > self.tolerance * scale

    def _joint(self, pair: JointPair) -> Iterator[str]:
        """Differences of armature, damping, stiffness and rest of a joint, a sentence each."""
        turns = pair.kind != "slide"
        springs = [(s.stiffness, s.reference) for s in self.robot.springs if s.joint == pair.name]
        k, rest = _combined_spring(springs)
        k_there, at = _combined_spring([(s, r) for j, s, r in self.had.springs if j == pair.there])
        for name, unit, ours, theirs in (
            (
                "armature", "kg m^2" if turns else "kg",
                self.model.armature[pair.v], self.had.armature[pair.dof],
            ),
            (
                "damping", "N m s/rad" if turns else "N s/m",
                self.model.damping[pair.v], self.had.damping[pair.dof],
            ),
            ("stiffness", "N m/rad" if turns else "N/m", k, k_there),
        ):  # fmt: skip
            if self._differ(ours, theirs):
                here, there = _text(_common_value(ours)), _text(_common_value(theirs))
                yield f"joint {pair.name}: {name} {here} {unit} here, {there} in MuJoCo"
        if k and k_there and abs(rest - at) > self.tolerance:
            text = f"{rest:.9g} {'rad' if turns else 'm'} here, {at:.9g} in MuJoCo"
            yield f"joint {pair.name}: its spring rests at {text}"

    def _place(self, pair: JointPair) -> str:
        """Difference of the axis or the position of a joint, as text; empty if there is none."""
        if pair.kind == "free":
            return ""
        s, s_there = axes(self.model, self.placed, self.data, pair)
        if self._differ(s, s_there, 1.0):
            return f"its axis is {_text(s.T)} here, {_text(s_there.T)} in MuJoCo, in the world"
        p, p_there = self.placed.oMi[pair.here].translation, self.data.xanchor[pair.there]
        apart = p_there - p
        if pair.kind == "hinge":  # any point of the axis will do
            apart = apart - s * (s @ apart)
        if pair.kind == "slide" or not self._differ(apart, 0.0, self.length):
            return ""
        d = np.linalg.norm(apart)
        return (
            f"it stands at {_text(p)} m here, at {_text(p_there)} in MuJoCo, in the world, {d:.3g} "
            "m off"
        )

    def _zero(self, pair: JointPair) -> str:
        """Offset of the joint zero that explains a moved centre of mass, as text; else empty."""
        m, c, _ = self._inertia(pair)
        ours, oMi = self.model.inertias[pair.here], self.placed.oMi[pair.here]
        if pair.kind not in ("hinge", "slide") or not (m and ours.mass):
            return ""
        s = scalar_axis(self.model, pair.here)[1]
        here, there = ours.lever, oMi.actInv(c)
        if pair.kind == "slide":
            shift, unit = float(s @ (there - here)), "m"
            explained = here + shift * s
        else:
            shift = float(
                np.arctan2(s @ np.cross(here, there), np.cross(s, here) @ np.cross(s, there))
            )
            explained, unit = pin.exp3(shift * s) @ here, "rad"
        if self._differ(explained, there, self.length) or not self._differ(
            here, there, self.length
        ):
            return ""
        return (
            f"the same coordinate puts it {shift:.6g} {unit} further in MuJoCo: another zero (ref?)"
        )

    def _carried(self, pair: JointPair, *, placed: bool) -> Iterator[str]:
        """Differences of mass, centre of mass and inertia about it, in the axes of the joint."""
        ours = self.model.inertias[pair.here]
        m, c, inertia = self._inertia(pair)
        if self._differ(ours.mass, m):
            yield f"mass {ours.mass:.9g} kg here, {m:.9g} in MuJoCo"
        if not (placed and ours.mass and m):
            return
        oMi = self.placed.oMi[pair.here]
        lever = oMi.actInv(c)
        if self._differ(ours.lever, lever, self.length):
            d = np.linalg.norm(ours.lever - lever)
            yield (
                f"centre of mass {_text(ours.lever)} m here, {_text(lever)} in MuJoCo, {d:.3g} m "
                "off"
            )
        about = oMi.rotation.T @ inertia @ oMi.rotation
        if self._differ(ours.inertia, about):
            moments, there = np.linalg.eigvalsh(ours.inertia), np.linalg.eigvalsh(about)
            if self._differ(moments, there):
                yield f"principal moments {_text(moments)} kg m^2 here, {_text(there)} in MuJoCo"
            else:
                yield f"principal moments {_text(moments)} kg m^2 in both, about other axes"

    def _inertia(self, pair: JointPair) -> tuple[float, Array, Array]:
        """Mass, centre of mass and inertia about it of bodies on MuJoCo's joint, in the world."""
        carried = [b for b in range(self.mj.nbody) if self.holders[b] == pair.there]
        masses, centres = self.mj.body_mass[carried], self.data.xipos[carried]
        m = float(masses.sum())
        c = masses @ centres / m if m else np.zeros(3)
        inertia = np.zeros((3, 3))
        for body, mass, centre in zip(carried, masses, centres, strict=True):
            R, d = self.data.ximat[body].reshape(3, 3), centre - c
            inertia += R @ np.diag(self.mj.body_inertia[body]) @ R.T
            inertia += mass * (d @ d * np.eye(3) - np.outer(d, d))
        return m, c, inertia


def _combined_spring(springs: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return stiffness and rest of springs, as one."""
    k = sum(stiffness for stiffness, _ in springs)
    return k, sum(stiffness * rest for stiffness, rest in springs) / k if k else 0.0


def _common_value(values: Any) -> Array:
    """The common value of equal numbers, else all of them."""
    array = np.atleast_1d(np.asarray(values, dtype=float))
    return array[:1] if np.ptp(array) == 0.0 else array


def _text(values: Any) -> str:
    numbers = ", ".join(f"{x:.7g}" for x in np.ravel(values))
    return numbers if np.size(values) == 1 else f"({numbers})"


# CrossCheck: what two engines say of one robot at one state, and where their models differ.


@dataclass(frozen=True)
class TermCheck:
    """One term in both engines.

    Attributes
    ----------
    term : str
        M, h, passive (springs and damping), a, gap or J.
    error : float
        Relative to the size of the term, scaled by sqrt(M_ii) so that light joints count as heavy
        ones; of a gap, the difference [m, rad].
    where : str
        The joints, or the loop, with the largest error.
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
    """The terms of both engines at one state, and where their models differ.

    Attributes
    ----------
    robot : str
    terms : tuple of TermCheck
        M, h, springs and damping, a without constraints, and of loops the gap and the rows.
    causes : tuple of str
        Differences of the models, the root first, a sentence each: a body's mass, an armature, a
        place. Also those that do not show at this state.
    notes : tuple of str
        What MuJoCo's model has besides, which was not compared.
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
        """True if every term agrees at this state."""
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
