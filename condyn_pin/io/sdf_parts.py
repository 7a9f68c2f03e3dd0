"""The parts of an SDF file: its models and those it includes, and their poses.

A world has everything that is drawn in it; a robot is one model that moves, or several of them,
which are then the models in a model that stands in the world, with the world's joints between
them. A <model>, and an <include> that brings one, are the same here: a `PlacedModel`,
where its owner puts it. Included files are looked for beside the one that includes them and in the
folders above that, down from the folder of the first file, which nothing leaves.

Every link, joint and frame x is placed by a pose in another one, and the poses multiply up to the
model frame o,

    oMx = oMbase · baseMx,    base = `relative_to`, else the model (link), the child (joint)
    R   = Rz(yaw) Ry(pitch) Rx(roll)

A model n in the model is a frame of its name, and its parts are named n::x. Where its owner poses a
frame p in it (`placement_frame`), baseMn = baseMp · nMp⁻¹. One that is merged has its parts in the
scope of its owner, and is the frame _merged__n__model__ there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import quoted_names
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument, InvalidModel, UnknownName, unknown_name
from condyn_pin.io.xml import find, floats, label, open_xml, place

WORLD: Final = "world"
_MOST_INCLUDES: Final = 1000  # two files that include each other twice end here
_GRAVITY: Final = (0.0, 0.0, -9.8)  # of a world that does not say it [m/s^2]


class PlacedModel(NamedTuple):
    """A model, and the element that places it: the <model> itself, or an <include>."""

    name: str
    model: Element
    owner: Element
    file: Path  # where the model is written
    version: tuple[int, ...]

    @property
    def static(self) -> bool:
        """True if the model is static."""
        return flag(self.owner if find(self.owner, "static") is not None else self.model, "static")

    @property
    def is_merged(self) -> bool:
        """True if its parts belong to the model around it."""
        where = f"<include> {self.name!r}: merge"
        return self.owner.tag == "include" and truth(self.owner.get("merge", "false"), where)

    def pose(self) -> tuple[Any, str, str]:
        """Return its pose, the name of the base frame, and its own frame that has this pose."""
        posed = self.owner if find(self.owner, "pose") is not None else self.model
        frame = find(self.owner, "placement_frame")
        said = self.model.get("placement_frame", "") if frame is None else frame.text or ""
        return *pose_in(posed), said.strip()


class ModelInWorld(NamedTuple):
    """The model that is the robot, and the world in which it stands."""

    model: PlacedModel
    gravity: Array | None  # [m/s^2]; None where no world is
    world: Element  # <sdf> where there is none; without what belongs to the robot
    unused: tuple[str, ...]  # sentences
    models: tuple[str, ...] = ()  # of which the robot is made, if they are several


class SdfFiles:
    """The SDF files to which a first one leads, each opened once."""

    def __init__(self, first: Path) -> None:
        self._first = first
        self._opened: dict[Path, Element] = {}
        self._includes = 0

    @property
    def _top(self) -> Path:
        """Topmost folder for includes: that of the first file, which is open by then."""
        return self._first.resolve().parent

    def chosen(self, wanted: str | Sequence[str] | None) -> ModelInWorld:
        """Return the model of a name, those of several names as one, or the only one that moves."""
        sdf = self._open(self._first)
        worlds = sdf.findall("world")
        found: list[tuple[PlacedModel, Element]] = []
        lost: list[str] = []
        for world in (sdf, *worlds):
            for model, uri in self.models_in(world, self._first, _version(sdf)):
                if model is None:
                    lost.append(uri)
                else:
                    found.append((model, world))
        placed = [model for model, _ in found]
        names: Sequence[str | None] = (
            [wanted] if wanted is None or isinstance(wanted, str) else wanted
        )
        taken = [_choice(placed, lost, name) for name in names]
        homes = [next(w for candidate, w in found if candidate is model) for model in taken]
        home, model = homes[0], taken[0]
        if any(other is not home for other in homes):
            said = quoted_names(each.name for each in taken)
            raise InvalidModel(f"the models {said} are in different worlds; choose of one")
        if home is sdf and len(worlds) == 1:
            home = worlds[0]
        if several := names is wanted:
            model, home = _as_one(taken, home, self._first)
        still = [other.name for other in placed if other not in taken and other.static]
        moving = [other.name for other in placed if other not in taken and not other.static]
        about = {
            "static models, which stand around": still,
            "other models": moving,
            "includes without a model, or not in the folder of the file": lost,
        }
        unused = [f"{what}: {quoted_names(each)}" for what, each in about.items() if each]
        gravity = None
        if home.tag == "world":
            gravity, given = _gravity(home, _version(sdf))
            if not given:
                unused.append("gravity is left out of the <world>: 9.8 m/s^2, as the format has it")
        inner = tuple(each.name for each in taken) if several else ()
        return ModelInWorld(model, gravity, home, tuple(unused), inner)

    def models_in(
        self, owner: Element, file: Path, version: tuple[int, ...]
    ) -> Iterator[tuple[PlacedModel | None, str]]:
        """Yield the models below an element, with URIs; None for an include without a model."""
        for element in owner:
            if element.tag == "model":
                name = element.get("name", "")
                yield PlacedModel(name, element, element, file, version), ""
            elif element.tag == "include":
                uri = (element.findtext("uri") or "").strip()
                inside = self._find(uri, file.resolve().parent)
                yield (None if inside is None else self._included(element, inside)), uri

    def _included(self, include: Element, file: Path) -> PlacedModel | None:
        self._includes += 1
        if self._includes > _MOST_INCLUDES:
            raise InvalidModel(f"more than {_MOST_INCLUDES} files are included; write them out")
        with place(file.relative_to(self._top)):
            sdf = self._open(file)
            models = sdf.findall("model")
            if len(models) > 1:
                raise InvalidModel(f"{len(models)} <model> in an included file; one is needed")
        if not models:  # but a light or an actor
            return None
        name = (include.findtext("name") or "").strip() or models[0].get("name", "")
        return PlacedModel(name, models[0], include, file, _version(sdf))

    def _find(self, uri: str, folder: Path) -> Path | None:
        """File of a URI in a folder or one above it, within the first file's; None without one."""
        name, top = uri.removeprefix("model://").removeprefix("file://"), self._top
        while name and folder.is_relative_to(top):
            try:
                path = (folder / name).resolve()
                if path.is_dir() and path.is_relative_to(top):
                    path = (path / _model_file(path)).resolve()
                if path.is_relative_to(top) and path.is_file():
                    return path
            except (OSError, RuntimeError):  # a name that is too long, links in a circle
                return None
            folder = folder.parent
        return None

    def _open(self, file: Path) -> Element:
        if file not in self._opened:
            self._opened[file] = open_xml(file, "sdf")
            _version(self._opened[file])
        return self._opened[file]


