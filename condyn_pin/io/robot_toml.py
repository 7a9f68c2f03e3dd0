"""robot.toml: its schema, the pieces that a variant chooses, and the robot that it makes.

Errors name the entry of the file, its value, and the values that are allowed.

    [variants.springs.free]
    [variants.springs.locked.description]
    lock = ["left-knee-shin-joint"]

The first value of an option is its default. A piece has the entries of the config: tables are
merged, lists grow, and the rest is replaced. docs/robot-toml.md has the format.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import short_list
from condyn_pin._core.arrays import Array
from condyn_pin._core.files import parse_toml, read_text
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.kinds import Loop, bind, kinds_by_word
from condyn_pin.constraints.rows.bound import gap_of
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.io.description import Description, check_root_joint, description_file
from condyn_pin.io.xml import place
from condyn_pin.model.joints import CoupledMotor, Limits, with_values
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import lock_joints


def read_config(path: Path, variant: Mapping[str, str]) -> Robot:
    """Return the robot of a robot.toml."""
    with place(path):
        try:
            config = parse_toml(read_text(path))
        except (OSError, ValueError) as error:
            raise InvalidModel(str(error)) from error
        return _robot(chosen_config(config, variant), path.parent)


def read_alone(
    source: Path | str, root_joint: str, model: str | Sequence[str] | None = None
) -> Robot:
    """Return the robot of a description without a robot.toml: a file, or a URDF's text."""
    if isinstance(source, Path):
        about = {} if model is None else {"model": model}
        read, where = _read_description(source, about, root_joint, ()), str(source)
        of_file = {"source": where, "description": where}
    else:
        from condyn_pin.io.urdf import read_urdf

        read, where, of_file = read_urdf(source, root_joint), "the text of a URDF", {}
    with place(where):
        name = read.name or (source.stem if isinstance(source, Path) else "robot")
        robot = read.robot(name=name, **of_file)
        for loop in robot.loops:
            bind(robot, [loop])
        return _with_notices(robot)


def _robot(config: Mapping[str, Any], folder: Path) -> Robot:
    check_config(config)
    description = config["description"]
    file = description_file(description["file"], folder)
    root_joint = description.get("root_joint", "fixed")
    check_root_joint(root_joint)
    read = _read_description(file, description, root_joint, config.get("actuated", ()))
    found, exclusions, unknown = _of_srdf(description, folder, read)
    for name, values in config.get("postures", {}).items():
        with place(f"postures.{name}"):
            found[name] = with_values(read.model, np.array(pin.neutral(read.model)), values)
    own = loops_of(config.get("loops", ()))
    ends = {_ends(loop) for loop in own}
    said = {key: config[key] for key in ("name", "precision") if key in config}
    robot = read.robot(
        **said,
        **_motors(config),
        postures={**found, **read.postures, **found},
        exclusions=read.exclusions | exclusions,
        unused=(*read.unused, *unknown),
        loops=(*(loop for loop in read.loops if _ends(loop) not in ends), *own),
        contacts=contacts_of(config.get("contacts", ())),
        source=config.get("source", "unknown"),
        licence=config.get("licence", "unknown"),
        description=str(file),
    )
    for i, table in enumerate(config.get("frames", ())):
        with place(f"frames[{i}]"):
            robot = robot.with_frame(**table)
    _check_constraints(robot, own)
    return _with_notices(lock_joints(robot, description.get("lock", ())))


def _read_description(
    file: Path, description: Mapping[str, Any], root_joint: str, actuated: Sequence[str]
) -> Description:
    """Description in a file, by the reader of its format, which is imported on demand."""
    if file.suffix == ".xml":
        from condyn_pin.io.mjcf import read_mjcf

        return read_mjcf(file)
    if file.suffix != ".sdf":
        from condyn_pin.io.urdf import read_urdf

        return read_urdf(file, root_joint, mimic=description.get("mimic", True))
    from condyn_pin.io.sdf import read_sdf

    options = {key: description[key] for key in FOR_SDF if key in description}
    if root_joint == "free_flyer":
        options["root_joint"] = pin.JointModelFreeFlyer()
    read = read_sdf(file, actuated=actuated, **options)
    if read.model.nv == 0:
        raise InvalidModel(
            f"{file}: the model has no degree of freedom: no joint moves, and the root link is "
            'fixed; floating=True, in a robot.toml root_joint = "free_flyer", lets it float'
        )
    return read


