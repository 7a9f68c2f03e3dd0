"""The models of an SDF file and of the files that it includes, and which of them is the robot.

A world has everything that is drawn in it; a robot is one model that moves. A <model>, and an
<include> that brings one, are the same here: a `Placed` model, where its owner puts it.

Included files are looked for beside the one that includes them and in the folders above that, down
from the folder of the first file, which nothing leaves.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.names import quoted
from condyn_pin.errors import InvalidModel, unknown_name
from condyn_pin.io.xml import find, floats, label, open_xml, place

_MOST_INCLUDES: Final = 1000  # two files that include each other twice end here
_GRAVITY: Final = (0.0, 0.0, -9.8)  # of a world that does not say it [m/s^2]


class Placed(NamedTuple):
    """A model, and the element that places it: the <model> itself, or an <include>."""

    name: str
    model: Element
    owner: Element
    file: Path  # where the model is written
    version: tuple[int, ...]

    @property
    def axes_of_model(self) -> bool:
        """True if an axis without a frame is in the axes of the model."""
        return self.version < (1, 5)

    @property
    def static(self) -> bool:
        """Whether it stands still."""
        return flag(self.owner if find(self.owner, "static") is not None else self.model, "static")

    @property
    def is_merged(self) -> bool:
        """True if its parts belong to the model around it."""
        where = f"<include> {self.name!r}: merge"
        return self.owner.tag == "include" and truth(self.owner.get("merge", "false"), where)

    def pose(self) -> tuple[Any, str, str]:
        """Return its pose, the name of the base, and the frame in it that is posed."""
        posed = self.owner if find(self.owner, "pose") is not None else self.model
        frame = find(self.owner, "placement_frame")
        said = self.model.get("placement_frame", "") if frame is None else frame.text or ""
        return *pose_in(posed), said.strip()


class Chosen(NamedTuple):
    """The model that is the robot, and the world in which it stands."""

    model: Placed
    gravity: Array | None  # [m/s^2]; None where no world is
    world: Element  # <sdf> where there is none
    unused: tuple[str, ...]  # sentences


class Files:
    """The SDF files to which a first one leads, each opened once."""

    def __init__(self, first: Path) -> None:
        self._first = first
        self._opened: dict[Path, Element] = {}
        self._includes = 0

    @property
    def _top(self) -> Path:
        """The folder that nothing leaves; the first file is open by then, and so it exists."""
        return self._first.resolve().parent

    def chosen(self, name: str | None) -> Chosen:
        """Return the model of a name, or the only one that moves."""
        sdf = self._open(self._first)
        worlds = sdf.findall("world")
        found: list[tuple[Placed, Element]] = []
        lost: list[str] = []
        for world in (sdf, *worlds):
            for model, uri in self.models_in(world, self._first, _version(sdf)):
                if model is None:
                    lost.append(uri)
                else:
                    found.append((model, world))
        placed = [model for model, _ in found]
        model = _choice(placed, lost, name)
        home = next(world for candidate, world in found if candidate is model)
        if home is sdf and len(worlds) == 1:
            home = worlds[0]
        still = [other.name for other in placed if other is not model and other.static]
        moving = [other.name for other in placed if other is not model and not other.static]
        said = {
            "static models, which stand around": still,
            "other models": moving,
            "includes without a model, or not in the folder of the file": lost,
        }
        unused = [f"{what}: {quoted(names)}" for what, names in said.items() if names]
        gravity = None
        if home.tag == "world":
            gravity, given = _gravity(home)
            if not given:
                unused.append("gravity is left out of the <world>: 9.8 m/s^2, as the format has it")
        return Chosen(model, gravity, home, tuple(unused))

    def models_in(
        self, owner: Element, file: Path, version: tuple[int, ...]
    ) -> Iterator[tuple[Placed | None, str]]:
        """Yield the models below an element; None, and the address, for what brings none."""
        for element in owner:
            if element.tag == "model":
                name = element.get("name", "")
                yield Placed(name, element, element, file, version), ""
            elif element.tag == "include":
                uri = (element.findtext("uri") or "").strip()
                inside = self._find(uri, file.resolve().parent)
                yield (None if inside is None else self._included(element, inside)), uri

    def _included(self, include: Element, file: Path) -> Placed | None:
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
        return Placed(name, models[0], include, file, _version(sdf))

    def _find(self, uri: str, folder: Path) -> Path | None:
        """Return the file of an address, if it is in a folder or above it, below the first one."""
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
    """Return the numbers of a version; none if it is not made of numbers."""
    parts = version.split(".")
    return tuple(int(p[:9]) for p in parts) if all(p.isdecimal() for p in parts) else ()


def _version(sdf: Element) -> tuple[int, ...]:
    said = sdf.get("version", "")
    version = _numbers(said)
    if version < (1, 4):
        raise InvalidModel(f"<sdf> has version {said!r}; 1.4 or later is needed")
    return version


def _choice(models: list[Placed], lost: list[str], name: str | None) -> Placed:
    names = [model.name for model in models]
    if name is None:
        found = [model for model in models if not model.static]
    elif name in names:
        found = [model for model in models if model.name == name]
    else:
        raise unknown_name("model", name, names)
    if len(found) > 1:
        moving = quoted(model.name for model in found[:8]) + ", ..." * (len(found) > 8)
        raise InvalidModel(
            f"the file has the models {moving}, which can move; choose one with model="
            f"{found[0].name!r}" + ("" if name is None else "; rename those of one name")
        )
    if not models:
        included = f", but <include> {quoted(lost)}, not found in its folder" if lost else ""
        raise InvalidModel(f"the file has no <model>{included}; one that moves is needed")
    if not found or found[0].static:
        still = quoted(model.name for model in (found or models)[:8])
        raise InvalidModel(
            f"<static> models do not move: {still}; take <static> out of the one that is the robot"
        )
    return found[0]


def _gravity(world: Element) -> tuple[Array, bool]:
    """Return the gravity of a world, and whether the file says it; before 1.6 <physics> had it."""
    for path in ("gravity", "physics/gravity"):
        if (said := world.find(path)) is not None:
            return floats(said.text, 3, f"{label(world)}: <{path}>"), True
    return np.array(_GRAVITY), False


def flag(element: Element, path: str, default: str = "false") -> bool:
    """Whether an element says yes."""
    found = find(element, path)
    return truth(default if found is None else found.text or "", f"{label(element)}: <{path}>")


def truth(said: str, where: str) -> bool:
    """Return true or false as the format writes it; `where` is what an error says first."""
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
