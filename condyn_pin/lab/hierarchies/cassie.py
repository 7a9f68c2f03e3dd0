"""Cassie on both feet: feet driven directly, springs locked, rods as distances, then a gear."""

from __future__ import annotations

from condyn_pin._core.joints import indices
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.hierarchy import HierarchyModel, ModelHierarchy
from condyn_pin.mechanism.reduction import loaded, reduced
from condyn_pin.mechanism.suggestions import merge_points, rods_as_distances, without_linkage

_SIDES = ("left", "right")


def _whole() -> Scene:
    cassie = load_robot("cassie")
    return Scene(cassie, [*cassie.loops, *cassie.contacts])


def _feet_driven_directly(scene: Scene) -> Scene:
    links = ("tarsus-crank-joint", "crank-rod-joint")
    return without_linkage(
        scene,
        [f"{side}-plantar-foot-joint" for side in _SIDES],
        [f"{side}-{link}" for side in _SIDES for link in links],
    )


def _springs_locked(scene: Scene) -> Scene:
    """Lock the springs where they carry the robot while it stands."""
    return scene.lock([spring.joint for spring in scene.robot.springs], loaded(scene))


def _rods_as_distances(scene: Scene) -> Scene:
    """Replace the rods, and the points of the feet by edges: independent rows."""
    edges = merge_points(scene)
    return rods_as_distances(edges, [f"{side}-pitch-rod-joint" for side in _SIDES])


def _geared(scene: Scene) -> Scene:
    """Replace each distance by the proportion of knee and tarsus that it gives while standing."""
    q, v = scene.state()
    equations = Equations(scene.robot.model, scene.bounds)
    J = equations.terms(q, v).J
    constraints = {c.name: c for c in scene.constraints}
    for bound in scene.bounds:
        if bound.name.endswith("-achilles-spring-joint"):
            side = bound.name.split("-")[0]
            names = (f"{side}-shin-tarsus-joint", f"{side}-knee-op")
            (q_tarsus, q_knee), (tarsus, knee) = indices(scene.robot.model, names)
            row = J[bound.rows][0]
            ratio = -row[knee] / row[tarsus]
            offset = q[q_tarsus] - ratio * q[q_knee]
            constraints[bound.name] = Coupling(*names, ratio, offset, name=bound.name)
    words = "linkages of knee and tarsus: the proportion that they have at the nominal state"
    return reduced(scene, scene.robot, list(constraints.values()), q, (words,))


HIERARCHY = ModelHierarchy(
    name="cassie",
    top=_whole,
    label="springs free",
    models=(
        HierarchyModel(
            "feet driven directly",
            "cranks and plantar rods are reflected inertia, and their loops dropped",
            _feet_driven_directly,
        ),
        HierarchyModel(
            "springs locked",
            "at what they are bent by standing; compared where free springs carry their load",
            _springs_locked,
        ),
        HierarchyModel(
            "achilles rods as distances",
            "their mass is shared by their ends; two points a foot are one edge",
            _rods_as_distances,
        ),
        HierarchyModel(
            "knee and tarsus geared",
            "the proportion of the linkage while standing, in place of the linkage",
            _geared,
        ),
    ),
    sampled="achilles rods as distances",
)
