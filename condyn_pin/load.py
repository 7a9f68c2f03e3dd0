"""load_robot: a robot by name, from a URDF or MJCF, or from a folder with a robot.toml.

A folder is a robot. Its `robot.toml` says which description to read and adds what descriptions
leave out: loops, contacts, motors, postures, the licence.

    name = "..."           source = "..."           licence = "..."
    actuated = ["joint", ...]
    [description]  file (in example-robot-data, or beside the toml), srdf, root_joint
                   ("free_flyer" or "fixed"), rotors = true, lock = ["joint", ...];
                   for URDF also mimic = false, for joints that then move on their own;
                   for SDF also root, kinds, drop, cut, as_file: see `io.sdf.read_sdf`
    [[frames]]     name, parent, translation, rotation: more frames, see `Robot.with_frame`
    [[loops]]      kind and the fields of `Loop`; or kind = "coupling" and those of `Coupling`
                   (an SDF and an MJCF bring their own, a URDF mimic joints and links named
                   closing_X_1, closing_X_2; an entry with the same two ends replaces theirs)
    [[contacts]]   kind = "point", "surface", "line" or "planar", and the fields of that class
    [postures.X]   joint = value or list of values; joints left out stay at neutral
    [variants.OPTION.VALUE]  pieces of the card that are merged over it: see `variants`
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any

from condyn_pin._pin import pin
from condyn_pin.constraints import Coupling, Loop
from condyn_pin.contacts import CONTACTS, Contact
from condyn_pin.errors import CondynError, InvalidArgument, InvalidModel, MissingExtra, unknown_name
from condyn_pin.io.mjcf import MjcfRobot, read_mjcf
from condyn_pin.io.sdf import read_sdf
from condyn_pin.io.urdf import UrdfRobot, check_root_joint, read_urdf
from condyn_pin.mechanisms import MECHANISMS
from condyn_pin.postures import posture, srdf_postures
from condyn_pin.robot import Robot
from condyn_pin.smaller.lock import lock_joints
from condyn_pin.spring import Spring
from condyn_pin.variants import check_variant, chosen_card

_CARD = (
    "name", "source", "licence", "actuated", "description", "frames", "loops", "contacts",
    "postures",
)  # fmt: skip
_FOR_SDF = ("root", "kinds", "drop", "cut", "as_file")
_DESCRIPTION = ("file", "srdf", "root_joint", "rotors", "lock", "mimic", *_FOR_SDF)


def robots_folder() -> Path:
    """Return the folder of robots: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parent
    packed = package / "robots"
    return packed if packed.is_dir() else package.parent / "robots"


def available_robots() -> dict[str, Callable[[], Robot]]:
    """Return what `load_robot` knows by name: folders with a robot.toml, and built mechanisms."""
    folders = sorted(path.parent for path in robots_folder().glob("*/robot.toml"))
    return {folder.name: partial(_from_folder, folder) for folder in folders} | MECHANISMS


def load_robot(
    name: str | Path,
    *,
    root_joint: str | None = None,
    variant: Mapping[str, str] | None = None,
) -> Robot:
    """Load a robot.

    Parameters
    ----------
    name : str or Path
        A name that `condyn robots` lists, or a path: of a URDF, of an MJCF (.xml), of a folder
        with a robot.toml, or of that file.
    root_joint : {"fixed", "free_flyer"}, optional
        For a URDF only: how its root link is attached to the world, fixed by default. Named robots
        and folders say it themselves.
    variant : mapping of str to str, optional
        Option to value, such as ``{"springs": "locked"}``, for a robot whose robot.toml has
        variants; each option that is left out has its default.

    Returns
    -------
    Robot

    Raises
    ------
    UnknownName
        If there is no such robot or variant; the text lists the nearest names.
    InvalidArgument
        If `root_joint` is unknown, or given for what is not a URDF.
    MissingExtra
        If the package with the description is not installed.
    InvalidModel
        If a file cannot be read; the text names the file and the element.
    """
    if not isinstance(name, (str, Path)):
        raise InvalidArgument(f"name = {name!r}: a name or a path is needed")
    if root_joint is not None:
        check_root_joint(root_joint)
    known = available_robots()
    path = Path(name).expanduser()
    folder = robots_folder() / str(name) if str(name) in known else path
    if path.name == "robot.toml" and path.is_file():
        folder = path.parent
    chosen = {} if variant is None else variant
    if str(name) not in known and path.suffix == ".urdf" and not path.is_dir():
        check_variant(chosen, {})
        return _alone(path, read_urdf(path, root_joint or "fixed"))
    if path.suffix == ".xml" and root_joint is None and not path.is_dir():
        check_variant(chosen, {})
        return _alone(path, read_mjcf(path))
    if root_joint is not None:
        raise InvalidArgument(
            f"root_joint = {root_joint!r}: only a URDF takes it; {str(name)!r} says it itself"
        )
    if str(name) in MECHANISMS:
        check_variant(chosen, {})
        return MECHANISMS[str(name)]()
    if (folder / "robot.toml").is_file():
        return _from_folder(folder, chosen)
    if path.suffix or path.exists():
        raise InvalidModel(
            f"{path}: a .urdf file or a folder with a robot.toml is needed, or an MJCF in a .xml; "
            "an SDF or a URDF with loops goes into such a folder"
        )
    raise unknown_name("robot", str(name), known)


