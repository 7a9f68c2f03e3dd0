"""Drawing: all parts of a scene, at one instant or at many, and the page that shows them."""

from __future__ import annotations

import html
import importlib.util
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_flag, normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.control.answer import ControlAnswer
from condyn_pin.control.balancing import balance as balance_of
from condyn_pin.control.inverse import InverseDynamics
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites, Solution
from condyn_pin.errors import InvalidArgument, MissingExtra, NotAssembled
from condyn_pin.mechanism.closing import Assembly
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.stepping.single_step import StepSolution
from condyn_pin.viewing import part as three
from condyn_pin.viewing.bodies import body_parts, lighter, touch_parts, with_coarse
from condyn_pin.viewing.instant import Instant, PlottedForce, extent, instant, plane_normal, touched
from condyn_pin.viewing.marks import (
    LargestForce,
    arrow_parts,
    balance_notes,
    balance_parts,
    closure_parts,
    contact_parts,
    floor_parts,
    joint_parts,
    legend_of,
    mass_parts,
    spacing,
    spring_parts,
    sunk,
)
from condyn_pin.viewing.motion import (
    ASPECT,
    FIELD,
    Camera,
    drawn_samples,
    framed,
    gaps_of,
    instants_of,
    peaks_of,
    toward_of,
    tracks,
)
from condyn_pin.viewing.part import Command, Part, packed_command

_SLASH = "\N{DIVISION SLASH}"  # looks like one, and parts nothing


@dataclass(frozen=True, eq=False)
class Drawing:
    """All parts of a picture."""

    title: str
    parts: tuple[Part, ...]
    instants: tuple[Instant, ...]  # one for a still picture
    fps: float  # pictures a second, as they are played [1/s]
    middle: Array  # (3,) of what is seen [m]
    size: float  # [m]
    eye: Camera  # where it is seen from at first
    notes: tuple[str, ...] = ()  # parts of the subject that cannot be drawn, a sentence each
    # (k,) time of each instant, in pictures since the start
    frames: Array = field(default_factory=lambda: np.zeros(1))
    speed: float = 1.0  # seconds of a motion that are played in one second

    def commands(self) -> Iterator[three.Command]:
        """Return the meshcat commands that draw it."""
        yield from stage()
        for part in self.parts:
            yield from part.commands(self.instants[0])
        if len(self.instants) > 1:
            yield three.animation(tracks(self.parts, self.instants, self.frames), self.fps)

    @property
    def first(self) -> Drawing:
        """The drawing of its first instant alone, without motion."""
        return replace(self, instants=self.instants[:1])

    def html(self) -> str:
        """Return the page: one text that holds everything."""
        eye = self.eye
        squares = spacing(self.size)
        legend = legend_of(self.title, self.parts, self.instants, squares, self.notes)
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
    peaks: Mapping[str, LargestForce] | None = None,
    fps: float = 30.0,
    speed: float = 1.0,
    light: bool = False,
    cones: bool = False,
) -> Drawing:
    """Drawing of instants of scenes of one robot; a constraint is seen while it holds."""
    # `before` is drawn beside them as a ghost. `frames` (k,) are the times of the instants of a
    # motion, in pictures since the start, `gaps` those of the constraints at all its samples, of
    # which labels show the largest, and `peaks` its largest forces. A `light` robot has 30 000
    # triangles at most.
    robot = scenes[0].robot
    seen = [instants[0], *([] if before is None else [before])]
    middle, size = extent(robot, seen, touched(instants))
    bodies, notes = body_parts(robot, size)
    if light:
        bodies = lighter(bodies, size)
    bodies = tuple(with_coarse(bodies, size))
    worst = _largest_gaps((at.gaps for at in instants) if gaps is None else gaps)
    parts = [*floor_parts(robot, middle, size), *bodies]
    parts += [*joint_parts(robot, size), *spring_parts(robot, size)]
    parts += _constraint_parts(scenes, instants, worst, peaks or {}, size, cones)
    parts += [*mass_parts(size), *balance_parts(instants, size)]
    notes = (*notes, *balance_notes(instants))
    if before is not None:
        opened = list(closure_parts(scenes[0], before.gaps, size))
        parts += [part.ghost(before) for part in (*bodies, *opened)]
    unique = {part.path: part for part in parts}  # a contact of several phases is drawn once
    named = {path.split("/on ")[0].partition("/")[2] for path in unique if path[:7] == "forces/"}
    for name in named & {name for name, gap in worst.items() if gap.size <= tolerances.CLOSED}:
        unique.pop(f"closures/{name}/label", None)  # the label of its force names it
    placed = tuple(_without_nested_names(unique.values()))
    warning = sunk(robot, placed, instants, size)
    toward = toward_of(plane_normal(robot, instants[0]))
    when = np.arange(len(instants), dtype=float) if frames is None else frames
    return Drawing(
        title=f"{title} ({warning})" if warning else title,
        parts=placed,
        instants=tuple(instants),
        fps=fps,
        middle=middle,
        size=size,
        eye=framed(placed, seen if before else instants, toward),
        notes=notes,
        frames=when,
        speed=speed,
    )