def _motors(config: Mapping[str, Any]) -> dict[str, Any]:
    """Motors of the config, all of them if it has any, else those of the description."""
    if "actuated" not in config and "coupled_motors" not in config:
        return {}
    tables = enumerate(config.get("coupled_motors", ()))
    return {
        "actuated": tuple(config.get("actuated", ())),
        "coupled_motors": [
            _value_of_table(CoupledMotor, table, f"coupled_motors[{i}]") for i, table in tables
        ],
    }


def _of_srdf(
    description: Mapping[str, Any], folder: Path, read: Description
) -> tuple[dict[str, Array], frozenset[frozenset[str]], tuple[str, ...]]:
    """Postures of the SRDF, pairs of links that do not collide, and what it has beside."""
    if "srdf" not in description:
        return {}, frozenset(), ()
    from condyn_pin.io.urdf import read_exclusions, read_srdf

    srdf, rotors = description_file(description["srdf"], folder), description.get("rotors", False)
    found = read_srdf(read.model, srdf, rotors=rotors, inverted=read.reversed)
    return found, *read_exclusions(read.model, srdf)


def _check_constraints(robot: Robot, own: Sequence[Constraint]) -> None:
    """Refuse loops and contacts that do not fit the robot, at loading instead of in a scene."""
    first = len(robot.loops) - len(own)
    places: list[tuple[str, Constraint]] = [
        *((f"loop {loop.name!r} of the description", loop) for loop in robot.loops[:first]),
        *((f"loops[{i}]", loop) for i, loop in enumerate(own)),
        *((f"contacts[{i}]", contact) for i, contact in enumerate(robot.contacts)),
    ]
    before: list[Constraint] = []
    for where, constraint in places:
        before.append(constraint)
        with place(where):
            bind(robot, before)


def _with_notices(robot: Robot) -> Robot:
    """Robot with its locked joints and its open loops added to `Robot.unused`."""
    said, limits = [*_gaps(robot)], Limits.of(robot.model)
    equal = np.asarray(limits.lower) == np.asarray(limits.upper)
    if names := [name for name, same in zip(limits.joints, equal, strict=True) if same]:
        said.insert(
            0,
            f"the lower limit is the upper one ({short_list(names)}): loops are closed without "
            "moving them, unless you pass within_limits=False; fix them, or give them a range",
        )
    return replace(robot, unused=(*robot.unused, *said)) if said else robot


def _gaps(robot: Robot) -> Iterator[str]:
    """Loops that are open at the first posture, or else at neutral, a sentence each."""
    if not robot.loops:
        return
    name, q = next(iter(robot.postures.items()), ("", pin.neutral(robot.model)))
    where = f"at the posture {name!r}" if name else "at the zero configuration of the file"
    bounds = bind(robot, robot.loops)
    violation = Equations(robot.model, bounds).violation(np.array(q))
    for bound in bounds:
        gap = gap_of(robot.model, bound, violation[bound.rows])
        if gap.size > tolerances.DRAWN:
            yield f"loop {bound.name!r} is open by {gap} {where}: Scene.state closes it"


def _ends(loop: Constraint) -> frozenset[str]:
    """Frames, or for a coupling joints, that a loop connects; both kinds compare unequal."""
    return frozenset({*loop.joints, "joints"} if loop.joints else loop.frames)


Table = Mapping[str, Any]
Check = tuple[Callable[[Any], bool], str]
_Made = TypeVar("_Made")


def _is_list(kind: type) -> Callable[[Any], bool]:
    return lambda x: isinstance(x, list) and all(isinstance(entry, kind) for entry in x)


