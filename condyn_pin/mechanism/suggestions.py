"""Suggestions: simplifications of a scene, row by row.

What may be left out of a scene: simplifications to try, those that are exact first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, Literal, get_args

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked_names, listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, first_of_largest, rank_of
from condyn_pin._core.models import indices
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.line_contact import LineContact
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.rows.bound import BoundConstraint, Terms
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, InvalidConstraint, InvalidModel
from condyn_pin.mechanism.reduction import ReducedScene, reduced_scene, without
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import free_flyers, smaller_robot, split_constraints


@dataclass(frozen=True)
class Suggestion:
    """A simplification: what it is in words, and how it is made."""

    what: str
    make: Callable[[ReducedScene], ReducedScene]


def suggestions(
    scene: ReducedScene, moving: Set[str], asked: Sequence[str], *, exact_rows: bool
) -> Iterator[Suggestion]:
    """Yield simplifications of a scene."""
    # Joints that are `moving` have to move, and those whose accelerations are `asked` for are kept.
    # Without `exact_rows` the solver would refuse some kinds of constraints, or make more rows of
    # them again: these are not proposed.
    still = [n for n in scene.robot.joints if n not in moving and n not in asked]
    if still and len(still) < len(scene.robot.joints):
        index, _ = indices(scene.full.robot.model, scene.robot.joints)
        yield Suggestion(
            f"joints that do not move locked: {listed(still)}",
            _applied(ReducedScene.lock, still, np.array(scene.held)[index]),
        )
    if merge_points(scene, edges=exact_rows).rows < scene.rows:
        yield Suggestion(
            "points on one body merged into one contact",
            _applied(merge_points, edges=exact_rows),
        )
    for name in _implied_constraints(scene):
        yield Suggestion(
            f"constraint {name} left out: the others imply it", _applied(without, [name])
        )
    for loop, joints in _linkages(scene, asked):
        yield Suggestion(
            f"loop {loop} left out, and {listed(joints)} that only follow it reflected",
            _applied(without_linkage, [loop], joints),
        )
    if not exact_rows:
        return
    for name in scene.robot.joints:
        if name not in asked and is_rod(scene, name):
            yield Suggestion(f"rod on {name} as a distance", _applied(rods_as_distances, [name]))
    for name in _planar_balls(scene):
        yield Suggestion(
            f"loop {name} as a planar pin: its third row is redundant",
            _applied(as_planar, name),
        )


def _applied(
    simplify: Callable[..., ReducedScene], *args: Any, **options: Any
) -> Callable[[ReducedScene], ReducedScene]:
    """Return a function of a scene that simplifies it so."""
    return lambda scene: simplify(scene, *args, **options)


def _implied_constraints(scene: ReducedScene) -> Iterator[str]:
    """Yield constraints without which the rank is the same."""
    terms = scene.nominal.terms
    for bound in scene.bounds:
        others = np.delete(terms.J, bound.rows, axis=0)
        if factorise(terms.M, others, tolerances.RANK).rank == scene.nominal.rank:
            yield bound.name


def _linkages(scene: ReducedScene, asked: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield loops with the passive branch that ends in one of their sides."""
    model = scene.robot.model
    sprung = [spring.joint for spring in scene.robot.springs]
    busy = [j for c in scene.constraints for j in set(c.sides(scene.robot))]
    kept = {*asked, *scene.robot.motor_joints, *sprung, *free_flyers(scene.robot)}
    for loop in scene.constraints:
        if not loop.is_pin:
            continue
        for end in loop.sides(scene.robot):
            joints: list[str] = []
            allowed = 1  # constraints on the body: the loop itself, then none
            while (
                end
                and model.names[end] not in kept
                and busy.count(end) == allowed
                and len(model.children[end]) == len(joints[-1:])
            ):
                joints.append(str(model.names[end]))
                end, allowed = model.parents[end], 0
            if joints and are_determined_by(scene, [loop.name], joints):
                yield loop.name, joints


def _planar_balls(scene: ReducedScene) -> Iterator[str]:
    """Yield ball loops with a redundant row of their own."""
    M, J = scene.nominal.terms.M, scene.nominal.terms.J
    for loop, bound in zip(scene.constraints, scene.bounds, strict=True):
        is_ball = loop.as_planar_pin(loop.name) is not None
        if is_ball and factorise(M, J[bound.rows], tolerances.RANK).rank == 2:
            yield bound.name