def _constraint_parts(
    scenes: Sequence[Scene], instants: Sequence[Instant], worst: Mapping[str, ConstraintViolation],
    peaks: Mapping[str, LargestForce], size: float, cones: bool,
) -> Iterator[Part]:  # fmt: skip
    """Parts of the loops of all scenes, then of contacts, and of the forces of both."""
    for scene in scenes:
        yield from closure_parts(scene, worst, size)
    for scene in scenes:
        yield from contact_parts(scene, size)
        yield from touch_parts(scene, instants, size, cones=cones)
        yield from arrow_parts(scene, instants, size, peaks)


def _without_nested_names(parts: Iterable[Part]) -> Iterator[Part]:
    """Parts renamed so that none is a child of another one in meshcat's tree."""
    # The names of two joints may be ``arm`` and ``arm/tip``; an empty name between slashes counts
    # for nothing there.
    parts = list(parts)
    taken = {_name_in_words(part.path) for part in parts}
    seen: set[tuple[str, ...]] = set()
    for part in parts:
        words = _name_in_words(part.path)
        above = [words[:k] for k in range(1, len(words)) if words[:k] in taken]
        if above or words in seen:
            kept = len(above[0]) - 1 if above else 1
            yield replace(
                part, path="/".join([*words[:kept], _SLASH.join(part.path.split("/")[kept:])])
            )
        else:
            yield part
        seen.add(words)


def _name_in_words(path: str) -> tuple[str, ...]:
    return tuple(word for word in path.split("/") if word)


def _largest_gaps(
    gaps: Iterable[Mapping[str, ConstraintViolation]],
) -> dict[str, ConstraintViolation]:
    """Return the largest gap of each constraint."""
    worst: dict[str, ConstraintViolation] = {}
    for each in gaps:
        for name, gap in each.items():
            worst[name] = max(worst.get(name, gap), gap, key=lambda gap: gap.size)
    return worst


def stage() -> Iterator[three.Command]:
    """Return the commands that remove meshcat's lights, and hide its background, axes and grid."""
    yield three.delete("/Lights")
    for path in ("/Background", "/Axes", "/Grid"):
        yield three.hide(path)


# What is drawn of each kind of subject: a robot, a scene, an answer, a step, a motion.


Subject = (
    Robot
    | Scene
    | Solution
    | StepSolution
    | InverseDynamics
    | ControlAnswer
    | Trajectory
    | Assembly
)

_FPS = 30.0  # [1/s]


@dataclass(frozen=True)
class ViewOptions:
    """Drawing options of a subject; `view` has the meaning of each flag."""

    forces: bool = True
    light: bool = False
    cones: bool = False
    balance: bool = False

    def __post_init__(self) -> None:
        for flag in fields(self):
            check_flag(flag.name, getattr(self, flag.name))


_DEFAULT = ViewOptions()


