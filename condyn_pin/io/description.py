"""Description: the content of a robot's file in any format, and the folders of descriptions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

import condyn_pin
from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.errors import InvalidArgument, InvalidModel, MissingExtra
from condyn_pin.model.joints import CoupledMotor
from condyn_pin.model.robot import Robot
from condyn_pin.model.springs import Spring, SpringDamper
from condyn_pin.model.whole_joints import Settings, with_whole_joints

# Name, mass [kg], and inertia about the centre of mass [kg m^2]
Body = tuple[str, float, Array]


@dataclass(frozen=True)
class Description:
    """Content of a robot's file; all fields but `reversed` and `whole` are those of `Robot`."""

    model: Any
    loops: tuple[Constraint, ...] = ()
    actuated: tuple[str, ...] = ()
    springs: tuple[Spring, ...] = ()
    spring_dampers: tuple[SpringDamper, ...] = ()
    postures: Mapping[str, Array] = field(default_factory=dict)
    unused: tuple[str, ...] = ()
    unmodelled: tuple[str, ...] = ()
    lost_rows: tuple[str, ...] = ()
    exclusions: frozenset[frozenset[str]] = frozenset()
    name: str = ""  # empty if the file has none
    reversed: tuple[str, ...] = ()  # joints that run from child to parent in the tree
    coupled_motors: tuple[CoupledMotor, ...] = ()
    whole: Mapping[str, Settings] = field(default_factory=dict)  # of joints that close loops

    def robot(self, **said: Any) -> Robot:
        """Return the robot, with what is said beside the file, and whole joints in its loops."""
        read = {k: value for k, value in vars(self).items() if k not in ("reversed", "whole")}
        given = {"precision": tolerances.WRITTEN_GEOMETRY} | read | said
        if not self.whole:
            return Robot(**given)
        motors = {key: given.pop(key) for key in ("actuated", "coupled_motors")}  # of whole joints
        robot = Robot(**given)
        for loop in self.loops:
            if loop.name in self.whole and loop in robot.loops:
                try:
                    robot = with_whole_joints(robot, [loop.name], self.whole)
                except InvalidModel as error:
                    lost = f"settings of the joint {loop.name!r}, which closes a loop: {error}"
                    robot = replace(robot, unmodelled=(*robot.unmodelled, lost))
        return replace(robot, **motors)


def tensor(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the symmetric matrix of the moments and products of inertia [kg m^2]."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def circle_of(leaders: Mapping[str, str]) -> list[str]:
    """Joints that mimic each other in a circle, from each joint's leader; none if one leads."""
    known = set[str]()
    for start in leaders:
        way, name = dict[str, None](), start
        while name in leaders and name not in known and name not in way:
            way[name] = None
            name = leaders[name]
        if name in way:
            joints = list(way)
            return joints[joints.index(name) :]
        known.update(way)
    return []


def implausible_inertias(bodies: Iterable[Body]) -> Iterator[str]:
    """Yield a sentence on bodies with inertias that no solid has."""
    # A file may have such a body where nothing moves it by itself, and real files do. The composite
    # inertia moved by a joint is checked again later (`condyn_pin.model.soundness`).
    reasons: dict[str, list[str]] = {}
    for name, mass, inertia in bodies:
        if reason := _fault(mass, inertia):
            reasons.setdefault(reason, []).append(name)
    for reason, names in reasons.items():
        yield (
            f"doubts about the inertia of {', '.join(names)}: {reason}, as in no solid; used as "
            "written"
        )


def _fault(mass: float, inertia: Array) -> str:
    """Violated condition 0 <= A <= B <= C <= A + B of principal moments, as text; else empty."""
    A, B, C = np.linalg.eigvalsh(inertia)
    zero = tolerances.MOMENT * max(-A, C)
    if A + zero < 0:
        return f"the principal moment {A:.3g} kg m^2 is negative"
    if A + B + zero < C:
        return f"the principal moments {A:.3g} and {B:.3g} add up to less than {C:.3g} kg m^2"
    if mass == 0 and inertia.any():
        return "there is a moment of inertia and no mass"
    return ""


def check_root_joint(root_joint: str) -> None:
    """Refuse an unknown type of root joint."""
    if root_joint not in ("fixed", "free_flyer"):
        raise InvalidArgument(f"root_joint = {root_joint!r}: one of fixed, free_flyer is needed")


def robots_folder() -> Path:
    """Return the folder of robots: inside the installed package, or beside it in a checkout."""
    package = Path(condyn_pin.__file__).parent
    packed = package / "robots"
    return packed if packed.is_dir() else package.parent / "robots"


def example_robot_data() -> Path:
    """Return the folder of robots that the package example-robot-data installed."""
    try:
        package = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError as error:
        raise MissingExtra(
            "the robot descriptions are missing: python -m pip install example-robot-data"
        ) from error
    return Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))


def description_file(name: str, folder: Path) -> Path:
    """Return the path of a file named in a robot.toml: beside it, or in example-robot-data."""
    beside = folder / name
    try:
        if beside.is_file():
            return beside
        packed = example_robot_data() / name
        if packed.is_file():
            return packed
    except OSError as error:
        raise InvalidModel(f"file {name[:80]!r}: {error.strerror}") from error
    raise InvalidModel(f"no file {name!r}: neither {beside} nor {packed} is one")
