"""The graph of an SDF file: where each part is drawn, and the link that it moves with.

Every link, joint and frame x is placed by a pose in another one, and the poses multiply up to the
model frame o,

    oMx = oMbase · baseMx,    base = `relative_to`, else the model (link), the child (joint)
    R   = Rz(yaw) Ry(pitch) Rx(roll)

A model n in the model is a frame of its name, and its parts are named n::x. Where its owner poses a
frame p in it (`placement_frame`), baseMn = baseMp · nMp⁻¹. One that is merged has its parts in the
scope of its owner, and is the frame _merged__n__model__ there.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree.ElementTree import Element

from condyn_pin._core._pin import pin
from condyn_pin.errors import InvalidModel, UnknownName, unknown_name
from condyn_pin.io.sdf_types import WORLD
from condyn_pin.io.sdf_world import Files, Placed, pose_in
from condyn_pin.io.xml import find, label

MODEL: Final = "__model__"
_UNIQUE: Final = (1, 7)  # since when a joint cannot have the name of a link
_DEEPEST: Final = 30  # models, each in the one before
_MOST_ELEMENTS: Final = 500_000  # of a file that is included again and again


class Part(NamedTuple):
    """A link, a joint, a frame, or a model in the model, and how its words are meant."""

    element: Element
    scope: str  # "" or "arm::hand::", before each name in it
    model: Placed  # in which it is; of a model, that model
    merged: str = ""  # the frame of a model that is merged into the one around it

    @property
    def home(self) -> str:
        """The frame of the model that it is in."""
        return self.named(MODEL)

    @property
    def inside(self) -> str:
        """Scope of the names in a model."""
        return self.scope if self.model.is_merged else f"{self.scope}{self.model.name}::"

    def named(self, name: str) -> str:
        """Return a name that it says, as the model around everything would say it."""
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


def parts_of(top: Placed, files: Files) -> dict[str, Part]:
    """Return what has a name in a model and in the models in it: they share one scope each."""
    parts: dict[str, Part] = {}
    depth: dict[int, int] = {}  # of each model, those around it
    waiting, count = [(top, "", "")], 0
    for model, scope, merged in waiting:  # it grows
        count += len(model.model)
        if count > _MOST_ELEMENTS:
            raise InvalidModel(f"more than {_MOST_ELEMENTS} elements in all that is included")
        for element in model.model:
            if element.tag in ("link", "joint", "frame"):
                _add(parts, Part(element, scope, model, merged), element.get("name", ""))
        for inner, uri in files.models_in(model.model, model.file, model.version):
            if inner is None:
                raise InvalidModel(
                    f"{label(model.model)} has <include> {uri!r}, which brings no model from the "
                    "folder of the file; put it there, or write out what is included"
                )
            depth[id(inner)] = depth.get(id(model), 0) + 1
            _check_inner(inner, depth[id(inner)])
            part = Part(inner.owner, scope, inner, merged)
            name = f"_merged__{inner.name}__model__" if inner.is_merged else inner.name
            _add(parts, part, name)
            waiting.append((inner, part.inside, scope + name if inner.is_merged else ""))
    return parts


def links_in(path: Path, model: str) -> list[tuple[str, Element, Path]]:
    """Return the links of a model in a file, by name, and the files in which they are written.

    It is the model of a name, or the only one that moves, whatever the robot is called.
    """
    files = Files(path)
    try:
        chosen = files.chosen(model)
    except UnknownName:
        chosen = files.chosen(None)
    parts = parts_of(chosen.model, files)
    return [
        (name, part.element, part.model.file)
        for name, part in parts.items()
        if part.element.tag == "link"
    ]


def _add(parts: dict[str, Part], part: Part, name: str) -> None:
    element = part.element
    if not name.strip() or name in (WORLD, MODEL):
        raise InvalidModel(f"a <{element.tag}> is named {name!r}; give it a name of its own")
    name = part.scope + name
    if name in parts and element.tag == "joint" and part.model.version < _UNIQUE:
        name = f"{name}_joint"  # as the format renames what was allowed before
    if name in parts:
        raise InvalidModel(f"{label(parts[name].element)} and {label(element)}: rename one of them")
    parts[name] = part


def _check_inner(inner: Placed, depth: int) -> None:
    where = f"<model> {inner.name!r} in the model"
    if depth > _DEEPEST:
        raise InvalidModel(f"{where}: more than {_DEEPEST} models, each in another")
    if inner.static:
        raise InvalidModel(
            f"{where} is <static>: fix its links to the 'world' by a joint, and take <static> out"
        )


def model_poses(parts: Mapping[str, Part], top: Placed) -> dict[str, Any]:
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


def is_model(part: Part) -> bool:
    """Whether a part is a model in the model."""
    return part.element.tag in ("model", "include")


def links_of(parts: Mapping[str, Part], top: Placed) -> dict[str, str]:
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
    name: str, base: Mapping[str, str], ends: Container[str], parts: Mapping[str, Part]
) -> list[str]:
    """Return `name`, its base, the base of that, and so on up to one of `ends`."""
    chain = {name: None}  # a dict keeps the order and finds members at once
    while name not in ends:
        if base.get(name) not in base and base.get(name) not in ends:
            known = unknown_name("link or frame", base.get(name, name), base)
            raise InvalidModel(f"{_said(name, parts)}: {known}")
        name = base[name]
        if name in chain:
            raise InvalidModel(
                f"{_said(name, parts)}: {' -> '.join([*chain, name])} are placed in a circle; "
                "place one of them in the model"
            )
        chain[name] = None
    return list(chain)


def _said(name: str, parts: Mapping[str, Part]) -> str:
    return label(parts[name].element) if name in parts else f"<model> {name!r}"


def pose_of(name: str, poses: Mapping[str, Any], element: Element) -> Any:
    """Return oMx of the part that an element names."""
    if name not in poses:
        raise InvalidModel(f"{label(element)}: {unknown_name('frame', name, poses)}")
    return poses[name]