def drawing_of(
    subject: Subject,
    q: ArrayLike | None = None,
    *,
    posture: str | None = None,
    t: float | None = None,
    speed: float = 1.0,
    look: ViewOptions = _DEFAULT,
) -> Drawing:
    """Return the drawing of a subject, as `view` shows it, without a page."""
    _check(subject, t, look)
    if isinstance(subject, Robot):
        subject = Scene(subject, subject.loops)
    if isinstance(subject, Scene):
        return _scene(subject, q, posture, look)
    if q is not None or posture is not None:
        given = "q" if q is not None else "posture"
        raise InvalidArgument(f"{given}: a {type(subject).__name__} has its own configuration")
    if isinstance(subject, Trajectory):
        return _motion(subject, speed, look) if t is None else _sample(subject, t, look)
    if isinstance(subject, StepSolution):
        return _step(subject, look)
    return _answer(subject, look)


def _check(subject: Subject, t: float | None, look: ViewOptions) -> None:
    """Refuse subjects that cannot be drawn, and options that a subject does not have."""
    if not isinstance(subject, Subject):
        if isinstance(subject, str):
            raise InvalidArgument(
                f"subject = {subject!r}: load_robot makes a Robot of a name or a path, and "
                "Trajectory.load a motion of a file"
            )
        raise InvalidArgument(
            f"subject = {subject!r}: a Robot, a Scene, a Solution, a StepSolution, an "
            "InverseDynamics, a ControlAnswer, a Trajectory or an Assembly is needed; of a batch, "
            "one: batch[i]"
        )
    if look.balance and not isinstance(subject, ControlAnswer | Trajectory):
        raise InvalidArgument(
            f"balance: a {type(subject).__name__} does not know v and forces; a ControlAnswer "
            "and a Trajectory do"
        )
    if t is not None and not isinstance(subject, Trajectory):
        raise InvalidArgument(f"t: a {type(subject).__name__} is not a motion, and has no times")


def _scene(scene: Scene, q: ArrayLike | None, posture: str | None, look: ViewOptions) -> Drawing:
    """Return the drawing of a scene in a configuration, or in a posture."""
    at, name = _configuration(scene, q, posture)
    title = f"{scene.robot.name}, {name}" if name else scene.robot.name
    return draw([scene], [instant(scene, at)], title=title, light=look.light, cones=look.cones)


def _configuration(scene: Scene, q: ArrayLike | None, posture: str | None) -> tuple[Array, str]:
    """Configuration of a scene to draw (nq,), and its name; empty for a given q."""
    if q is not None:
        if posture is not None:
            raise InvalidArgument("posture: q is given too; give only one of them")
        return normalised(scene.robot.model, "q", q), ""
    name = posture or next(iter(scene.robot.postures), "neutral")
    try:
        return scene.state(posture)[0], name
    except NotAssembled:
        return described_posture(scene, posture), f"{name}, as described: it cannot be closed"


def _answer(
    subject: Solution | InverseDynamics | ControlAnswer | Assembly, look: ViewOptions
) -> Drawing:
    """Return the drawing of an answer at its state, with its forces; of an assembly, its start."""
    scene, said, before = subject.scene, "inverse dynamics", None
    acting = subject.forces if look.forces and not isinstance(subject, Assembly) else {}
    if isinstance(subject, Solution):
        said = subject.status.word
    elif isinstance(subject, ControlAnswer):
        said = f"control: {subject.status.word}"
    elif isinstance(subject, Assembly):
        said = f"assembled: {subject.status.word.replace('_', ' ')}"
        before = instant(scene, subject.start)
    pressing = None
    if look.balance and isinstance(subject, ControlAnswer) and np.isfinite(subject.lam).all():
        pressing = balance_of(subject.scene, subject.q, subject.v, subject.a, subject.lam)
    at = instant(scene, subject.q, acting, balance=pressing)
    title = f"{scene.robot.name}, {said}"
    return draw([scene], [at], title=title, before=before, light=look.light, cones=look.cones)


def _step(step: StepSolution, look: ViewOptions) -> Drawing:
    """Return the drawing of a step at its end, with the mean forces in it."""
    scene, q = step.scene, step.q
    acting = Sites(scene, q).forces(step.lam / step.dt) if look.forces else {}
    at = instant(scene, q, acting, PlottedForce(step.forces if look.forces else {}, step.modes))
    title = f"{scene.robot.name}, a step of {step.dt:g} s, {step.status.word}"
    return draw([scene], [at], title=title, light=look.light, cones=look.cones)