def _model_file(folder: Path) -> str:
    """Name of the newest file in a folder's model.config; model.sdf without one."""
    config = folder / "model.config"
    if not config.is_file():
        return "model.sdf"
    files = open_xml(config).findall("sdf")
    newest = max(files, key=lambda file: _numbers(file.get("version", "")), default=None)
    return "model.sdf" if newest is None else (newest.text or "").strip()


def _numbers(version: str) -> tuple[int, ...]:
    """Numbers of a version; empty if it is not made of numbers."""
    parts = version.split(".")
    return tuple(int(p[:9]) for p in parts) if all(p.isdecimal() for p in parts) else ()


def _version(sdf: Element) -> tuple[int, ...]:
    said = sdf.get("version", "")
    version = _numbers(said)
    if version < (1, 4):
        raise InvalidModel(f"<sdf> has version {said!r}; 1.4 or later is needed")
    return version


def _choice(models: list[PlacedModel], lost: list[str], name: str | None) -> PlacedModel:
    names = [model.name for model in models]
    if name is None:
        found = [model for model in models if not model.static]
    elif name in names:
        found = [model for model in models if model.name == name]
    else:
        raise unknown_name("model", name, names)
    if len(found) > 1:
        moving = quoted_names(model.name for model in found[:8]) + ", ..." * (len(found) > 8)
        raise InvalidModel(
            f"the file has the models {moving}, which can move; choose one with model="
            f"{found[0].name!r}, or several, model=[...]"
            + ("" if name is None else "; rename those of one name")
        )
    if not models:
        included = f", but <include> {quoted_names(lost)}, not found in its folder" if lost else ""
        raise InvalidModel(f"the file has no <model>{included}; one that moves is needed")
    if not found or found[0].static:
        still = quoted_names(model.name for model in (found or models)[:8])
        raise InvalidModel(
            f"<static> models do not move: {still}; take <static> out of the one that is the robot"
        )
    return found[0]


