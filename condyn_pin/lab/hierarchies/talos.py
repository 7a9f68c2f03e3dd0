"""Talos on both feet: eight corners, two surfaces, no arms, nothing but legs."""

from __future__ import annotations

from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.hierarchy import HierarchyModel, ModelHierarchy
from condyn_pin.mechanism.reduction import keep


def _corners() -> Scene:
    talos = load_robot("talos")
    return Scene(talos, [corner for foot in talos.contacts for corner in foot.by_points(talos)[1]])


def _surfaces(scene: Scene) -> Scene:
    return Scene(scene.robot, scene.robot.contacts)


def _without_arms(scene: Scene) -> Scene:
    limbs = ("arm_", "gripper_", "head_")
    return scene.lock([name for name in scene.robot.joints if name.startswith(limbs)])


def _legs(scene: Scene) -> Scene:
    return keep(scene, [name for name in scene.robot.joints if name.startswith("leg_")])


HIERARCHY = ModelHierarchy(
    name="talos",
    top=_corners,
    label="eight corners",
    models=(
        HierarchyModel("two surfaces", "the same support in half the rows: exact", _surfaces),
        HierarchyModel(
            "arms and head locked",
            "exact if they do not move; here their motors only carry their weight",
            _without_arms,
        ),
        HierarchyModel("legs alone", "the torso is locked too", _legs),
    ),
    sampled="legs alone",
)
