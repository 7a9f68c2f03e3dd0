"""SDF files as text, and what tests of the reader ask of a robot."""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import condyn_pin as cp
from condyn_pin.io.description import Description

ROUNDING = 1e-14  # a handful of products of numbers of size 1
SIDES = ("left", "right")


def cassie_folder() -> Path:
    robots = "cmeel.prefix/share/example-robot-data/robots"
    return Path(str(distribution("example-robot-data").locate_file(f"{robots}/cassie_description")))


def cassie_file() -> Path:
    return cassie_folder() / "robots" / "cassie_wo_gearbox_spring.sdf"


INERTIAL = (
    "<inertial><mass>2</mass>"
    "<inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>"
)


def link(name: str, inside: str = INERTIAL) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(
    name: str, parent: str, child: str, kind: str = "revolute", inside: str | None = None
) -> str:
    axis = "<axis><xyz>0 0 1</xyz></axis>" if inside is None else inside
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent>'
        f"<child>{child}</child>{axis}</joint>"
    )


def pose(numbers: str, **attributes: str) -> str:
    said = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f"<pose{said}>{numbers}</pose>"


def frame_poses(model: pin.Model, q: np.ndarray) -> dict[str, np.ndarray]:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return {f.name: data.oMf[i].homogeneous for i, f in enumerate(model.frames)}


def axis(limit: str = "", dynamics: str = "") -> str:
    return f"<axis><xyz>0 0 1</xyz><limit>{limit}</limit><dynamics>{dynamics}</dynamics></axis>"


def T(x, y, z, roll, pitch, yaw) -> np.ndarray:
    placement = np.eye(4)
    for axis, angle in zip(np.eye(3), (roll, pitch, yaw), strict=True):  # about fixed axes
        placement[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix() @ placement[:3, :3]
    placement[:3, 3] = x, y, z
    return placement


AB = link("a") + link("b")
AXIS = "<axis><xyz>0 0 1</xyz></axis>"
LOOP = AB + link("c") + joint("ab", "a", "b") + joint("ac", "a", "c")

ARM = (
    pose("0.1 -0.2 0.3 0.4 0.5 -0.6")
    + link("base", pose("0.2 0 0.1 0 0.3 0"))
    + link("upper", pose("0 0.1 0.5 0.1 0.2 0.3", relative_to="base") + INERTIAL)
    + '<frame name="tool" attached_to="upper">'
    + pose("0.1 0.1 0 1.2 -0.3 0.4")
    + "</frame>"
    + joint(
        "shoulder",
        "base",
        "upper",
        inside=pose("0.05 0 -0.1 0 0.7 0.2") + "<axis><xyz>1 -2 3</xyz></axis>",
    )
    + link("carriage", pose("0.3 0 0 0 0 0.8", relative_to="shoulder") + INERTIAL)
    + joint(
        "rail",
        "upper",
        "carriage",
        "prismatic",
        '<axis><xyz expressed_in="tool">0 1 1</xyz></axis>',
    )
    + link("lump", pose("0.4 0.5 0.6 0.1 0 0") + INERTIAL)
    + joint("bolts", "carriage", "lump", "fixed", "")
    + link("wrist", pose("0 0.2 0 0 0 0.5", relative_to="tool") + INERTIAL)
    + joint("socket", "lump", "wrist", "ball", pose("0.1 0 0.1 0.3 0.2 0.1", relative_to="lump"))
    + link("finger", pose("0.7 0.1 0.2 0.3 0 -0.2", relative_to="__model__") + INERTIAL)
    + joint(
        "knuckle",
        "wrist",
        "finger",
        "continuous",
        pose("0 0.1 0 0.2 0.4 0")
        + "<axis><xyz>0 2 0</xyz><use_parent_model_frame>1</use_parent_model_frame></axis>",
    )
)


def assert_orthonormal(model: pin.Model) -> None:
    frames = [frame.placement for frame in model.frames]
    for placement in (*model.jointPlacements, *frames):
        R = placement.rotation
        np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=4 * np.finfo(float).eps)


def closures(robot: Description) -> tuple[cp.Loop, ...]:
    return tuple(loop for loop in robot.loops if isinstance(loop, cp.Loop))


def couplings(robot: Description) -> tuple[cp.constraints.Coupling, ...]:
    return tuple(loop for loop in robot.loops if isinstance(loop, cp.constraints.Coupling))


def springs(robot: Description) -> dict[str, tuple[float, float]]:
    return {spring.joint: (spring.stiffness, spring.reference) for spring in robot.springs}