def _as_one(
    models: Sequence[PlacedModel], world: Element, file: Path
) -> tuple[PlacedModel, Element]:
    """Models of a world as the models in one, with its joints and frames, and the rest of it."""
    names = {model.name for model in models}
    if len(names) < len(models):
        raise InvalidArgument(f"model = {[model.name for model in models]}: one is there twice")
    frames = {frame.get("name", "") for frame in world.findall("frame")}
    strangers = {e.get("name", "") for e in world.findall("model")} - names
    strangers |= {(e.findtext("name") or "").strip() for e in world.findall("include")} - names

    def belongs(element: Element) -> bool:
        """True unless a joint or a frame of the world is at a model that is not chosen."""
        ends = [element.findtext("parent"), element.findtext("child")]
        ends += [element.get("attached_to")]
        ends += [pose.get("relative_to") for pose in element.findall("pose")]
        said = {(end or "").strip().partition("::")[0] for end in ends}
        return element.tag in ("joint", "frame") and not (said - frames) & strangers

    own = [element for element in world if belongs(element)]
    whole = Element("model", name=" + ".join(model.name for model in models))
    whole.extend([*(model.owner for model in models), *own])
    rest = Element(world.tag, world.attrib)
    others = {id(element) for element in world} - {id(element) for element in own}
    rest.extend(element for element in world if id(element) in others)
    return PlacedModel(whole.get("name", ""), whole, whole, file, models[0].version), rest


def _gravity(world: Element, version: tuple[int, ...]) -> tuple[Array, bool]:
    """Gravity of a world [m/s^2], and True if the file has it; before 1.6 <physics> had it."""
    for path in ("gravity", "physics/gravity")[: 2 if version < (1, 6) else 1]:
        if (said := world.find(path)) is not None:
            return floats(said.text, 3, f"{label(world)}: <{path}>"), True
    return np.array(_GRAVITY), False


def flag(element: Element, path: str, default: str = "false") -> bool:
    """True if the flag at a path is true."""
    found = find(element, path)
    return truth(default if found is None else found.text or "", f"{label(element)}: <{path}>")


def truth(said: str, where: str) -> bool:
    """Return the boolean of a text in the format; errors begin with `where`."""
    word = said.strip().lower()
    if word not in ("0", "1", "false", "true"):
        raise InvalidModel(f"{where} is {word!r}; write true or false")
    return word in ("1", "true")


def pose_in(element: Element, path: str = "pose") -> tuple[Any, str]:
    """Return baseMx and the name of its base, "" for the default one."""
    pose = find(element, path)
    if pose is None:
        return pin.SE3.Identity(), ""
    base, where = pose.get("relative_to") or pose.get("frame") or "", f"{label(element)}: <{path}>"
    form = pose.get("rotation_format", "euler_rpy")
    if form not in ("euler_rpy", "quat_xyzw"):
        raise InvalidModel(f"{where} has rotation_format={form!r}; write euler_rpy or quat_xyzw")
    degrees = truth(pose.get("degrees", "false"), f"{where}, degrees,")
    if degrees and form == "quat_xyzw":
        raise InvalidModel(f"{where} is a quaternion in degrees; leave one of the two out")
    if not (pose.text or "").strip():
        return pin.SE3.Identity(), base
    x = floats(pose.text, 6 if form == "euler_rpy" else 7, where)
    if form == "euler_rpy":
        roll, pitch, yaw = np.radians(x[3:]) if degrees else x[3:]
        return pin.SE3(pin.rpy.rpyToMatrix(roll, pitch, yaw), x[:3]), base
    size = np.linalg.norm(x[3:])
    if not 0.5 < size < 2:  # digits are lost, but no numbers
        raise InvalidModel(f"{where} has a quaternion of length {size:g}; make it 1")
    return pin.SE3(pin.Quaternion(x[3:] / size).toRotationMatrix(), x[:3]), base


MODEL: Final = "__model__"
_UNIQUE: Final = (1, 7)  # since when a joint cannot have the name of a link
_DEEPEST: Final = 30  # models, each in the one before
_MOST_ELEMENTS: Final = 500_000  # of a file that is included again and again