# The same motion by fewer rows: points of one body as one contact, a ball in a plane as a pin.
#
# The velocities of points that do not lie on a line leave a body no freedom, as a surface does (6
# rows); those of points on a line leave the turn about it, as an edge does (5 rows).
#
# A ball that closes a planar linkage has two independent rows in place of three,
#
#     J_ball = U S V^T,     S = (s1, s2, 0),     n = u3.
#
# The third column of U is the direction in which the ball says nothing, the normal of the plane. It
# becomes the z axis of a new frame at `frame_a`, so that the force is still the one on that body.


_FLAT = 1e-6  # singular values of the points' spread below this, relative to the largest, are zero


def merge_points(scene: Scene, *, edges: bool = True) -> ReducedScene:
    """Return the scene with the points on each frame merged into an edge or a surface: exact.

    Only points without an anchor are merged: they do not fix the position, so nothing is lost. The
    merged contact has the name of the frame, or ``frame/edge`` for an edge, which gets a new frame;
    if the name is taken, a number is appended.

    Parameters
    ----------
    scene : Scene
    edges : bool
        Merge points on a line too. Solvers that know no edges make two points of it again.

    Returns
    -------
    ReducedScene
    """
    robot, constraints, dropped = scene.robot, list(scene.constraints), []
    on_frames: dict[str, list[Constraint]] = {}
    for constraint in constraints:
        if constraint.point is not None and constraint.drift is None:
            (frame,) = constraint.frames
            on_frames.setdefault(frame, []).append(constraint)
    for frame, points in on_frames.items():
        if _spread(points)[1][0] <= 0 or (not edges and _on_a_line(points)):
            continue
        at = constraints.index(points[0])
        constraints = [c for c in constraints if c not in points]
        robot, merged = _merge(robot, frame, points, {c.name for c in constraints})
        constraints.insert(at, merged)
        rows = sum(p.rows for p in points)
        dropped.append(f"contacts on {frame}: {rows} rows of points as {merged.rows} of one")
    return reduced_scene(scene, robot, constraints, described_posture(scene), dropped)


def _spread(points: Sequence[Constraint]) -> tuple[Array, Array, Array]:
    """Return the middle of the points, the singular values of their spread, and the directions."""
    offsets = np.array([point.point for point in points])
    middle = offsets.mean(axis=0)
    _, S, directions = np.linalg.svd(offsets - middle)
    return middle, np.pad(S, (0, 3 - len(S))), directions


def _on_a_line(points: Sequence[Constraint]) -> bool:
    _, S, _ = _spread(points)
    return bool(S[1] <= _FLAT * S[0])


def _merge(
    robot: Robot, frame: str, points: Sequence[Constraint], taken: Collection[str]
) -> tuple[Robot, Constraint]:
    """Return the contact that the points make, and the robot with its frame; `taken` are names."""
    if not _on_a_line(points):
        name = next(name for name in _numbered(frame) if name not in taken)
        return robot, SurfaceContact(frame, name=name)
    middle, _, directions = _spread(points)
    x, y = directions[0], directions[1]
    R = np.column_stack([x, y, np.cross(x, y)])
    joint, placement = robot.frame(frame)
    place = joint, placement * pin.SE3(R, middle)
    name = next(
        name
        for name in _numbered(f"{frame}/edge")
        if name not in taken and (name not in robot.frames or _is_at(robot, name, place))
    )
    if name not in robot.frames:
        robot = robot.with_frame(name, frame, middle, R)
    half = max(abs(float((np.array(p.point) - middle) @ x)) for p in points)
    return robot, LineContact(name, axis="x", half_length=half)


def _numbered(name: str) -> Iterator[str]:
    """Yield a name, and then the same with numbers from 2 on."""
    yield name
    yield from (f"{name} {i}" for i in count(2))


def _is_at(robot: Robot, frame: str, place: tuple[int, Any]) -> bool:
    """True if a frame is on a joint and at a placement, as one of an earlier merge can be."""
    try:
        joint, placement = robot.frame(frame)
    except InvalidModel:  # several frames of this name
        return False
    return joint == place[0] and bool(placement == place[1])