def _sample(trajectory: Trajectory, t: float, look: ViewOptions) -> Drawing:
    """Return the drawing of one sample of a motion."""
    start, end = trajectory.t[[0, -1]]
    if not start <= finite("t", t, ()) <= end:
        raise InvalidArgument(f"t = {t}: the motion goes from {start:g} s to {end:g} s")
    k = int(np.abs(trajectory.t - t).argmin())
    instants = instants_of(trajectory, [k], forces=look.forces, balance=look.balance)
    scenes = [phase.scene for phase in trajectory.phases]
    title = f"{scenes[0].robot.name} at {trajectory.t[k]:.4g} s"
    return draw(scenes, instants, title=title, light=look.light, cones=look.cones)


def _motion(trajectory: Trajectory, speed: float, look: ViewOptions) -> Drawing:
    """Return the drawing of a whole motion."""
    scenes = [phase.scene for phase in trajectory.phases]
    fps = _FPS / speed  # pictures for each second of the motion
    samples = drawn_samples(trajectory, fps)
    instants = instants_of(trajectory, samples.tolist(), forces=look.forces, balance=look.balance)
    frames = fps * (trajectory.t[samples] - trajectory.t[0])
    duration = trajectory.t[-1] - trajectory.t[0]
    title = f"{scenes[0].robot.name}, {duration:.4g} s"
    title += f", {speed:g} x speed" if speed != 1.0 else ""
    return draw(
        scenes, instants, title=title, frames=frames, gaps=gaps_of(trajectory),
        peaks=peaks_of(trajectory), fps=_FPS, speed=speed, light=look.light,
        cones=look.cones,
    )  # fmt: skip


# One page that holds everything: meshcat's viewer, and the commands that draw.


# The commands are decoded at once, in order and without a request, so that a page that is loaded
# is drawn, also from a disk.
_PAGE = """<!DOCTYPE html>
<html>
<head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ margin: 0; }}
#meshcat-pane {{ width: 100vw; height: 100vh; overflow: hidden; }}
#legend {{ position: absolute; left: 12px; top: 10px; font: 13px/1.45 sans-serif; color: #222;
  background: rgba(255, 255, 255, 0.8); padding: 6px 10px; border-radius: 4px; max-width: 40vw; }}
#legend strong {{ display: block; margin-bottom: 3px; }}
#legend b {{ display: inline-block; width: 11px; height: 11px; margin-right: 6px;
  box-shadow: 0 0 0 1px rgba(0, 0, 0, 0.15); }}
#labels {{ position: absolute; left: 0; top: 0; width: 100vw; height: 100vh;
  pointer-events: none; }}
.dg.main .close-button {{ background: transparent !important; color: #888 !important; }}
#player {{ position: absolute; left: 12px; right: 12px; bottom: 10px; display: none; gap: 10px;
  align-items: center; font: 13px sans-serif; color: #222; background: rgba(255, 255, 255, 0.85);
  padding: 6px 10px; border-radius: 4px; }}
#player .play {{ width: 40px; }}
#player .time {{ flex: 1; }}
#player .clock, #player .times {{ width: 62px; font-variant-numeric: tabular-nums; }}
</style></head>
<body>
<div id="meshcat-pane"></div>
<canvas id="labels"></canvas>
<div id="legend">{legend}</div>
<div id="player" data-speed="{speed}"><button class="play" aria-label="play or pause"></button>
<input class="time" type="range" min="0" step="any" value="0" aria-label="time">
<span class="clock"></span><span>speed</span>
<input class="speed" type="range" min="-5" max="3" step="any" value="0" aria-label="speed">
<span class="times">1.0 x</span></div>
<script>{script}</script>
<script>
{lamp}
{viewer}
function draw(text) {{
  viewer.handle_command_bytearray(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
}}
{commands}
viewer.renderer.setClearColor("white", 1);  // cheaper than a background that is drawn
viewer.camera.fov = {field};
viewer.controls.target.set(...{target});
viewer.camera.position.set(...{position}).sub(viewer.controls.target);
if (innerWidth) {{
  viewer.camera.position.multiplyScalar(Math.max(1, {aspect} * innerHeight / innerWidth));
}}
viewer.camera.position.add(viewer.controls.target);
viewer.controls.update();
{scripts}
</script>
</body>
</html>
"""

