"""Drake: nearly rigid contacts in discrete time, by SAP; compliance and friction are convex.

Its parser leaves out springs of joints: they are gains of its motors here, which SAP takes at the
end of the step, as dampers. It has no restitution.
"""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ET
from importlib.metadata import version

import numpy as np
import pydrake.multibody.plant as drake
from pydrake.geometry import (
    AddRigidHydroelasticProperties,
    DefaultProximityProperties,
    ProximityProperties,
    RoleAssign,
    SceneGraph,
    SceneGraphConfig,
)
from pydrake.multibody.parsing import Parser
from pydrake.multibody.tree import JointActuator, PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from peers.contact.harness import Played, Way, main, played
from peers.contact.scene import ContactScene

FINENESS = 0.02  # of meshes of pressure [m]
SAP, LAGGED = drake.DiscreteContactApproximation.kSap, drake.DiscreteContactApproximation.kLagged
SETTINGS = {
    "SAP, points": (SAP, None),
    "SAP, hydroelastic 1e7": (SAP, 1e7),
    "SAP, hydroelastic 1e9": (SAP, 1e9),
    "lagged, hydroelastic 1e7": (LAGGED, 1e7),
}


def ways(scene: ContactScene) -> list[Way]:
    """Return all settings at all steps."""
    return [way(scene, title, dt) for title in SETTINGS for dt in scene.steps]


def way(scene: ContactScene, title: str, dt: float) -> Way:
    """Return an approximation of friction, with one point a pair or pressure over a patch [Pa]."""
    builder = DiagramBuilder()
    plant, shapes = drake.AddMultibodyPlantSceneGraph(builder, time_step=dt)
    approximation, modulus = SETTINGS[title]
    plant.set_discrete_contact_approximation(approximation)
    if modulus:
        soft = DefaultProximityProperties(
            compliance_type="compliant", hydroelastic_modulus=modulus, resolution_hint=FINENESS
        )
        shapes.set_config(SceneGraphConfig(default_proximity_properties=soft))
    else:
        plant.set_contact_model(drake.ContactModel.kPoint)
    Parser(plant).AddModels(str(scene.model))
    if modulus:
        stiffen_floor(plant, shapes)
    held = hold(plant, ET.parse(scene.model))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    if held:
        robot = plant.GetBodyByName(scene.bodies[0]).model_instance()
        plant.get_desired_state_input_port(robot).FixValue(context, [*held, *[0.0] * len(held)])
    bodies = [plant.GetBodyByName(name) for name in scene.bodies]
    q, v = start(plant, scene)

    def play() -> Played:
        root.SetTime(0.0)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        simulator.Initialize()
        return played(scene, dt, advance, centres)

    def advance(count: int) -> None:
        simulator.AdvanceTo(root.get_time() + count * dt)

    def centres() -> np.ndarray:
        return np.array([b.EvalPoseInWorld(context) @ b.default_com() for b in bodies])

    return Way(title, dt, play)


def stiffen_floor(plant: drake.MultibodyPlant, shapes: SceneGraph) -> None:
    """Make the floor rigid: one that is soft meets soft bodies in one point only."""
    for floor in plant.GetCollisionGeometriesForBody(plant.world_body()):
        about = ProximityProperties(shapes.model_inspector().GetProximityProperties(floor))
        AddRigidHydroelasticProperties(about)
        shapes.AssignRole(plant.get_source_id(), floor, about, RoleAssign.kReplace)


def hold(plant: drake.MultibodyPlant, text: ET.ElementTree) -> list[float]:
    """Make motors of springs and dampers in joints; return where the springs rest [rad]."""
    rests = []
    for joint in text.iter("joint"):
        if joint.get("stiffness"):
            stiffness, damping = float(joint.attrib["stiffness"]), float(joint.get("damping", 0))
            held = plant.GetJointByName(joint.attrib["name"])
            motor = next(m for m in motors(plant) if m.joint() == held)
            motor.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
            held.set_default_damping(0.0)
            rests.append(float(joint.attrib["springref"]))
    return rests


def motors(plant: drake.MultibodyPlant) -> list[JointActuator]:
    """Return all motors."""
    return [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]


def start(plant: drake.MultibodyPlant, scene: ContactScene) -> tuple[np.ndarray, np.ndarray]:
    """Return q and v of the keyframe.

    Quaternions come before positions, and angular velocities before linear ones. All bodies start
    without a turn, so that axes of body and world are the same.
    """
    key = ET.parse(scene.model).find("keyframe/key")
    assert key is not None
    qpos, qvel = (np.array(key.attrib[name].split(), dtype=float) for name in ("qpos", "qvel"))
    q, v, i, j = np.zeros(plant.num_positions()), np.zeros(plant.num_velocities()), 0, 0
    for name in scene.bodies:
        body = plant.GetBodyByName(name)
        where, moving = body.floating_positions_start(), body.floating_velocities_start_in_v()
        q[where : where + 7] = np.r_[qpos[i + 3 : i + 7], qpos[i : i + 3]]
        v[moving : moving + 6] = np.r_[qvel[j + 3 : j + 6], qvel[j : j + 3]]
        i, j = i + 7, j + 6
    q[i:], v[j:] = qpos[i:], qvel[j:]  # joints, in the order of the file in both
    return q, v


if __name__ == "__main__":
    logging.getLogger("drake").setLevel(logging.ERROR)
    main("Drake", version("drake"), ways)