def as_planar(scene: Scene, name: str) -> ReducedScene:
    """Return the scene with a ball loop made planar, without its row across the plane.

    Exact: of the three rows of such a ball, two are independent.

    Parameters
    ----------
    scene : Scene
    name : str
        Of the loop.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such constraint.
    InvalidConstraint
        If the loop is no ball, or its rows have another rank than 2.
    """
    (chosen,) = checked_names("name", [name], scene.names, "constraint")
    at = scene.names.index(chosen)
    loop, bound = scene.constraints[at], scene.bounds[at]
    frame = f"{name}/plane"
    pin_joint = loop.as_planar_pin(frame)
    if pin_joint is None:
        raise InvalidConstraint(f"{name}: a loop of kind ball is needed")
    U, S, _ = np.linalg.svd(scene.nominal.terms.J[bound.rows])
    if (rank := rank_of(S)) != 2:
        said = (
            "independent: no plane is left free" if rank == 3 else f"of rank {rank}: no one plane"
        )
        raise InvalidConstraint(f"{name}: its three rows are {said}")
    normal = _in_axes_of_first(scene, bound, U[:, 2])
    robot = scene.robot.with_frame(frame, loop.frames[0], np.zeros(3), _axes(normal))
    if loop in robot.loops:
        loops = [pin_joint if known == loop else known for known in robot.loops]
        robot = replace(robot, loops=loops)
    constraints = [pin_joint if c.name == name else c for c in scene.constraints]
    words = f"loop {name}: a planar pin, the row across the plane being redundant"
    return reduced_scene(scene, robot, constraints, described_posture(scene), (words,))


def _in_axes_of_first(scene: Scene, bound: BoundConstraint, direction: Array) -> Array:
    """Return a direction in the axes of the rows in those of the frame that was named first."""
    # The two differ where that frame is the world's, which no row is written in.
    if bound.sign > 0:
        return direction
    q = scene.nominal.q
    ends = equations_of(scene).placements(q)[scene.bounds.index(bound)]
    assert ends is not None  # a loop has two of them
    rows, first = ends
    turned: Array = first.rotation.T @ rows.rotation @ direction
    return turned