_TEXT: Final[Check] = (lambda x: isinstance(x, str), "a text")
_TEXTS: Final[Check] = (_is_list(str), "a list of texts")
_NAMES: Final[Check] = (
    lambda x: isinstance(x, str) or (_is_list(str)(x) and len(x) > 0), "a text or a list of texts"
)  # fmt: skip
_TRUTH: Final[Check] = (lambda x: isinstance(x, bool), "true or false")
_NUMBER: Final[Check] = (lambda x: type(x) in (int, float), "a number")
_TABLE: Final[Check] = (lambda x: isinstance(x, dict), "a table")
_TABLES: Final[Check] = (_is_list(dict), "a list of tables")

_CONFIG: Final[Mapping[str, Check]] = {
    "name": _TEXT, "source": _TEXT, "licence": _TEXT, "actuated": _TEXTS, "description": _TABLE,
    "frames": _TABLES, "loops": _TABLES, "contacts": _TABLES, "coupled_motors": _TABLES,
    "postures": _TABLE,
    "precision": _NUMBER,
}  # fmt: skip
FOR_SDF: Final[Mapping[str, Check]] = {
    "model": _NAMES, "root": _TEXT, "kinds": _TABLE, "drop": _TEXTS, "cut": _TEXTS,
    "as_file": _TRUTH,
}  # fmt: skip
_DESCRIPTION: Final[Mapping[str, Check]] = {
    "file": _TEXT, "srdf": _TEXT, "root_joint": _TEXT, "rotors": _TRUTH, "lock": _TEXTS,
    "mimic": _TRUTH, **FOR_SDF,
}  # fmt: skip
_FRAME: Final = ("name", "parent", "translation", "rotation")


def check_config(config: Table) -> None:
    """Refuse unknown entries, and values of the wrong type."""
    for key in ("name", "description"):
        if key not in config:
            raise InvalidModel(f"the entry {key!r} is missing")
    _check_table("", config, _CONFIG)
    description = config["description"]
    if "file" not in description:
        raise InvalidModel("the entry description.file is missing")
    _check_table("description.", description, _DESCRIPTION)
    for name, values in config.get("postures", {}).items():
        _check("postures.", name, values, _TABLE)
    for i, frame in enumerate(config.get("frames", ())):
        _check_names(f"frames[{i}]", frame, _FRAME, _FRAME[:3])
    _check_file(description)


def _check_file(description: Table) -> None:
    """Refuse entries for another format than that of the file."""
    file = description["file"]
    if not file.endswith(".sdf") and (key := next((k for k in FOR_SDF if k in description), "")):
        raise InvalidModel(f"the entry description.{key} is for an SDF, not for {file!r}")
    if "rotors" in description and "srdf" not in description:
        raise InvalidModel(
            "the entry description.rotors is for the rotors of an SRDF: name its file in "
            "description.srdf"
        )
    if "mimic" in description and not file.endswith(".urdf"):
        raise InvalidModel("the entry description.mimic is for a URDF")
    if "root_joint" in description and file.endswith(".xml"):
        raise InvalidModel("the entry description.root_joint is for others: an MJCF says it itself")


def loops_of(tables: Sequence[Table]) -> tuple[Constraint, ...]:
    """Return the loops that a config lists: a kind without its own class is one of `Loop`."""
    known, made = kinds_by_word(closes=True), []
    for i, table in enumerate(tables):
        others = dict(table)
        kind = others.pop("kind", "")
        own = known.get(kind) if isinstance(kind, str) else None
        made.append(_value_of_table(own or Loop, others if own else table, f"loops[{i}]"))
    return tuple(made)


def contacts_of(tables: Sequence[Table]) -> tuple[Constraint, ...]:
    """Return the contacts that a config lists."""
    known, made = kinds_by_word(closes=False), []
    for i, table in enumerate(tables):
        where, others = f"contacts[{i}]", dict(table)
        kind = others.pop("kind", None)
        if kind is None:
            raise InvalidModel(f"{where}: the entry 'kind' is missing: one of {', '.join(known)}")
        if not isinstance(kind, str) or kind not in known:
            raise InvalidModel(f"{where}: {unknown_name('kind of contact', str(kind), known)}")
        made.append(_value_of_table(known[kind], others, where))
    return tuple(made)