# Lambert's law for every face, with a lamp beside the eye:
#
#     colour = (0.6 + 0.4 n . l) diffuse
#
# with n the normal of the face and l towards the lamp. three.js knows this law for corners only,
# and its Phong, with the three lamps of meshcat, takes a processor three times as long.
_LAMP = """
MeshCat.THREE.ShaderLib.lambert.vertexShader = `
  varying vec3 point;
  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    point = seen.xyz;
    gl_Position = projectionMatrix * seen;
  }`;
MeshCat.THREE.ShaderLib.lambert.fragmentShader = `
  uniform vec3 diffuse;
  uniform float opacity;
  varying vec3 point;
  void main() {
    vec3 n = normalize(cross(dFdx(point), dFdy(point)));
    gl_FragColor = vec4((0.6 + 0.4 * dot(n, vec3(0.36, 0.48, 0.8))) * diffuse, opacity);
  }`;
"""

# A graphics card smooths edges for nothing. On a processor that is half of the time of a picture:
# there edges are smoothed by more pixels, of what rests.
_VIEWER = """
let pane = document.getElementById("meshcat-pane");
let probe = document.createElement("canvas").getContext("webgl2");
let known = probe && probe.getExtension("WEBGL_debug_renderer_info");
let card = known ? probe.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
var software = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(card);
let renderer = new MeshCat.THREE.WebGLRenderer({antialias: !software, alpha: true});
pane.appendChild(renderer.domElement);
var viewer = new MeshCat.Viewer(pane, false, renderer);
"""
_SCRIPTS = [Path(__file__).with_name(f"{name}.js") for name in ("labels", "player", "pace")]

_MISSING = (
    'pictures in a browser need meshcat and trimesh: python -m pip install "condyn_pin[view]"'
)


def page(
    title: str,
    legend: Iterable[tuple[str, str]],
    commands: Iterable[Command],
    *,
    camera: Array,
    target: Array,
    speed: float = 1.0,
) -> str:
    """Return the page, with a `camera` (3,) that turns about the `target` (3,) [m]."""
    # The `legend` has colours, as CSS names them, and what they mean; without one a line is alone.
    lines = [
        (f"<b style='background: {colour}'></b>" if colour else "") + html.escape(text)
        for colour, text in legend
    ]
    lines[:1] = [f"<strong>{line}</strong>" for line in lines[:1]]
    script = (require_meshcat() / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
    return _PAGE.format(
        title=html.escape(title),
        legend="".join(lines[:1]) + "<br>".join(lines[1:]),
        script=script.replace("</script", "<\\/script"),  # no text of it ends the element
        lamp=_LAMP,
        viewer=_VIEWER,
        commands="\n".join(f'draw("{packed_command(command)}");' for command in commands),
        position=_y_up(camera),
        target=_y_up(target),
        field=FIELD,
        aspect=ASPECT,
        speed=speed,
        scripts="\n".join(path.read_text(encoding="utf-8") for path in _SCRIPTS),
    )


def _y_up(point: Array) -> list[float]:
    """Return a point in the axes of three.js."""
    x, y, z = (float(each) for each in point)
    return [x, z, -y]


def require_meshcat() -> Path:
    """Return the folder of meshcat, which is not imported, or raise MissingExtra."""
    found = importlib.util.find_spec("meshcat")
    if found is None or not found.submodule_search_locations:
        raise MissingExtra(_MISSING)
    for module in ("umsgpack", "PIL", "trimesh", "collada"):
        if importlib.util.find_spec(module) is None:
            raise MissingExtra(_MISSING)
    return Path(found.submodule_search_locations[0])
