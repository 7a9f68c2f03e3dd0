"""Drawing: all parts of a scene, at one instant or at many, and the page that shows them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.viewing import three
from condyn_pin.viewing.arrows import Peak, arrow_parts
from condyn_pin.viewing.balance_marks import balance_notes, balance_parts
from condyn_pin.viewing.bodies import body_parts, lighter, with_coarse
from condyn_pin.viewing.camera import FROM, eye_at, toward_of
from condyn_pin.viewing.closures import closure_parts, contact_parts
from condyn_pin.viewing.extent import extent, plane_normal, touched
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.labels import Eye, spread
from condyn_pin.viewing.legend import legend_of
from condyn_pin.viewing.marks import floor_part, joint_parts, mass_parts, spacing, spring_parts
from condyn_pin.viewing.motion import tracks
from condyn_pin.viewing.page import page
from condyn_pin.viewing.part import Part
from condyn_pin.viewing.touches import touch_parts

_SLASH = "\N{DIVISION SLASH}"  # looks like one, and parts nothing


@dataclass(frozen=True, eq=False)
class Drawing:
    """All parts of a picture.

    Attributes
    ----------
    title : str
    parts : tuple of Part
    instants : tuple of Instant
        One for a still picture.
    fps : float
        Pictures a second, as they are played [1/s].
    middle : (3,) array
        Of what is seen [m].
    size : float
        [m]
    notes : tuple of str
        What could not be drawn, a sentence each.
    frames : (k,) array
        When each instant is shown, in pictures since the start.
    toward : (3,) array
        From the middle to the camera.
    speed : float
        Seconds of a motion that are played in one second.
    """

    title: str
    parts: tuple[Part, ...]
    instants: tuple[Instant, ...]
    fps: float
    middle: Array
    size: float
    notes: tuple[str, ...] = ()
    frames: Array = field(default_factory=lambda: np.zeros(1))
    toward: Array = field(default_factory=lambda: FROM)
    speed: float = 1.0

    def commands(self) -> Iterator[three.Command]:
        """Return the commands that draw it, in meshcat's viewer."""
        yield from stage()
        for part in self.parts:
            yield from part.commands(self.instants[0])
        if len(self.instants) > 1:
            yield three.animation(tracks(self.parts, self.instants, self.frames), self.fps)

    @property
    def eye(self) -> Eye:
        """Where the camera is at first."""
        return eye_at(self.middle, self.size, self.toward)

    @property
    def first(self) -> Drawing:
        """Its first instant, which rests."""
        return replace(self, instants=self.instants[:1])

    def html(self) -> str:
        """Return the page: one text that holds everything."""
        eye = self.eye
        legend = legend_of(self.title, self.parts, spacing(self.size), self.notes)
        return page(
            self.title, legend, self.commands(), camera=eye.at, target=eye.target, speed=self.speed
        )


def draw(
    scenes: Sequence[Scene],
    instants: Sequence[Instant],
    *,
    title: str,
    before: Instant | None = None,
    frames: Array | None = None,
    gaps: Iterable[Mapping[str, ConstraintViolation]] | None = None,
    peaks: Mapping[str, Peak] | None = None,
    fps: float = 30.0,
    speed: float = 1.0,
    light: bool = False,
    cones: bool = False,
) -> Drawing:
    """Return the drawing of instants.

    Parameters
    ----------
    scenes : sequence of Scene
        Whose constraints are drawn, all of the same robot; a constraint is seen while it holds.
    instants : sequence of Instant
    title : str
    before : Instant, optional
        What is drawn beside them as a ghost.
    frames : (k,) array, optional
        When each instant of a motion is shown, in pictures since the start.
    gaps : iterable of mapping, optional
        Of a motion, how far constraints are open at all its samples: what labels say is the
        largest. That of the instants by default.
    peaks : mapping of str to Peak, optional
        Of a motion, the largest forces of all its samples, which arrows are labelled with.
    fps : float
        Pictures a second [1/s].
    speed : float
        Seconds of a motion that are played in one second.
    light : bool
        Draw the robot with 30 000 triangles at most.
    cones : bool
        Draw the friction cones of contacts that may let go.
    """
    robot = scenes[0].robot
    seen = [instants[0], *([] if before is None else [before])]
    middle, size = extent(robot, seen, touched(instants))
    bodies, notes = body_parts(robot, size)
    if light:
        bodies = lighter(bodies, size)
    bodies = tuple(with_coarse(bodies, size))
    worst = _worst((at.gaps for at in instants) if gaps is None else gaps)
    parts = [floor_part(middle, size), *bodies]
    parts += [*joint_parts(robot, size), *spring_parts(robot, size)]
    parts += _constraint_parts(scenes, instants, worst, peaks or {}, size, cones)
    parts += [*mass_parts(size), *balance_parts(instants, size)]
    notes = (*notes, *balance_notes(instants))
    if before is not None:
        opened = list(closure_parts(scenes[0], before.gaps, size))
        parts += [part.ghost(before) for part in (*bodies, *opened)]
    unique = {part.path: part for part in parts}  # a contact of several phases is drawn once
    toward = toward_of(plane_normal(robot, instants[0]))
    placed = spread(tuple(_apart(unique.values())), instants[0], eye_at(middle, size, toward))
    when = np.arange(len(instants), dtype=float) if frames is None else frames
    return Drawing(
        title, tuple(placed), tuple(instants), fps, middle, size, notes, when, toward, speed
    )


def _constraint_parts(
    scenes: Sequence[Scene], instants: Sequence[Instant],
    worst: Mapping[str, ConstraintViolation], peaks: Mapping[str, Peak], size: float, cones: bool,
) -> Iterator[Part]:  # fmt: skip
    """Yield the loops of all scenes, then each one's contacts and the forces of both."""
    for scene in scenes:
        yield from closure_parts(scene, worst, size)
    for scene in scenes:
        yield from contact_parts(scene, size)
        yield from touch_parts(scene, instants, size, cones=cones)
        yield from arrow_parts(scene, instants, size, peaks)


def _apart(parts: Iterable[Part]) -> Iterator[Part]:
    """Yield parts of which none hangs on another one in meshcat's tree, and moves with it.

    The names of two joints may be ``arm`` and ``arm/tip``; an empty name between slashes counts for
    nothing there.
    """
    parts = list(parts)
    taken = {_words(part.path) for part in parts}
    seen: set[tuple[str, ...]] = set()
    for part in parts:
        words = _words(part.path)
        above = [words[:k] for k in range(1, len(words)) if words[:k] in taken]
        if above or words in seen:
            kept = len(above[0]) - 1 if above else 1
            yield replace(
                part, path="/".join([*words[:kept], _SLASH.join(part.path.split("/")[kept:])])
            )
        else:
            yield part
        seen.add(words)


def _words(path: str) -> tuple[str, ...]:
    return tuple(word for word in path.split("/") if word)


def _worst(gaps: Iterable[Mapping[str, ConstraintViolation]]) -> dict[str, ConstraintViolation]:
    """Return the largest gap of each constraint."""
    worst: dict[str, ConstraintViolation] = {}
    for each in gaps:
        for name, gap in each.items():
            worst[name] = max(worst.get(name, gap), gap, key=lambda of: of.size)
    return worst


def stage() -> Iterator[three.Command]:
    """Return the commands that hide meshcat's own background, axes and grid, and take its lamps."""
    yield three.delete("/Lights")
    for path in ("/Background", "/Axes", "/Grid"):
        yield three.set_property(path, "visible", False)
