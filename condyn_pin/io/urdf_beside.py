"""What a YAML or a TOML beside a URDF adds to it, as the parallel robots of Gepetto have it.

    closed_loop: [[FRAME, FRAME], ...]     the two ends of each loop
    type: [6D, 3D, ...]                    of each loop: 6D is a weld, 3D a ball; 6D if left out;
                                           or a kind of `Loop` with its axis, or a rod's length:
                                           hinge y, planar y, slider x, rod 0.3
    name_mot: [JOINT, ...]                 joints with a motor
    joint_name: [JOINT, ...]               joints that a URDF cannot describe,
    joint_type: [SPHERICAL, ...]           and what they are: SPHERICAL, FIXED, or UJOINT_XY, two
                                           hinges about these axes of the joint's frame

The file is ``ROBOT.yaml`` beside ``ROBOT.urdf``, or ``robot.yaml``; ``.yml`` and ``.toml`` as well.
One that says none of this is another one's, such as the robot.toml of this library.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from reprlib import repr as shortened  # aliases of a YAML may nest without end
from typing import Any, Final, get_args

from condyn_pin._core.files.text import parse_toml, written_out
from condyn_pin._core.names import few, listed
from condyn_pin.constraints.loop import Loop, LoopKind
from condyn_pin.errors import InvalidModel, MissingExtra, unknown_name
from condyn_pin.io.urdf_closures import stem
from condyn_pin.io.xml import place

_KEYS: Final = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
_OWN: Final = ("closed_loop", "name_mot", "joint_name")  # "type" is in files of others too
_KINDS: Final[Mapping[str, str]] = {"6D": "weld", "3D": "ball"}
_TYPES: Final = (*_KINDS, *get_args(LoopKind))
_AXES: Final = tuple(a + b for a in "XYZ" for b in "XYZ" if a != b)
JOINT_TYPES: Final = ("SPHERICAL", "FIXED", *(f"UJOINT_{axes}" for axes in _AXES))
_LARGEST: Final = 2**20  # bytes: a robot with a thousand loops has a tenth


@dataclass(frozen=True)
class Beside:
    """What a file beside a URDF says.

    Attributes
    ----------
    path : Path, optional
        None where there is no such file.
    loops : tuple of Loop, optional
        None if the file names no loops.
    motors : tuple of str
        Joints with a motor.
    joints : mapping of str to str
        Joints to what they are, one of `JOINT_TYPES`.
    unread : tuple of str
        Its other entries.
    """

    path: Path | None = None
    loops: tuple[Loop, ...] | None = None
    motors: tuple[str, ...] = ()
    joints: Mapping[str, str] = field(default_factory=dict)
    unread: tuple[str, ...] = ()

    def unused(self) -> Iterator[str]:
        """Say what of it, and of the joints that it changes, is not used."""
        if self.path is None:
            return
        if self.joints:
            by_kind: dict[str, list[str]] = {}
            for name, kind in self.joints.items():
                by_kind.setdefault(kind, []).append(name)
            made = "; ".join(f"{kind} ({few(names)})" for kind, names in by_kind.items())
            yield f"axes, limits, damping and friction of joints that {self.path.name} makes {made}"
        if self.unread:
            yield f"entries of {self.path.name} that are not read: {listed(self.unread)}"


def read_beside(urdf: Path) -> Beside:
    """Return what the file beside a URDF says.

    Raises
    ------
    InvalidModel
        If it is wrong; the text names the file and the entry.
    MissingExtra
        If it is a YAML, and PyYAML is not installed.
    """
    for path in _candidates(urdf):
        with place(path):
            said = _toml(path) if path.suffix == ".toml" else _yaml(path)
            if said.keys() & set(_OWN):
                return _beside(path, said)
    return Beside()


def _candidates(urdf: Path) -> list[Path]:
    places = [urdf.with_name(stem) for stem in dict.fromkeys((urdf.stem, "robot"))]
    paths = [Path(f"{place}{suffix}") for place in places for suffix in (".yaml", ".yml", ".toml")]
    return [path for path in paths if path.is_file()]


def _text(path: Path) -> str:
    """Return a file that may be meant for a URDF; nothing if no entry of such a file is in it."""
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
        text = content.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):  # it may be anybody's
        return ""
    if not any(key in text for key in _OWN):
        return ""
    if len(content) > _LARGEST:
        raise InvalidModel(f"it has more than {_LARGEST} bytes; is it of a robot?")
    return text


def _toml(path: Path) -> Mapping[str, Any]:
    try:
        return parse_toml(_text(path))
    except ValueError as error:
        raise InvalidModel(f"it is not valid TOML: {error}") from error


def _yaml(path: Path) -> Mapping[str, Any]:
    text = _text(path)
    if not text:
        return {}
    try:
        import yaml
    except ImportError as error:
        raise MissingExtra(
            "a YAML needs PyYAML: python -m pip install 'condyn_pin[yaml]'"
        ) from error

    # of lists that hold themselves each text is met once
    class Printable(yaml.SafeLoader):  # type: ignore[misc]
        def construct_scalar(self, node: Any) -> Any:
            return written_out(super().construct_scalar(node))

    try:
        said = yaml.load(text, Loader=Printable)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise InvalidModel(f"it is not valid YAML: {' '.join(str(error).split())}") from error
    return said if isinstance(said, dict) else {}


def _beside(path: Path, said: Mapping[str, Any]) -> Beside:
    joints, types = (_words(said, key) for key in ("joint_name", "joint_type"))
    if len(joints) != len(types) or len(set(joints)) != len(joints):
        raise InvalidModel(
            f"joint_name has {len(joints)} names, {len(set(joints))} of them different, and "
            f"joint_type has {len(types)}: as many are needed"
        )
    for kind in types:
        if kind.upper() not in JOINT_TYPES:
            raise InvalidModel(f"joint_type: {unknown_name('joint type', kind, JOINT_TYPES)}")
    return Beside(
        path=path,
        loops=tuple(_loops(said)) if "closed_loop" in said else None,
        motors=_words(said, "name_mot"),
        joints={name: kind.upper() for name, kind in zip(joints, types, strict=True)},
        unread=tuple(str(key) for key in said if key not in _KEYS),
    )


def _loops(said: Mapping[str, Any]) -> list[Loop]:
    pairs = said["closed_loop"]
    if not isinstance(pairs, list) or not all(
        isinstance(pair, list) and len(pair) == 2 and all(isinstance(end, str) for end in pair)
        for pair in pairs
    ):
        raise InvalidModel(f"closed_loop = {shortened(pairs)}: a list of pairs of frames is needed")
    kinds = _words(said, "type") if "type" in said else ("6D",) * len(pairs)
    if len(kinds) == 1:  # one for all
        kinds *= len(pairs)
    if len(kinds) != len(pairs):
        raise InvalidModel(f"closed_loop has {len(pairs)} pairs and type {len(kinds)}: as many")
    loops: list[Loop] = []
    for (first, second), kind in zip(pairs, kinds, strict=True):
        name = stem(first) if stem(first) == stem(second) else ""
        taken = name in {loop.name for loop in loops}
        named: dict[str, Any] = {"name": name} if name and not taken else {}
        with place("type"):
            loops.append(Loop(first, second, **_kind(kind), **named))
    return loops


def _kind(text: str) -> dict[str, Any]:
    """Return kind, axis and length of a loop by the text of its type."""
    word, *more = text.split() or [""]
    kind = _KINDS.get(word.upper(), word.lower())
    if kind not in get_args(LoopKind):
        raise InvalidModel(str(unknown_name("type of loop", text, _TYPES)))
    said: dict[str, Any] = {"kind": kind}
    if kind in ("hinge", "slider", "planar") and len(more) == 1:
        return said | {"axis": more[0].lower()}
    if kind == "rod" and len(more) == 1:
        try:
            return said | {"length": float(more[0])}
        except ValueError:
            more = []
    if kind in _KINDS.values() and not more:
        return said
    wanted = {"rod": "a length [m] is needed, as in rod 0.3", "ball": "it stands alone"}
    said_of = wanted.get("ball" if kind == "weld" else kind, f"an axis is needed, as in {kind} y")
    raise InvalidModel(f"{text!r}: {said_of}")


def _words(said: Mapping[str, Any], key: str) -> tuple[str, ...]:
    words = said.get(key, [])
    words = [words] if isinstance(words, str) else words
    if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
        raise InvalidModel(f"{key} = {shortened(words)}: a list of texts is needed")
    return tuple(words)