class SdfPart(NamedTuple):
    """A link, a joint, a frame, or a nested model, and the scope of its names."""

    element: Element
    scope: str  # "" or "arm::hand::", before each name in it
    model: PlacedModel  # in which it is; of a model, that model
    merged: str = ""  # the frame of a model that is merged into the one around it

    @property
    def home(self) -> str:
        """Frame of the model that the part is in."""
        return self.named(MODEL)

    @property
    def inside(self) -> str:
        """Scope of the names in a model."""
        return self.scope if self.model.is_merged else f"{self.scope}{self.model.name}::"

    def named(self, name: str) -> str:
        """Return a name of the part's scope in the scope of the outermost model."""
        if name == MODEL and self.merged:
            return self.merged
        return name if name in ("", WORLD) else _flat(self.scope + name)

    def word(self, tag: str) -> str:
        """Return the name that an element of a joint holds."""
        found = find(self.element, tag)
        name = "" if found is None else (found.text or "").strip()
        if not name:
            raise InvalidModel(f"{label(self.element)}: no <{tag}>; write the name of a link there")
        return self.named(name)

    def pose(self, path: str = "pose") -> tuple[Any, str]:
        """Return baseMx and its base, "" for the default one."""
        placement, base = pose_in(self.element, path)
        return placement, self.named(base)


def _flat(name: str) -> str:
    return name.removesuffix(f"::{MODEL}")


def parts_of(top: PlacedModel, files: SdfFiles) -> dict[str, SdfPart]:
    """Return the named parts of a model and of its nested models, one scope for each model."""
    parts: dict[str, SdfPart] = {}
    depth: dict[int, int] = {}  # of each model, those around it
    waiting, count = [(top, "", "")], 0
    for model, scope, merged in waiting:  # it grows
        count += len(model.model)
        if count > _MOST_ELEMENTS:
            raise InvalidModel(f"more than {_MOST_ELEMENTS} elements in all that is included")
        for element in model.model:
            if element.tag in ("link", "joint", "frame"):
                _add(parts, SdfPart(element, scope, model, merged), element.get("name", ""))
        for inner, uri in files.models_in(model.model, model.file, model.version):
            if inner is None:
                raise InvalidModel(
                    f"{label(model.model)} has <include> {uri!r}, which brings no model from the "
                    "folder of the file; put it there, or write out what is included"
                )
            depth[id(inner)] = depth.get(id(model), 0) + 1
            _check_inner(inner, depth[id(inner)])
            part = SdfPart(inner.owner, scope, inner, merged)
            name = f"_merged__{inner.name}__model__" if inner.is_merged else inner.name
            _add(parts, part, name)
            waiting.append((inner, part.inside, scope + name if inner.is_merged else ""))
    return parts


def short_names(parts: Collection[str], models: Sequence[str]) -> dict[str, str]:
    """Name of each part without that of its model, of several, where no other part has it."""
    bare = {
        name: rest if model in models and rest else name
        for name, (model, _, rest) in ((name, name.partition("::")) for name in parts)
    }
    count = Counter(bare.values())
    return {name: short if count[short] == 1 else name for name, short in bare.items()}


def links_in(path: Path, model: str) -> list[tuple[str, Element, Path]]:
    """Return the links of a model in a file, by name, and the files in which they are written."""
    # It is the model of a name, several with + between their names, or the only one that moves,
    # whatever the robot is called.
    files = SdfFiles(path)
    try:
        chosen = files.chosen(model.split(" + ") if " + " in model else model)
    except UnknownName:
        chosen = files.chosen(None)
    parts = parts_of(chosen.model, files)
    short = short_names(parts, chosen.models)
    return [
        (short[name], part.element, part.model.file)
        for name, part in parts.items()
        if part.element.tag == "link"
    ]


def _add(parts: dict[str, SdfPart], part: SdfPart, name: str) -> None:
    element = part.element
    if not name.strip() or name in (WORLD, MODEL):
        raise InvalidModel(f"a <{element.tag}> is named {name!r}; give it a name of its own")
    name = part.scope + name
    if name in parts and element.tag == "joint" and part.model.version < _UNIQUE:
        name = f"{name}_joint"  # as the format renames what was allowed before
    if name in parts:
        raise InvalidModel(f"{label(parts[name].element)} and {label(element)}: rename one of them")
    parts[name] = part