def _value_of_table(kind: Callable[..., _Made], table: Table, where: str) -> _Made:
    """Return the value whose fields a table gives."""
    known = fields(kind)  # type: ignore[arg-type]
    needed = [f.name for f in known if f.default is MISSING and f.default_factory is MISSING]
    _check_names(where, table, [f.name for f in known], needed)
    with place(where):
        return kind(**table)


def _check_names(where: str, table: Table, known: Sequence[str], needed: Sequence[str]) -> None:
    for key in table:
        if key not in known:
            raise InvalidModel(f"{where}: {_unknown_entry('', key, known)}")
    for key in needed:
        if key not in table:
            raise InvalidModel(f"{where}: the entry {key!r} is missing")


def _check_table(where: str, table: Table, known: Mapping[str, Check]) -> None:
    for key, value in table.items():
        if key not in known:
            raise InvalidModel(_unknown_entry(where, key, known))
        _check(where, key, value, known[key])


def _unknown_entry(where: str, key: str, known: Collection[str]) -> str:
    """Error text on an entry that does not exist, or stands in the wrong table."""
    if key in _CONFIG and known is not _CONFIG:
        return f"no entry named '{where}{key}'; {key} goes to the top, above the first [table]"
    return str(unknown_name("entry", f"{where}{key}", known))


def _check(where: str, key: str, value: Any, check: Check) -> None:
    fits, needed = check
    if not fits(value):
        raise InvalidModel(f"the entry {where}{key} = {value!r}: {needed} is needed")


def chosen_config(config: Mapping[str, Any], variant: Mapping[str, str]) -> dict[str, Any]:
    """Return a config with the chosen values of its options, and the defaults of the others."""
    options = config.get("variants", {})
    _check_options(options)
    check_variant(variant, options)
    merged = {key: entry for key, entry in config.items() if key != "variants"}
    other = []  # what is not the default, for the name
    for option, values in options.items():
        default = next(iter(values))
        value = variant.get(option, default)
        if value not in values:
            raise unknown_name(f"value of the variant {option!r}", value, values)
        merged = _merged_tables(merged, values[value], f"variants.{option}.{value}")
        if value != default:
            other.append(f"{option} {value}")
    if other and isinstance(merged.get("name"), str):  # else `check_config` refuses it
        merged["name"] = f"{merged['name']}, {', '.join(other)}"
    return merged


def _check_options(options: Any) -> None:
    """Refuse all but a table of options, each a table of values, each a table of entries."""
    if not isinstance(options, Mapping):
        raise InvalidModel(f"the entry variants = {options!r}: tables by option are needed")
    for option, values in options.items():
        pieces = list(values.values()) if isinstance(values, Mapping) else []
        if not pieces or not all(isinstance(piece, Mapping) for piece in pieces):
            raise InvalidModel(
                f"the entry variants.{option} = {values!r}: a table for each value is needed, "
                f"such as [variants.{option}.default]"
            )


def check_variant(variant: Any, options: Mapping[str, Any]) -> None:
    """Refuse a variant that is no choice among the options of a robot."""
    pairs = variant.items() if isinstance(variant, Mapping) else [(None, None)]
    if not all(isinstance(name, str) for pair in pairs for name in pair):
        raise InvalidArgument(
            f"variant = {variant!r}: names by name are needed, such as {{'springs': 'locked'}}"
        )
    for option in variant:
        if option not in options:
            raise unknown_name("variant", option, options)


def _merged_tables(
    below: Mapping[str, Any], above: Mapping[str, Any], where: str
) -> dict[str, Any]:
    """Table `below` with the entries of `above` merged over it."""
    merged = dict(below)
    for key, entry in above.items():
        old = below.get(key, entry)
        if any(isinstance(old, kind) != isinstance(entry, kind) for kind in (Mapping, list)):
            raise InvalidModel(f"the entry {where}.{key} = {entry!r} does not fit over {old!r}")
        if isinstance(old, Mapping):
            merged[key] = _merged_tables(old, entry, f"{where}.{key}")
        elif (
            isinstance(old, list)
            and key in below
            and any(not isinstance(x, (int, float)) for x in old)
        ):  # else it is one value, such as the quaternion of a posture
            merged[key] = [*old, *entry]
        else:
            merged[key] = entry
    return merged