def _axes(normal: Array) -> Array:
    """Return axes with z along the normal, the way that its largest component is positive."""
    normal = normal * np.sign(normal[first_of_largest(np.abs(normal))])
    least_along = first_of_largest(1.0 - np.abs(normal))
    x = np.cross(np.eye(3)[least_along], normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


# Linkages that only follow: passive bodies whose motion a loop ties to another joint.
#
# A loop over the passive joints p and the others r gives
#
#     J_p v_p + J_r v_r = 0,      v_p = G v_r,      G = -J_p^+ J_r.
#
# Without the loop, and with the passive bodies welded where they are, each other joint moves the
# inertia and the damping that it felt through the linkage,
#
#     armature_r += (G^T M_pp G)_rr,      damping_r += (G^T D_pp G)_rr,
#
# at the nominal state. What is lost is how G and M_pp vary, and how the bodies move the centre of
# mass.


def without_linkage(scene: Scene, loops: Sequence[str], joints: Sequence[str]) -> ReducedScene:
    """Return the scene without a linkage that only follows another joint.

    Its loops are left out and its bodies welded at the nominal state; their inertia and damping
    are reflected onto the joints that they followed, as armature and damping.

    Parameters
    ----------
    scene : Scene
    loops : sequence of str
        Names of constraints.
    joints : sequence of str
        The joints of the linkage.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such loop or joint.
    InvalidArgument
        If a motor or a spring acts on one of the joints.
    InvalidConstraint
        If the loops also hold other joints than these.
    """
    gone = checked_names("loops", loops, scene.names, "constraint")
    names = checked_names("joints", joints, scene.robot.joints, "joint")
    for name in names:
        check_passive(scene.robot, name)
    q = scene.state()[0]
    armature, damping = _reflected(scene, gone, names, q)
    model = pin.Model(scene.robot.model)
    model.armature = np.array(model.armature) + armature
    model.damping = np.array(model.damping) + damping
    words = (
        f"linkages that only follow: bodies of {listed(names)} welded, loops {listed(gone)} left "
        "out; inertia and damping reflected onto the joints that they followed"
    )
    open_robot: Robot = replace(
        scene.robot,
        model=model,
        loops=tuple(loop for loop in scene.robot.loops if loop.name not in gone),
    )
    robot = smaller_robot(open_robot, names, q, words)
    kept, _ = split_constraints(robot, [c for c in scene.constraints if c.name not in gone])
    return reduced_scene(scene, robot, kept, q, (words,), found=names)


def check_passive(robot: Robot, joint: str) -> None:
    """Raise InvalidArgument if a motor or a spring acts on a joint."""
    if joint in robot.motor_joints or joint in (spring.joint for spring in robot.springs):
        what = "motor" if joint in robot.motor_joints else "spring"
        raise InvalidArgument(f"joint {joint!r}: a {what} acts on it, so it does not only follow")


def are_determined_by(scene: Scene, loops: Sequence[str], joints: Sequence[str]) -> bool:
    """True if loops determine the positions of some joints, and restrict no others."""
    # That is so if the rows of the loops have the same rank in the columns of these joints alone.
    J = _of_loops(scene, scene.nominal.terms, loops)
    p = indices(scene.robot.model, joints)[1]
    of_passive, of_all = (rank_of(np.linalg.svd(each, compute_uv=False)) for each in (J[:, p], J))
    return of_passive == of_all


def _of_loops(scene: Scene, terms: Terms, loops: Sequence[str]) -> Array:
    return terms.J[rows_of([bound for bound in scene.bounds if bound.name in loops])]


def _reflected(
    scene: Scene, loops: Sequence[str], joints: Sequence[str], q: Array
) -> tuple[Array, Array]:
    """Return the armature and damping that the joints of the tree gain, an entry each of v."""
    if not are_determined_by(scene, loops, joints):
        raise InvalidConstraint(
            f"loops {listed(loops)}: they do not only tell {listed(joints)} where to be, they also "
            "hold other joints"
        )
    model = scene.robot.model
    terms = equations_of(scene).terms(q, np.zeros(model.nv))
    _, p = indices(model, joints)
    _, floating = indices(model, free_flyers(scene.robot))
    r = np.setdiff1d(np.arange(model.nv), [*p, *floating])
    J = _of_loops(scene, terms, loops)
    G = -np.linalg.pinv(J[:, p], rcond=tolerances.RANK) @ J[:, r]
    armature, damping = np.zeros((2, model.nv))
    armature[r] = np.einsum("ir,ij,jr->r", G, terms.M[np.ix_(p, p)], G)
    damping[r] = np.array(model.damping)[p] @ G**2
    return armature, damping


# Rods as distances: a light body with a joint at each end becomes one row.
#
# A rod of mass m hangs on a body by a ball or a hinge at p1, and a loop ties its other end p2 to
# another body. Without inertia it carries force along p2 - p1 only, so that all it does is
#
#     |p2 - p1| = length.
#
# Its mass goes, or is shared by its ends so that total mass and centre of mass along the rod stay:
#
#     m1 = m (1 - s),   m2 = m s,   s the centre of mass in units of the length from p1.
#
# Armature, damping and friction of its joint go with it.


RodMass = Literal["ends", "drop"]

_PIVOTS = (
    "JointModelSpherical", "JointModelRX", "JointModelRY", "JointModelRZ",
    "JointModelRevoluteUnaligned", "JointModelRUBX", "JointModelRUBY", "JointModelRUBZ",
    "JointModelRevoluteUnboundedUnaligned",
)  # fmt: skip


@dataclass(frozen=True)
class _Rod:
    joint: str
    number: int
    loop: Constraint
    near: str  # name of a new frame, at p1 on the body that the rod hangs on
    far: str  # frame at p2 on the other body
    length: float  # [m]
    share: float  # s

    @property
    def distance(self) -> Loop:
        """The row that replaces the rod and its loop, under the loop's name."""
        # The end that takes the place of the loop's first frame comes first, as the force is on it.
        ends = (self.near, self.far) if self.far == self.loop.frames[1] else (self.far, self.near)
        loop = self.loop
        return Loop(*ends, "rod", length=self.length, name=loop.name, drift=loop.drift)


def rods_as_distances(
    scene: Scene, joints: Sequence[str], *, mass: RodMass = "ends"
) -> ReducedScene:
    """Return the scene with each rod replaced by one row: the distance of its two ends.

    Parameters
    ----------
    scene : Scene
    joints : sequence of str
        The joints on which the rods hang: balls, or hinges of a planar linkage. Each rod ends
        a branch, and one loop of kind ball or planar ties its other end.
    mass : {"ends", "drop"}
        Whether a rod's mass is shared by its two ends, so that total mass and centre of mass
        along the rod stay, or dropped.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidArgument
        If a body is no rod; the text says why.
    InvalidConstraint
        If a rod does more than keep a distance: without it the mobility is another.
    """
    if mass not in get_args(RodMass):
        raise InvalidArgument(f"mass = {mass!r}: one of {', '.join(get_args(RodMass))} is needed")
    names = checked_names("joints", joints, scene.robot.joints, "joint")
    q = scene.state()[0]
    rods = [_rod(scene, name) for name in names]
    for rod in rods:
        if scene.robot.frame(rod.far)[0] in {other.number for other in rods}:
            raise InvalidArgument(f"{rod.joint}: its other end is on a rod that is replaced too")
    robot = scene.robot
    for rod in rods:
        robot = _with_ends(robot, rod, mass)
    said = "shared by their ends" if mass == "ends" else "dropped"
    words = f"rods as distances: {listed(names)}; their mass is {said}"
    lost = [text for name in names for text in _lost_effects(scene.robot, name)]
    small = smaller_robot(robot, names, q, words, cut=True)
    of_loop = {rod.loop.name: rod.distance for rod in rods}
    distances = tuple(rod.distance for rod in rods if rod.loop in scene.robot.loops)
    small = replace(small, loops=(*small.loops, *distances))
    constraints: list[Constraint] = [of_loop.get(c.name, c) for c in scene.constraints]
    result = reduced_scene(scene, small, constraints, q, (words, *lost), found=names)
    # what goes with a rod on a ball is its spin about itself, and nothing with one on a hinge
    spins = sum(scene.robot.model.joints[rod.number].nv == 3 for rod in rods)
    if result.nominal.mobility != (right := scene.nominal.mobility - spins):
        raise InvalidConstraint(
            f"rods {listed([rod.joint for rod in rods])}: as distances they leave mobility "
            f"{result.nominal.mobility} where {right} is right, so they do more than "
            "keep a distance"
        )
    return result


def is_rod(scene: Scene, joint: str) -> bool:
    """True if the body of a joint could be replaced by a distance."""
    try:
        _rod(scene, joint)
    except InvalidArgument:
        return False
    return True


def _rod(scene: Scene, joint: str) -> _Rod:
    """Return the ends and mass of a rod, or say why the body is no rod."""
    robot, model = scene.robot, scene.robot.model
    check_passive(robot, joint)
    number = model.getJointId(joint)
    if model.joints[number].shortname() not in _PIVOTS:
        raise InvalidArgument(f"joint {joint!r} is a {model.joints[number].shortname()}: a rod "
                              "hangs on a ball or a hinge")  # fmt: skip
    if len(model.subtrees[number]) > 1:
        raise InvalidArgument(f"joint {joint!r} carries further joints: a rod ends a branch")
    on_it = [c for c in scene.constraints if number in c.sides(robot)]
    if len(on_it) != 1 or not on_it[0].is_pin:
        found = listed([c.name for c in on_it]) or "none"
        raise InvalidArgument(
            f"joint {joint!r}: a rod has one loop, of kind ball or planar, on it; found: {found}"
        )
    loop = on_it[0]
    own, far = loop.frames
    if robot.frame(own)[0] != number:
        own, far = far, own
    tip = robot.frame(own)[1].translation
    length = float(np.linalg.norm(tip))
    if length == 0.0:
        raise InvalidArgument(f"joint {joint!r}: the ends of the rod coincide")
    share = _mass_share(joint, model.inertias[number].lever, tip / length, length)
    return _Rod(joint, number, loop, f"{joint}/seat", far, length, share)


def _mass_share(joint: str, com: Array, along: Array, length: float) -> float:
    """Return s, or say that no two masses at the ends have this centre of mass."""
    x = float(com @ along)
    if not -tolerances.DRAWN <= x <= length + tolerances.DRAWN:
        raise InvalidArgument(
            f"joint {joint!r}: the centre of mass of a rod is between its ends; here it is at "
            f"{x / length:.3g} of its length"
        )
    return min(max(x / length, 0.0), 1.0)


def _lost_effects(robot: Robot, joint: str) -> list[str]:
    """Return a sentence on armature, damping and friction of a rod's joint, left out with it."""
    _, index = indices(robot.model, [joint])
    acting = ("armature", "damping", "friction")
    found = [name for name in acting if np.any(np.array(getattr(robot.model, name))[index])]
    return [f"joint {joint}: its {' and '.join(found)} left out with it"] if found else []


def _with_ends(robot: Robot, rod: _Rod, mass: RodMass) -> Robot:
    """Return the robot with a frame at the rod's seat, and the rod's mass at its ends."""
    model = pin.Model(robot.model)
    parent, seat = model.parents[rod.number], model.jointPlacements[rod.number]
    model.addFrame(pin.Frame(rod.near, parent, 0, seat, pin.FrameType.OP_FRAME))
    if mass == "ends":
        m = model.inertias[rod.number].mass
        other, place = robot.frame(rod.far)
        for joint, part, at in ((parent, 1 - rod.share, seat), (other, rod.share, place)):
            model.appendBodyToJoint(joint, pin.Inertia(part * m, np.zeros(3), np.zeros((3, 3))), at)
    return replace(robot, model=model)
