"""Marks: arrows, closures, patches, balance, their legend, and labels.

Marks on every scene: joints, spring-dampers, the centre of mass, and the floor.

A hinge is a drum about its axis, a slider a bar along it, any other joint a ball; what has a motor
is orange. The joint of a floating base is not marked. A spring-damper is bellows from one frame to
the other. The floor is a grid in the plane z = 0, or below a machine that hangs from there; its
squares give the scale. meshcat's own grid is of lines, which software renderers drop where they
pass behind the camera.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from operator import methodcaller
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Patch
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.control.balancing import Balance
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce
from condyn_pin.io import meshes
from condyn_pin.model.robot import Robot
from condyn_pin.viewing import part as palette
from condyn_pin.viewing.instant import ContactView, Instant
from condyn_pin.viewing.part import (
    ACTUATED,
    AXES,
    CONTACT,
    FLOOR,
    FORCE,
    GRID,
    MASS,
    MOMENT,
    PASSIVE,
    REACTION,
    SPRING,
    Colour,
    Part,
    Pose,
    Tint,
    at_point,
    gap_colour,
    joint_pose,
    pose_from,
    span,
)

_FOLDS = 12  # of bellows
_HALF = 7  # squares from the middle of the floor to its edge
_BELOW = 4e-3  # of the size of the scene: how far the floor is below the grid and the grounds on it
_SUNK = 0.06  # of the size of the scene: how deep a shape is under the floor, to be warned of
_LOOKS = 20  # instants of a motion that are looked at


def joint_parts(robot: Robot, size: float) -> Iterator[Part]:
    """Yield a mark for each joint of a robot in a scene of this size [m]."""
    for name in robot.joints:
        i = robot.model.getJointId(name)
        joint = robot.model.joints[i]
        if joint.nv == 6:
            continue
        driven = name in robot.motor_joints
        kind, colour = ("actuated", ACTUATED) if driven else ("passive", PASSIVE)
        shape = ((_joint_mark(joint, 0.008 * size), colour),)
        yield Part(f"joints/{kind}/{name}", joint_pose(i), shape, opacity=0.9, on_top=True)


def _joint_mark(joint: Any, radius: float) -> meshes.Mesh:
    if joint.nv != 1:
        return meshes.sphere(1.2 * radius)
    data = joint.createData()
    joint.calc(data, np.array([1.0, 0.0]) if joint.nq == 2 else np.zeros(1))
    S = np.array(data.S).reshape(6)
    linear, angular = S[:3], S[3:]
    if np.linalg.norm(angular) > 0.0:
        mark, axis = meshes.cylinder(radius, 2.4 * radius), angular
    else:
        mark, axis = meshes.box(radius, radius, 5.0 * radius), linear
    return mark.moved(span(np.zeros(3), axis / np.linalg.norm(axis)))


def spring_parts(robot: Robot, size: float) -> Iterator[Part]:
    """Yield a part for each spring-damper of a robot in a scene of this size [m]."""
    heights = np.linspace(0.0, 1.0, 2 * _FOLDS + 1)
    radii = 0.008 * size * np.where(np.arange(len(heights)) % 2, 1.0, 0.4)
    radii[[0, -1]] = 0.0
    bellows = meshes.solid_of_revolution(np.column_stack([radii, heights]), 12)
    for each in robot.spring_dampers:
        pose = _between(robot.frame(each.frame_a), robot.frame(each.frame_b))
        yield Part(f"springs/{each.frame_a} - {each.frame_b}", pose, ((bellows, SPRING),))


def _between(*frames: tuple[int, Any]) -> Pose:
    def pose(at: Instant) -> Array:
        return span(*((at.joints[joint] * placement).translation for joint, placement in frames))

    return pose


def mass_parts(size: float) -> Iterator[Part]:
    """Yield a ball in the centre of mass, and its label."""

    def pose(at: Instant) -> Array:
        return at_point(at.com)

    ball = meshes.sphere(0.011 * size)
    yield Part("mass/centre", pose, ((ball, MASS),), opacity=0.9, on_top=True)
    yield label("mass/label", "centre of mass", MASS, pose, 0.024 * size)


def spacing(size: float) -> float:
    """Return the edge of a square [m]: 1, 2 or 5 times a power of ten, near a sixth of `size`."""
    power = 10.0 ** math.floor(math.log10(size / 6.0))
    return power * max(step for step in (1, 2, 5) if step * power <= size / 6.0)


def floor_parts(robot: Robot, middle: Array, size: float) -> Iterator[Part]:
    """Yield the grid under a scene, its lines on whole multiples of the spacing, and the floor.

    A robot that moves freely stands on a floor, which hides what is below; one that is fixed may
    hang from its base.
    """
    height = 0.0 if middle[2] >= 0.0 else middle[2] - 0.5 * size
    step = spacing(size)
    centre = np.round(middle[:2] / step) * step
    long, thin = 2.0 * _HALF * step, 0.0025 * size
    lines = meshes.Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint32))
    for i in range(-_HALF, _HALF + 1):
        for x, y, at in ((long, thin, (0.0, i * step)), (thin, long, (i * step, 0.0))):
            lines = lines + _square(x, y, np.array([*(centre + at), height]))
    yield Part("floor", lambda _: np.eye(4), ((lines, GRID),))
    if height == 0.0 and has_floating_base(robot):
        sheet = _square(long, long, np.array([*centre, -_BELOW * size]))
        yield Part("sheet", lambda _: np.eye(4), ((sheet, FLOOR),), sheet=True)


def _square(x: float, y: float, middle: Array) -> meshes.Mesh:
    """Rectangle of edges x and y [m], seen from above."""
    corners = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
    T = np.diag([x, y, 1.0, 1.0])
    T[:3, 3] = middle
    return meshes.Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], dtype=np.uint32)).moved(T)


def has_floating_base(robot: Robot) -> bool:
    """True if the first joint is free."""
    return bool(robot.model.njoints > 1 and robot.model.joints[1].nv == 6)


def sunk(robot: Robot, parts: Iterable[Part], instants: Sequence[Instant], size: float) -> str:
    """The body that is deepest in the floor at any instant, and how deep; empty if there is none.

    Shapes of feet go deeper than the points that they stand on, by a few per cent of the scene.
    """
    parts = list(parts)
    if not any(part.path == "sheet" for part in parts):
        return ""
    seen = instants[:: max(1, len(instants) // _LOOKS)]
    depths = {
        part.path.removeprefix("robot/"): max(_depth(part, at) for at in seen)
        for part in parts
        if part.path.startswith("robot/")
    }
    worst = max(depths, key=lambda name: depths[name], default="")
    if not worst or depths[worst] < _SUNK * size:
        return ""
    i = robot.model.getJointId(worst)
    bodies = (f.name for f in robot.model.frames if f.type == pin.FrameType.BODY)
    carried = (name for name in bodies if robot.frame(name)[0] == i)
    return f"warning: {next(carried, worst)} is {100.0 * depths[worst]:.0f} cm under the ground"


def _depth(part: Part, at: Instant) -> float:
    """Depth of the lowest vertex of a part below z = 0 [m]."""
    T = part.pose(at)
    if T is None:
        return 0.0
    drawn = part.coarse or tuple(mesh for mesh, _ in part.meshes)
    lowest = min(float((mesh.vertices @ T[2, :3]).min()) for mesh in drawn)
    return -lowest - float(T[2, 3])


# Forces of constraints and contacts as arrows, each on the body that feels it.
#
# Forces have one scale, moments another: the largest of each is a quarter of the scene.


_LARGEST = 0.25  # of the size of the scene
_LEAST = 1e-3  # of the largest arrow: a smaller one is not drawn
_FLAT = 6e-3  # of the size of the scene: a shorter arrow would be a disc
_ROUNDING = 1e-9  # of the weight, of moments at the size of the scene: no force of what flies


class LargestForce(NamedTuple):
    """The largest force and moment of a constraint in a motion."""

    force: float  # [N]
    moment: float  # [N m]


# A force with its body and its point of application.
_Acting: TypeAlias = ConstraintForce | ContactView


@dataclass(frozen=True, eq=False)
class _Arrow:
    """A vector of a constraint or a contact: the force or the moment on one of its bodies."""

    name: str
    acting: Callable[[Instant], _Acting | None]
    part: slice  # of the six numbers
    unit: str
    colour: Colour

    def vector(self, at: Instant) -> tuple[Array, Array] | None:
        """Return its start [m] and the vector [N, N m] in world axes; None if it is not seen."""
        force = self.acting(at)
        if force is None:
            return None
        vector = force.in_world()[self.part]
        return (force.at, vector) if len(vector) else None

    def most(
        self, instants: Sequence[Instant], peaks: Mapping[str, LargestForce]
    ) -> tuple[float, str]:
        """Return its largest norm [N, N m], and the body that it acts on; zero if never seen."""
        seen = [(self.vector(at), self.acting(at)) for at in instants]
        found = [(float(np.linalg.norm(vector[1])), force) for vector, force in seen if vector]
        largest, force = max(found, key=lambda each: each[0], default=(0.0, None))
        if force is None:
            return 0.0, ""
        peak = peaks.get(self.name, LargestForce(0.0, 0.0))
        return max(largest, peak.moment if self.unit == "N m" else peak.force), force.on


def body_of(robot: Robot, name: str) -> str:
    """Return the body that carries a frame: its own name, or that of the link it is fixed to."""
    # Frames of an MJCF name no link; then it is the first body of the joint.
    frames = robot.model.frames
    named = found = next((frame for frame in frames if frame.name == name), None)
    while found is not None and found.parentFrame:
        if found.type == pin.FrameType.BODY:
            return str(found.name)
        found = frames[found.parentFrame]
    if named is None or not named.parentJoint:
        return name
    bodies = (f for f in frames if f.type == pin.FrameType.BODY)
    return next((str(f.name) for f in bodies if f.parentJoint == named.parentJoint), name)


def arrow_parts(
    scene: Scene, instants: Sequence[Instant], size: float, peaks: Mapping[str, LargestForce]
) -> Iterator[Part]:
    """Return the arrows of every constraint and contact of a scene of a `size` [m], with labels."""
    # Arrows follow a motion. Labels do not: they show its `peaks`, by name, marked as such.
    arrows: list[_Arrow] = []
    for c in scene.constraints:
        if c.frames:
            held = partial(_force_of, c.name)
            arrows += _arrows(c.name, held, between=len(c.frames) == 2, moment=True)
    for name, ground in (cone for bound in scene.contact_bounds for cone in bound.cones):
        arrows += _arrows(name, partial(_touch_of, name), between=ground != 0)
    most = {arrow: arrow.most(instants, peaks) for arrow in arrows}
    weight = scene.robot.mass * tolerances.GRAVITY  # [N]
    moves = len(instants) > 1
    for unit, least in (("N", _ROUNDING * weight), ("N m", _ROUNDING * weight * size)):
        same = [arrow for arrow in arrows if arrow.unit == unit]
        largest = max((most[arrow][0] for arrow in same), default=0.0)
        for arrow in same:
            length, on = most[arrow]
            if length > _LEAST * largest and largest > least:
                body = body_of(scene.robot, on)
                words = _words(arrow, f"{length:.3g} {unit}{' at most' if moves else ''}", body)
                yield from _arrow_parts(arrow, words, body, _LARGEST * size / largest, size)


def _words(arrow: _Arrow, size: str, body: str) -> str:
    """Label of an arrow: the constraint, its size, and the body; of a reaction the body alone."""
    if arrow.colour == REACTION:
        return f"on {body}"
    return f"{arrow.name}: {size}" if body in arrow.name else f"{arrow.name}: {size} on {body}"


def _arrows(
    name: str, first: Callable[[Instant], _Acting | None], *, between: bool, moment: bool = False
) -> Iterator[_Arrow]:
    """Arrows of a force on the first body, with its moment, and `between` two on the other."""
    linear, angular = slice(0, 3), slice(3, 6)
    yield _Arrow(name, first, linear, "N", FORCE)
    if moment:
        yield _Arrow(name, first, angular, "N m", MOMENT)
    if between:
        yield _Arrow(name, _other_end(first), linear, "N", REACTION)


def _force_of(name: str, at: Instant) -> ConstraintForce | None:
    return at.forces.get(name)


def _touch_of(name: str, at: Instant) -> ContactView | None:
    return at.touching.get(name)


def _other_end(first: Callable[[Instant], _Acting | None]) -> Callable[[Instant], _Acting | None]:
    def other(at: Instant) -> _Acting | None:
        force = first(at)
        return None if force is None else force.on_other()

    return other


def _arrow_parts(arrow: _Arrow, words: str, on: str, scale: float, size: float) -> Iterator[Part]:
    def ends(at: Instant) -> tuple[Array, Array] | None:
        found = arrow.vector(at)
        if found is None or np.linalg.norm(found[1]) * scale < _FLAT * size:
            return None
        return found[0], found[0] + scale * found[1]

    kind = "moments" if arrow.unit == "N m" else "forces"
    path = f"{kind}/{arrow.name}/on {on.replace('/', ' ')}"
    pose, tip = (
        pose_from(ends, lambda both: span(*both)),
        pose_from(ends, lambda both: at_point(both[1])),
    )
    radius = 0.0045 * size
    head = 2.6 * radius
    profile = [(0.0, 0.0), (radius, 0.0), (radius, 0.8), (head, 0.8), (0.0, 1.0)]
    shape = meshes.solid_of_revolution(profile, 16)  # along z from 0 to 1
    yield Part(path, pose, ((shape, arrow.colour),), on_top=True)
    yield label(f"{path} label", words, arrow.colour, tip, 0.024 * size)


# Constraints: both frames of every loop, the patches of contacts, and gaps coloured by length.


def closure_parts(
    scene: Scene, worst: Mapping[str, ConstraintViolation], size: float
) -> Iterator[Part]:
    """Yield the parts of every loop; labels have the `worst` gap of all instants."""
    for constraint in scene.constraints:
        if len(constraint.frames) == 2:
            name = constraint.name
            yield _frame(f"closures/{name}/frame_a", name, 0, 0.034 * size, 0.002 * size)
            yield _frame(f"closures/{name}/frame_b", name, 1, 0.024 * size, 0.0035 * size)
            yield _gap(f"closures/{name}/gap", name, size)
            middle = _of_ends(name, lambda a, b: at_point(0.5 * (a.translation + b.translation)))
            # a ball in the middle of the gap, which also a closed loop shows
            ball = ((meshes.sphere(0.011 * size), gap_colour(0.0)),)
            yield Part(f"closures/{name}/state", middle, ball, on_top=True, tint=_tint(name))
            gap = worst.get(name)
            if gap is not None:
                text = f"{name}: {gap if gap.size > tolerances.CLOSED else 'closed'}"
                colour = gap_colour(gap.length)
                yield label(f"closures/{name}/label", text, colour, middle, 0.024 * size)


def contact_parts(scene: Scene, size: float) -> Iterator[Part]:
    """Yield the patch of every contact, and the segment from it to its anchor."""
    for constraint, bound in zip(scene.constraints, scene.bounds, strict=True):
        patch = constraint.patch(size)
        if patch is None:
            continue
        name = constraint.name
        place = _rotated_end if patch.turns else lambda end: at_point(end.translation)
        pose = pose_from(methodcaller("robot_end", name), place)
        shape = ((patch_mesh(patch), CONTACT),)
        yield Part(f"contacts/{name}/patch", pose, shape, opacity=0.8, on_top=True)
        if bound.origins_coincide:
            yield _gap(f"contacts/{name}/gap", name, size)


def _rotated_end(end: Any) -> Array:
    return np.asarray(end.homogeneous)


def _gap(path: str, name: str, size: float) -> Part:
    """Return the segment from c1 to c2 of a constraint."""
    pose = _of_ends(name, lambda a, b: span(a.translation, b.translation))
    shape = ((meshes.rod(0.004 * size, 1.0, 12), gap_colour(0.0)),)
    return Part(path, pose, shape, on_top=True, tint=_tint(name))


def _frame(path: str, name: str, which: int, length: float, radius: float) -> Part:
    """Return the axes of frame c1 or c2: red, green, blue are x, y, z."""
    T = [span(np.zeros(3), axis) for axis in np.eye(3)]
    rod = meshes.rod(radius, length, 8)
    axes = tuple((rod.moved(t), colour) for t, colour in zip(T, AXES, strict=True))
    return Part(path, _of_ends(name, lambda *ends: _rotated_end(ends[which])), axes, on_top=True)


def _of_ends(name: str, place: Callable[[Any, Any], Array]) -> Pose:
    """Pose as a function of the frames c1 and c2 of a constraint."""
    return pose_from(lambda at: at.ends.get(name), lambda ends: place(*ends))


def _tint(name: str) -> Tint:
    def colour(at: Instant) -> Colour:
        return gap_colour(at.gaps[name].length if name in at.gaps else 0.0)

    return colour


# Patches: the meshes of the shapes that contacts are drawn with.


def patch_mesh(patch: Patch) -> meshes.Mesh:
    """Return the mesh of a contact patch about the origin."""
    if patch.shape == "box":
        return meshes.box(*patch.size)
    if patch.shape == "rod":
        return meshes.cylinder(*patch.size).moved(span(np.zeros(3), np.array(patch.along)))
    if patch.shape == "capsule":
        return meshes.centred_capsule(*patch.size)
    return meshes.sphere(*patch.size)


# Marks of balance: the edges of the support polygon, and points of pressure and of capture.
#
# What they are and where they are valid is said in `control.balancing`. The number of corners may
# change from instant to instant, and a part is a shape that does not: each edge is a part of its
# own, which is not to be seen while the polygon has fewer.


_THIN = 0.004  # radius of an edge, of the size of the scene
_POINT = 0.014  # radius of a point, of the size of the scene
_LABEL = 0.024  # height of its words, of the size of the scene

# What is drawn as a point: the field of `Balance`, its words, its colour.
POINTS = (
    ("cop", "centre of pressure", palette.PRESSURE),
    ("capture_point", "capture point", palette.CAPTURE),
    ("dcm", "DCM", palette.DIVERGENT),
)


def balance_parts(instants: Sequence[Instant], size: float) -> Iterator[Part]:
    """Yield the marks of balance of the instants that have one, in a scene of this size [m]."""
    known = [at.balance for at in instants if at.balance is not None]
    corners = max((len(each.polygon.corners) for each in known if each.polygon), default=0)
    edge = meshes.cylinder(_THIN * size, 1.0).moved(at_point(np.array([0.0, 0.0, 0.5])))
    for i in range(corners):
        pose = partial(_edge, i)
        yield Part(f"balance/support/{i}", pose, ((edge, palette.SUPPORT),), on_top=True)
    ball = meshes.sphere(_POINT * size)
    for name, words, colour in POINTS:
        pose = partial(_point, name)
        if all(pose(at) is None for at in instants):
            continue
        path = f"balance/{name}"
        yield Part(f"{path}/point", pose, ((ball, colour),), opacity=0.9, on_top=True)
        yield label(f"{path}/label", words, colour, pose, _LABEL * size)


def balance_notes(instants: Sequence[Instant]) -> tuple[str, ...]:
    """Return a note if the balance of the instants cannot be drawn; else nothing."""
    known = [at.balance for at in instants if at.balance is not None]
    if not known or any(each.polygon for each in known):
        return ()
    return (
        "no balance: no contacts press on one plane, so there is no support polygon, centre of "
        "pressure or capture point",
    )


def _edge(i: int, at: Instant) -> Array | None:
    """Return the pose of edge i of the polygon; a line has one edge, and a point none."""
    polygon = None if at.balance is None else at.balance.polygon
    if polygon is None or i >= len(polygon.corners) - (len(polygon.corners) < 3):
        return None
    corners = polygon.in_world
    return span(corners[i], corners[(i + 1) % len(corners)])


def _point(name: str, at: Instant) -> Array | None:
    balance: Balance | None = at.balance
    point = None if balance is None else getattr(balance, name)
    return None if point is None or not np.isfinite(point).all() else at_point(point)


# The legend of a picture: what its colours mean, and what could not be drawn.


# Parts that a line needs, its colour, and its words.
_LEGEND = (
    (("joints/actuated",), palette.ACTUATED, "joint with a motor"),
    (("joints/passive",), palette.PASSIVE, "joint without a motor"),
    (("springs",), palette.SPRING, "spring and damper"),
    (("closures",), palette.CLOSED, "loop, closed"),
    (("opened",), palette.AJAR, "loop, open by less than 1 cm"),
    (("opened",), palette.OPEN, "loop, open by more"),
    (("contacts",), palette.CONTACT, "contact"),
    (("candidates",), palette.CONTACT, "contact that may open"),
    (("touching", "open"), palette.AWAY, "contact, open"),
    (("touching", "stick"), palette.STICKS, "contact, sticking"),
    (("touching", "slide"), palette.SLIDES, "contact, sliding"),
    (("cables",), palette.STICKS, "cable, taut (grey: slack)"),
    (("cones",), palette.CONE, "friction cone"),
    (("forces",), palette.FORCE, "contact force"),
    (("forces", "closures"), palette.FORCE, "force in a loop or contact"),
    (("forces", "closures"), palette.REACTION, "the same force on the other body"),
    (("moments",), palette.MOMENT, "moment"),
    (("balance/support",), palette.SUPPORT, "support polygon"),
    *(((f"balance/{name}",), colour, words) for name, words, colour in POINTS),
    (("grounds",), palette.GROUND, "ground"),
)


def legend_of(
    title: str,
    parts: Iterable[Part],
    instants: Iterable[Instant],
    squares: float,
    notes: Iterable[str],
) -> Iterator[tuple[str, str]]:
    """Yield colour and text of each line; `squares` are those of the grid [m]."""
    yield "", title
    paths = [part.path for part in parts]
    seen = {path.removeprefix("before/").split("/")[0] for path in paths}
    seen |= {"/".join(path.split("/")[:2]) for path in paths}
    for at in instants:
        seen |= {touch.mode for touch in at.touching.values()}
        seen |= {"opened" for gap in at.gaps.values() if gap.length > tolerances.CLOSED}
    seen |= {"opened"} if "before" in {path.split("/")[0] for path in paths} else set()
    for needed, colour, text in _LEGEND:
        if seen.issuperset(needed) and not (text == "contact force" and "closures" in seen):
            yield f"#{palette.number(colour):06x}", text
    yield f"#{palette.number(palette.GRID):06x}", f"grid of {squares:g} m"
    yield from (("", note) for note in notes)


# Labels: text that faces the camera, at a point; the page moves it beside that, clear of others.


_PIXELS: Final = 30  # of the font's height
_RIM: Final = 6  # [px]


def label(path: str, text: str, colour: Colour, pose: Pose, height: float) -> Part:
    """Return a line of text of a height [m] at the point of a pose."""
    png, width = _written(text, tuple(round(150 * x) for x in colour))

    def here(T: Array) -> Array:
        placed = np.diag([width * height, height, height, 1.0])
        placed[:3, 3] = T[:3, 3]
        return placed

    return Part(path, pose_from(pose, here), picture=png, on_top=True)


@lru_cache(maxsize=256)
def _written(text: str, colour: tuple[int, ...]) -> tuple[bytes, float]:
    """Return a PNG of a text with a white rim, and its width over its height."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(size=_PIXELS)
    left, _, right, _ = font.getbbox(text, stroke_width=3)
    size = (round(right - left) + 2 * _RIM, _PIXELS + 3 * _RIM)
    picture = Image.new("RGBA", size, (255, 255, 255, 0))
    ImageDraw.Draw(picture).text(
        (_RIM - left, 0.5 * size[1]), text, fill=(*colour, 255), font=font, anchor="lm",
        stroke_width=3, stroke_fill=(255, 255, 255, 235),
    )  # fmt: skip
    file = io.BytesIO()
    picture.quantize(32).save(file, "PNG")
    return file.getvalue(), size[0] / size[1]