def _alone(path: Path, read: UrdfRobot | MjcfRobot) -> Robot:
    """Return the robot of a file that no robot.toml describes."""
    try:
        return Robot(path.stem, source=str(path), **vars(read))
    except CondynError as error:
        error.args = (f"{path}: {error}", *error.args[1:])
        raise


def _from_folder(folder: Path, variant: Mapping[str, str] = MappingProxyType({})) -> Robot:
    path = folder / "robot.toml"
    try:
        card = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidModel(f"{path}: {error}") from error
    try:
        return _from_card(chosen_card(card, variant), folder)
    except CondynError as error:
        error.args = (f"{path}: {error}", *error.args[1:])
        raise
    except KeyError as error:
        raise InvalidModel(f"{path}: the entry {error} is missing") from error
    except (AttributeError, TypeError, ValueError) as error:
        raise InvalidModel(f"{path}: {error}") from error


def _from_card(card: Mapping[str, Any], folder: Path) -> Robot:
    description = card["description"]
    _only_known("", card, _CARD)
    _only_known("description.", description, _DESCRIPTION)
    for key in ("drop", "cut", "lock"):
        if not isinstance(description.get(key, []), list):
            raise InvalidModel(
                f"the entry description.{key} = {description[key]!r}: a list of joints is needed"
            )
    if not str(description["file"]).endswith(".sdf"):
        for key in _FOR_SDF:
            if key in description:
                raise InvalidModel(f"the entry description.{key} is for an SDF, not for a URDF")
    file = _description_file(description["file"], folder)
    if "mimic" in description and file.suffix != ".urdf":
        raise InvalidModel("the entry description.mimic is for a URDF")
    if not isinstance(description.get("mimic", True), bool):
        raise InvalidModel(
            f"the entry description.mimic = {description['mimic']!r}: true or false is needed"
        )
    if file.suffix == ".xml" and "root_joint" in description:
        raise InvalidModel("the entry description.root_joint is for others: an MJCF says it itself")
    root_joint = description.get("root_joint", "fixed")
    check_root_joint(root_joint)
    fields, inverted = _read(file, description, root_joint, card.get("actuated", ()))
    postures = {}
    if "srdf" in description:
        srdf = _description_file(description["srdf"], folder)
        rotors = description.get("rotors", False)
        postures = srdf_postures(fields["model"], srdf, rotors, inverted)
    for name, values in card.get("postures", {}).items():
        postures[name] = posture(fields["model"], values)
    drawn = fields.get("postures", {})  # by an MJCF; they come last, and the card's own win
    fields["postures"] = {**postures, **drawn, **postures}
    own = [_loop(table) for table in card.get("loops", ())]
    said = {_ends(loop) for loop in own}
    fields["loops"] = (*(loop for loop in fields["loops"] if _ends(loop) not in said), *own)
    fields["contacts"] = tuple(map(_contact, card.get("contacts", ())))
    if "actuated" in card:
        fields["actuated"] = tuple(card["actuated"])
    robot = Robot(card["name"], source=card["source"], licence=card["licence"], **fields)
    for table in card.get("frames", ()):
        robot = robot.with_frame(**table)
    return lock_joints(robot, description.get("lock", ()))


def _read(
    file: Path, description: Mapping[str, Any], root_joint: str, actuated: Sequence[str]
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what a file says, as fields of a Robot, and the joints that it has reversed."""
    if file.suffix == ".xml":
        return dict(vars(read_mjcf(file))), ()
    if file.suffix != ".sdf":
        mimic = description.get("mimic", True)
        return dict(vars(read_urdf(file, root_joint, mimic=mimic))), ()
    options = {key: description[key] for key in _FOR_SDF if key in description}
    if root_joint == "free_flyer":
        options["root_joint"] = pin.JointModelFreeFlyer()
    sdf = read_sdf(file, actuated=actuated, **options)
    closures = [Loop(c.frame_a, c.frame_b, c.kind, name=c.name) for c in sdf.closures]  # type: ignore[arg-type]
    fields = {
        "model": sdf.model,
        "loops": (*closures, *sdf.couplings),
        "springs": tuple(Spring(joint, k, ref) for joint, (k, ref) in sdf.springs.items()),
        "unused": sdf.unused,
    }
    return fields, sdf.reversed


def _only_known(where: str, table: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            raise InvalidModel(str(unknown_name("entry", f"{where}{key}", known)))


def _description_file(name: str, folder: Path) -> Path:
    beside = folder / name
    return beside if beside.is_file() else example_robot_data() / name


def example_robot_data() -> Path:
    """Return the folder of robots that the package example-robot-data installed."""
    try:
        package = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError as error:
        raise MissingExtra(
            "the robot descriptions are missing: python -m pip install example-robot-data"
        ) from error
    return Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))


def _ends(loop: Loop | Coupling) -> frozenset[str]:
    if isinstance(loop, Coupling):
        return frozenset({loop.joint_a, loop.joint_b, "joints"})
    return frozenset({loop.frame_a, loop.frame_b})


def _loop(table: Mapping[str, Any]) -> Loop | Coupling:
    fields = dict(table)
    if fields.get("kind") == "coupling":
        del fields["kind"]
        return Coupling(**fields)
    return Loop(**fields)


def _contact(table: Mapping[str, Any]) -> Contact:
    fields = dict(table)
    kind = fields.pop("kind")
    if kind not in CONTACTS:
        raise unknown_name("kind of contact", kind, CONTACTS)
    return CONTACTS[kind](**fields)