def _check_inner(inner: PlacedModel, depth: int) -> None:
    where = f"<model> {inner.name!r} in the model"
    if depth > _DEEPEST:
        raise InvalidModel(f"{where}: more than {_DEEPEST} models, each in another")
    if inner.static:
        raise InvalidModel(
            f"{where} is <static>: fix its links to the 'world' by a joint, and take <static> out"
        )


def model_poses(parts: Mapping[str, SdfPart], top: PlacedModel) -> dict[str, Any]:
    """Return oMx of every part x, of the model and of the world."""
    placement, base, posed = {MODEL: top.pose()[0]}, {MODEL: WORLD}, {MODEL: top.pose()[2]}
    if top.pose()[1] not in ("", WORLD):
        raise InvalidModel(
            f"{label(top.model)}: pose relative to {top.pose()[1]!r}; place it in the world"
        )
    for name, part in parts.items():
        if is_model(part):
            placement[name], named, frame = part.model.pose()
            base[name], posed[name] = part.named(named) or part.home, frame and part.inside + frame
            continue
        placement[name], named = part.pose()
        if part.element.tag == "joint":
            base[name] = named or part.word("child")
        else:
            base[name] = named or part.named(part.element.get("attached_to", "")) or part.home
    for name, frame in reversed(posed.items()):  # the inner models first
        nMp = pin.SE3.Identity()
        for member in _chain(_flat(frame or name), base, {name}, parts)[:-1]:
            nMp = placement[member] * nMp
        placement[name] = placement[name] * nMp.inverse()
    poses = {MODEL: pin.SE3.Identity(), WORLD: placement[MODEL].inverse()}
    for name in parts:
        for member in reversed(_chain(name, base, poses, parts)[:-1]):
            poses[member] = poses[base[member]] * placement[member]
    return poses


def is_model(part: SdfPart) -> bool:
    """True if a part is a nested model."""
    return part.element.tag in ("model", "include")


def links_of(parts: Mapping[str, SdfPart], top: PlacedModel) -> dict[str, str]:
    """Return the link that every part moves with: a joint moves with its child."""
    links = [name for name, part in parts.items() if part.element.tag == "link"]
    base = {name: name for name in links}
    first: dict[str, str] = {}  # of each model, its first link, or else the first model in it
    for tags in (("link",), ("model", "include")):
        for name, part in parts.items():
            if part.element.tag in tags:
                first.setdefault(part.home, name)
    models = {MODEL: (top, "")}
    models |= {name: (p.model, p.inside) for name, p in parts.items() if is_model(p)}
    for name, (model, scope) in models.items():
        if name not in first:
            raise InvalidModel(f"{label(model.model)}: no <link>; at least one is needed")
        canonical = model.model.get("canonical_link", "")
        base[name] = scope + canonical if canonical else first[name]
    for name, part in parts.items():
        if part.element.tag == "joint":
            base[name] = part.word("child")
        elif part.element.tag == "frame":
            base[name] = part.named(part.element.get("attached_to", "")) or part.home
    found = {name: name for name in (WORLD, *links)}
    for name in base:
        chain = _chain(name, base, found, parts)
        found.update(dict.fromkeys(chain, found[chain[-1]]))
    return found


def _chain(
    name: str, base: Mapping[str, str], ends: Container[str], parts: Mapping[str, SdfPart]
) -> list[str]:
    """Return `name`, its base, the base of that, and so on up to one of `ends`."""
    chain = {name: None}  # a dict keeps the order and finds members at once
    while name not in ends:
        if base.get(name) not in base and base.get(name) not in ends:
            known = unknown_name("link or frame", base.get(name, name), base)
            raise InvalidModel(f"{_names_text(name, parts)}: {known}")
        name = base[name]
        if name in chain:
            raise InvalidModel(
                f"{_names_text(name, parts)}: {' -> '.join([*chain, name])} are placed in a "
                "circle; place one of them in the model"
            )
        chain[name] = None
    return list(chain)


def _names_text(name: str, parts: Mapping[str, SdfPart]) -> str:
    return label(parts[name].element) if name in parts else f"<model> {name!r}"


def pose_of(name: str, poses: Mapping[str, Any], element: Element) -> Any:
    """Return the pose oMx of the part that an element names."""
    if name not in poses:
        raise InvalidModel(f"{label(element)}: {unknown_name('frame', name, poses)}")
    return poses[name]
