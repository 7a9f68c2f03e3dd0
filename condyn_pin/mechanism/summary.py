"""Summary: a scene in one screen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from textwrap import fill
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import show, tolerances
from condyn_pin._core.arguments import count_text, listed, short_list
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import null_space, rank_of
from condyn_pin._core.models import indices
from condyn_pin.dynamics.at_state import equations_of, gap_text, gaps_at
from condyn_pin.dynamics.nominal import pinocchio_constraints_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.mechanism.classification import Classification, classification
from condyn_pin.mechanism.closed_chains import chains_of
from condyn_pin.mechanism.rank import Rank
from condyn_pin.model.robot import Robot

_ROWS_SHOWN = 12
_COLUMNS = 100  # of a terminal: longer lines are folded
_ILL_CONDITIONED = 1e12
_OPEN = "the loops cannot be closed from the first posture: figures are of it, open"


@dataclass(frozen=True)
class Summary:
    """Contents of a scene, with its redundant rows, and what is not used.

    Attributes
    ----------
    robot : str
    nq, nv : int
    mass : float
        Mass [kg].
    constraints : tuple of (name, kind, rows)
        Each constraint: its name, its kind, and how many rows it has.
    rows, rank, mobility : int
        m; independent rows; nv - rank, the degrees of freedom left.
    gruebler : int
        nv - m: the mobility if every row counted.
    redundant : tuple of str
        Rows that can go here without changing the motion.
    only_here : tuple of str
        Those of them that are redundant at this configuration and not nearby: it is singular.
    singular : bool
        Whether the rank is lower here than nearby.
    singular_values : tuple of float
        Smallest and largest nonzero one of the constraint Jacobian in the metric of M [kg^-1/2].
    condition, delassus_condition : float
        Condition numbers of the mass matrix, and of the nonzero part of J M^-1 J^T.
    notes : tuple of str
        What deserves attention.
    unmodelled : tuple of str
        What the description has, changes the motion, and is not in the model.
    unused : tuple of str
        What else the description has and the dynamics do not use.
    source, licence : str
        Where the description comes from, and its licence.
    contacts : tuple of (name, text)
        Candidates for contact, and how far each is from touching there.
    classification : Classification or None
        What kind of system it is: holonomic or not, sclero- or rheonomic, index of the DAE.
    motors : tuple of str
        Joints with a motor of their own, and motors on several joints with these in brackets.
    """

    robot: str
    nq: int
    nv: int
    mass: float  # [kg]
    constraints: tuple[tuple[str, str, int], ...]
    rows: int
    rank: int
    mobility: int
    gruebler: int
    redundant: tuple[str, ...]
    only_here: tuple[str, ...]
    singular: bool
    singular_values: tuple[float, float]
    condition: float
    delassus_condition: float
    notes: tuple[str, ...]
    unmodelled: tuple[str, ...]
    unused: tuple[str, ...]
    source: str
    licence: str
    contacts: tuple[tuple[str, str], ...] = ()
    classification: Classification | None = None
    motors: tuple[str, ...] = ()

    def facts(self) -> dict[str, str]:
        """Return the summary as label and text, for printing."""
        rows = [f"{n} (only here)" if n in self.only_here else n for n in self.redundant]
        redundant = ", ".join(rows[:_ROWS_SHOWN]) or "none"
        if len(self.redundant) > _ROWS_SHOWN:
            redundant += f", and {len(self.redundant) - _ROWS_SHOWN} more"
        facts = {
            "robot": f"{self.robot}: nq {self.nq}, nv {self.nv}, {self.mass:.6g} kg",
            "rows": f"{self.rows}, rank {self.rank}, mobility {self.mobility}",
            "classification": str(self.classification or "unknown"),
            "Gruebler's count": f"{self.gruebler}",
            "redundant rows": redundant,
            "motors": ", ".join(self.motors) or "none",
            "singular values": "{:.3g} ... {:.3g} 1/sqrt(kg)".format(*self.singular_values),
            "condition of M": f"{self.condition:.1e}",
            "Delassus matrix": f"condition {self.delassus_condition:.1e} of its nonzero part",
            "source": self.source or "unknown",
            "licence": self.licence or "unknown",
        }
        if not self.rows:
            del facts["singular values"], facts["Delassus matrix"]
        return facts

    def _repr_html_(self) -> str:
        """Return the summary as HTML for a notebook."""
        facts = list(self.facts().items())
        listed = [(name, kind, str(rows)) for name, kind, rows in self.constraints]
        return show.page(
            f"Scene of {self.robot}",
            show.facts(facts),
            show.folded_html(
                "constraints", show.grid(("constraint", "kind", "rows"), listed), count=len(listed)
            ),
            show.folded_html(
                "contacts", show.grid(("contact", "distance"), self.contacts),
                count=len(self.contacts),
            ),
            show.folded_html(
                "changes the motion, and is not modelled", show.notes(self.unmodelled),
                count=0,
            ),
            show.folded_html("in the file and not used", show.notes(self.unused)),
            show.notes(self.notes),
        )  # fmt: skip

    def __str__(self) -> str:
        lines = list(self.facts().items())
        rows = ((n, kind, count_text(m, "row")) for n, kind, m in self.constraints)
        lines += [("constraint", f"{n}: {kind}, {count}") for n, kind, count in rows]
        lines += [("contact", f"{name}: {text}") for name, text in self.contacts]
        lines += [("not modelled", text) for text in self.unmodelled]
        lines += [("not used", text) for text in self.unused]
        lines += [("note", text) for text in self.notes]
        return "\n".join(
            fill(
                text, _COLUMNS, initial_indent=f"{label:<16} ", subsequent_indent=17 * " ",
                break_long_words=False, break_on_hyphens=False,
            )
            for label, text in lines
        )  # fmt: skip


def summarise(scene: Scene, q: ArrayLike | None) -> Summary:
    """Return the summary of a scene at q, the nominal state if it is None."""
    robot, at = scene.robot, scene.rank(q)
    notes = [*_notes(scene, at)]
    if q is None and not scene.nominal.closed:
        notes.insert(0, _OPEN)
    S = at.singular_values
    return Summary(
        robot=robot.name,
        nq=robot.nq,
        nv=robot.nv,
        mass=robot.mass,
        constraints=tuple((c.name, c.title, c.rows) for c in scene.constraints),
        rows=at.rows,
        rank=at.rank,
        mobility=at.mobility,
        gruebler=at.gruebler,
        redundant=at.redundant,
        only_here=at.only_here,
        singular=at.singular,
        singular_values=(float(S[at.rank - 1]), float(S[0])) if at.rank else (0.0, 0.0),
        condition=at.condition,
        delassus_condition=at.delassus_condition,
        notes=tuple(notes),
        unmodelled=(*robot.unmodelled, *_rotors(robot)),
        unused=tuple(_unused(scene)),
        source=robot.source,
        licence=robot.licence,
        contacts=tuple(_contacts(scene, at.q)),
        classification=classification(scene, at),
        motors=(
            *robot.actuated,
            *(f"{motor.name} ({', '.join(motor.weights)})" for motor in robot.coupled_motors),
        ),
    )


def _contacts(scene: Scene, q: Array) -> Iterator[tuple[str, str]]:
    """Yield the candidates for contact, and what their gaps are at q."""
    if not scene.contacts:
        return
    candidates, gaps = gaps_at(scene, q)
    texts = [
        gap_text(gap, is_length=is_length)
        for gap, is_length in zip(gaps.tolist(), candidates.is_length.tolist(), strict=True)
    ]
    yield from zip_longest(candidates.names, texts, fillvalue="dry friction")


def _rotors(robot: Robot) -> Iterator[str]:
    """Sentence on the joints with a rotor that is not in the inertia of the model."""
    model = robot.model
    geared = np.array(model.rotorInertia) * np.array(model.rotorGearRatio) ** 2
    lacking = np.array(model.armature) < (1.0 - tolerances.MOMENT) * geared
    if where := [n for n in robot.joints if lacking[indices(model, [n])[1]].any()]:
        names = short_list(where)
        yield f"rotors ({names}): add rotorInertia * rotorGearRatio**2 to model.armature"


def _unused(scene: Scene) -> Iterator[str]:
    robot = scene.robot
    yield from robot.unused
    for what, advice in (("damping", ": add Robot.passive_torque to tau"), ("friction", "")):
        values = getattr(robot.model, what)
        where = [n for n in robot.joints if values[indices(robot.model, [n])[1]].any()]
        if where and not any(what in text for text in robot.unused):  # else the reader said it
            yield f"joint {what} ({short_list(where)}){advice}"
    if robot.springs:
        joints = ", ".join(spring.joint for spring in robot.springs)
        yield f"springs ({joints}): add Robot.passive_torque to tau"
    if robot.spring_dampers:
        ends = ", ".join(f"{each.frame_a} - {each.frame_b}" for each in robot.spring_dampers)
        yield f"spring-dampers ({ends}): add Robot.passive_torque to tau"
    left_out = [loop.name for loop in robot.loops if loop not in scene.constraints]
    if left_out:
        yield f"loops that are not in this scene ({', '.join(left_out)})"


def _notes(scene: Scene, at: Rank) -> Iterator[str]:
    yield from at.notes
    if lost := scene.robot.lost_rows:
        yield f"rows of the file are missing, and this is another mechanism: {'; '.join(lost)}"
    if at.condition > _ILL_CONDITIONED:
        yield (
            f"M has a condition number of {at.condition:.0e}: look for bodies of next to no "
            "inertia; no method can be accurate on them"
        )
    model = scene.robot.model
    trees = ((model.names[i], model.subtrees[i]) for i in range(1, model.njoints))
    if massless := [n for n, tree in trees if not any(model.inertias[j].mass for j in tree)]:
        yield (
            f"nothing beyond {', '.join(massless)} has a mass: only an armature, or what the "
            "loops hang on it, moves there"
        )
    if at.mobility == 0 and scene.is_driven:
        yield "mobility 0: what is driven says how everything moves"
    elif at.mobility == 0:
        yield "mobility 0: nothing can move; a weld in place of a hinge does this"
    yield from _base_mobility(scene, at.q)
    if at.redundant and not at.singular:
        rows = count_text(len(at.redundant), "redundant row")
        yield f"{rows}: a is unique, lam is the smallest of many; DenseKKT needs mu > 0"
    if missing := pinocchio_constraints_of(scene).unsupported:
        yield (
            f"{', '.join(missing)}: Pinocchio has no such rows, so that Proximal and LCABA refuse "
            "the scene; what solves it instead takes five times as long, or more"
        )
    if rolling := [c.name for c in scene.constraints if c.on_velocity]:
        yield (
            f"{', '.join(rolling)}: rows on the velocity; mobility counts directions of motion, "
            "and they may lead to more places than that (is_integrable)"
        )
    limits = chains_of(scene).limits
    stops = {stop.iq for bound in scene.contact_bounds for stop in bound.stops}
    held = {joint for joint, iq in zip(limits.joints, limits.iq, strict=True) if iq in stops}
    outside = {j: by for j, by in limits.beyond(at.q).items() if j not in held}
    if outside:
        joints = ", ".join(f"{joint} by {by}" for joint, by in outside.items())
        yield f"beyond joint limits, which the scene has no stops for: {joints}"


# Freedom of a floating robot: how it can still move as one body, its joints held.
#
# With the columns of J that belong to the base, J_b (m, 6), these are the twists of its null space,
#
#     J_b (v, omega) = 0.
#
# A robot on two points turns about the line through them; on one, any way about it; what glides on
# a plane shifts in it. Each is told in words: pure shifts first, then turns.


_SMALL = 1e-6  # a component of a unit vector, or a distance [m], that counts as zero

Points = Sequence[tuple[str, Array]]


def _base_mobility(scene: Scene, q: Array) -> Iterator[str]:
    """Sentences on the mobility of each floating base that the constraints hold."""
    model, equations = scene.robot.model, equations_of(scene)
    J = equations.jacobian(q)
    ends = equations.placements(q)
    for i in range(1, model.njoints):
        name, joint = model.names[i], model.joints[i]
        alone = len(model.subtrees[i]) == 1  # a body without joints: mobility says it
        if model.parents[i] or alone or joint.shortname() != "JointModelFreeFlyer":
            continue
        J_b = J[:, joint.idx_v : joint.idx_v + 6].copy()
        of_robot = set(model.subtrees[i])
        for bound in scene.bounds:
            if bound.within(of_robot):
                J_b[bound.rows] = 0.0  # a loop of the robot itself holds nothing as one body
        free = null_space(J_b) if len(J_b) else np.eye(6)
        if len(free) in (0, 6):  # held, or flying
            continue
        oMb = equations.data.oMi[i]
        twists = np.array([oMb.toActionMatrix() @ twist for twist in free])
        points = _points(scene, ends, np.abs(J_b).max(axis=1))
        yield (
            f"{listed([each for each, _ in points])}: held by this, what hangs on {name} can still "
            f"{_motion_in_words(twists, points)}, as one body with its joints held"
        )


def _points(scene: Scene, ends: Sequence[Any], sizes: Array) -> Points:
    """Return names of the constraints that hold the base, and where in the world."""
    found = []
    for bound, pair in zip(scene.bounds, ends, strict=True):
        if pair is not None and sizes[bound.rows].any():
            found.append((bound.name, np.array(pair[bound.on_robot].translation)))
    return found


def _motion_in_words(twists: Array, points: Points) -> str:
    """Return in words how a body can move, from twists (k, 6) at the origin of the world."""
    _, S, Vt = np.linalg.svd(twists[:, 3:].T)
    turning = rank_of(S)
    mixed = Vt @ twists  # the last ones do not turn
    turns, shifts = mixed[:turning], mixed[turning:, :3]
    told = []
    if len(shifts):
        Q = np.linalg.qr(shifts.T)[0]  # what can be shifted besides is no part of a turn
        turns = np.hstack([turns[:, :3] - turns[:, :3] @ (Q @ Q.T), turns[:, 3:]])
        told = [_shifts(shifts)]
    if len(turns) == 1:
        told.append(_rotation_in_words(turns[0], shifts, points))
    elif len(turns):
        told.append(_rotations_in_words(turns, points))
    return " and ".join(told)


def _shifts(shifts: Array) -> str:
    if len(shifts) == 1:
        return f"shift along {_direction(shifts[0])}"
    if len(shifts) == 2:
        return f"shift in the plane across {_direction(np.cross(*shifts))}"
    return "shift any way"


def _rotation_in_words(twist: Array, shifts: Array, points: Points) -> str:
    v, omega = twist[:3], twist[3:]
    size = float(np.linalg.norm(omega))
    along = omega / size
    pitch = float(v @ along) / size  # [m/rad]
    if len(shifts) > 1 and np.linalg.norm(shifts @ along) < _SMALL:
        return f"turn about {_direction(along)}"  # anywhere in the plane
    middle = np.cross(along, v) / size
    on = [name for name, x in points if np.linalg.norm(np.cross(along, x - middle)) < _SMALL]
    if len(on) > 1:
        where = f"turn about the line through {listed(on)}"
    else:
        through = on[0] if on else _point(middle)
        where = f"turn about an axis along {_direction(along)} through {through}"
    return where if abs(pitch) < _SMALL else f"{where}, moving along it by {pitch:.3g} m/rad"


def _rotations_in_words(turns: Array, points: Points) -> str:
    how = "any way" if len(turns) == 3 else "about two axes"
    for name, x in points:
        # the point stands still in all of them
        if np.abs(turns[:, :3] + np.cross(turns[:, 3:], x)).max() < _SMALL:
            return f"turn {how} about {name}"
    return f"turn {how}"


def _direction(x: Array) -> str:
    """Return an axis of the world, or three numbers."""
    unit = x / np.linalg.norm(x)
    largest = int(np.abs(unit).argmax())
    if np.abs(np.delete(unit, largest)).max() < _SMALL:
        return f"the world's {'xyz'[largest]}"
    return _point(np.copysign(1.0, unit[largest]) * unit)


def _point(x: Array) -> str:
    return f"({', '.join(f'{each + 0.0:.3g}' for each in np.round(x, 6))})"
