"""Write scenes, states and the answers of `Reference`, for peers that know nothing of condyn_pin.

`exported.py` has the format. A contact is written as a loop with the world, standing where the
robot stands in its first posture: all engines know that, and all states share the place.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import motor_torque
from peers.stepping import end_of, rk4

STATES = 10
SEED = 0
# [s] of motion: long enough to be timed, short enough for free rods not to be chaotic
DURATION = {"talos, two feet": 0.1, "cassie, loops": 0.1, "four-bar": 1.0}
FINE = 2e-4  # [s] step of the reference motion, RK4

_KINDS = {
    "JointModelFreeFlyer": "free",
    "JointModelSpherical": "ball",
    **{f"JointModelR{x}": "revolute" for x in "XYZ"},
    **{f"JointModelP{x}": "prismatic" for x in "XYZ"},
    "JointModelRevoluteUnaligned": "revolute",
    "JointModelPrismaticUnaligned": "prismatic",
}


def scenes() -> dict[str, cp.Scene]:
    """Return the scenes by name, contacts as loops with the world."""
    talos, cassie, bar = (cp.load_robot(name) for name in ("talos", "cassie", "four_bar"))
    return {
        "talos, two feet": standing(cp.Scene(talos, talos.contacts)),
        "cassie, loops": cp.Scene(cassie, cassie.loops),
        "four-bar": cp.Scene(bar, bar.loops),
    }


def standing(scene: cp.Scene) -> cp.Scene:
    """Return the scene with each contact as a loop with the world at the first posture."""
    robot, loops = scene.robot, []
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, scene.state()[0])
    for contact in scene.constraints:
        joint, placement = robot.frame(contact.frame)
        here = data.oMi[joint] * placement
        held = f"{contact.name}_held"
        robot = robot.with_frame(held, "world", here.translation, here.rotation)
        loops.append(cp.Loop(contact.frame, held, "weld", name=contact.name))
    robot = replace(robot, loops=loops)
    return cp.Scene(robot, robot.loops)


def export_scene(folder: Path, name: str, scene: cp.Scene) -> Path:
    """Write a scene into a folder of its own and return that."""
    target = folder / name.replace(",", "").replace(" ", "_")
    target.mkdir(parents=True, exist_ok=True)
    model = scene.robot.model
    workspace = cp.Workspace(scene, cp.Proximal())
    settings = workspace.proximal_settings
    states = _states(scene)
    end = end_of_motion(scene, states[0], DURATION[name], FINE)
    saved = {
        "name": name,
        "gravity": model.gravity.linear.tolist(),
        "joints": [_joint(model, i) for i in range(1, model.njoints)],
        "constraints": [_constraint(c) for c in workspace.constraint_models],
        "motors": [int(model.joints[model.getJointId(j)].idx_v) for j in scene.robot.actuated],
        "settings": {
            "mu": settings.mu,
            "absolute_accuracy": settings.absolute_accuracy,
            "relative_accuracy": settings.relative_accuracy,
            "max_iterations": settings.max_iter,
        },
        "states": {key: [x[key].tolist() for x in states] for key in states[0]},
        "motion": {"duration": DURATION[name], "end": end.tolist()},
    }
    (target / "scene.json").write_text(json.dumps(saved), encoding="utf-8")
    (target / "scene.xml").write_text(_mjcf(scene), encoding="utf-8")
    return target


def _states(scene: cp.Scene) -> list[dict[str, np.ndarray]]:
    """Return closed states under random motor torques, with the answers of `Reference`."""
    rng = np.random.default_rng(SEED)
    reference = cp.Workspace(scene, cp.dynamics.Reference())
    states = []
    for _ in range(STATES):
        q, v = scene.sample(rng)
        tau = motor_torque(scene.robot, rng)
        d = reference.derivatives(q, v, tau)
        answers = {key: getattr(d, key) for key in ("da_dq", "da_dv", "da_dtau")}
        answers["tangent"] = tangent(reference, q, v)
        states.append({"q": q, "v": v, "tau": tau, "a": d.solution.a} | answers)
    return states


def tangent(workspace: cp.Workspace, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (2 nv, k) of the motions (dq, dv) that stay on the constraints.

    J dq = 0 and J dv + (J v)_q dq = 0, the latter by central differences.
    """
    model, J = workspace.model, workspace.jacobian(q)
    rank, step = workspace.scene.rank(q).rank, 1e-5
    slip = [
        (workspace.jacobian(pin.integrate(model, q, dq)) @ v) / (2 * step)
        - (workspace.jacobian(pin.integrate(model, q, -dq)) @ v) / (2 * step)
        for dq in step * np.eye(model.nv)
    ]
    moved = np.column_stack(slip)
    _, _, Bt = np.linalg.svd(J)
    free = Bt[rank:].T  # J free = 0
    follow = -np.linalg.pinv(J, rcond=1e-6) @ moved @ free
    Q, _ = np.linalg.qr(np.block([[free, np.zeros_like(free)], [follow, free]]))
    return Q


def end_of_motion(
    scene: cp.Scene, state: dict[str, np.ndarray], duration: float, step: float
) -> np.ndarray:
    """Return q after a duration [s] without torques, by RK4 with steps [s] of this size."""
    workspace, tau = cp.Workspace(scene), np.zeros(scene.robot.nv)

    def a(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return workspace.acceleration(q, v, tau)

    return end_of(rk4, workspace.model, a, (state["q"], state["v"]), duration, step)


def _joint(model: Any, i: int) -> dict[str, Any]:
    joint, inertia = model.joints[i], model.inertias[i]
    if joint.shortname() not in _KINDS:
        raise ValueError(f"joint {model.names[i]!r}: no name for {joint.shortname()} in the export")
    armature = np.array(model.armature[joint.idx_v : joint.idx_v + joint.nv])
    if np.ptp(armature):
        raise ValueError(f"joint {model.names[i]!r}: armature {armature} differs between axes")
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    axis = np.array(data.S).reshape(-1, joint.nv)[:, 0] if joint.nv == 1 else np.zeros(6)
    return {
        "name": str(model.names[i]),
        "parent": int(model.parents[i]),
        "kind": _KINDS[joint.shortname()],
        "axis": (axis[:3] + axis[3:]).tolist(),
        "placement": _placement(model.jointPlacements[i]),
        "idx_q": int(joint.idx_q),
        "nq": int(joint.nq),
        "idx_v": int(joint.idx_v),
        "nv": int(joint.nv),
        "mass": float(inertia.mass),
        "lever": inertia.lever.tolist(),
        "inertia": inertia.inertia.tolist(),
        "armature": float(armature[0]),
    }


def _constraint(c: Any) -> dict[str, Any]:
    return {
        "name": str(c.name),
        "rows": 6 if c.type == pin.ContactType.CONTACT_6D else 3,
        "joint1": int(c.joint1_id),
        "placement1": _placement(c.joint1_placement),
        "joint2": int(c.joint2_id),
        "placement2": _placement(c.joint2_placement),
    }


def _placement(M: Any) -> list[Any]:
    return [M.rotation.tolist(), M.translation.tolist()]


def _mjcf(scene: cp.Scene) -> str:
    """Return the robot as MJCF, without the sites that no equality uses: they would cost time."""
    root = ElementTree.fromstring(scene.robot.to_mjcf())
    used = {e.get(key) for e in root.iterfind("equality/*") for key in ("site1", "site2")}
    for body in [*root.iter("worldbody"), *root.iter("body")]:
        for site in [s for s in body.findall("site") if s.get("name") not in used]:
            body.remove(site)
    for element in root.findall("keyframe"):
        root.remove(element)
    return ElementTree.tostring(root, encoding="unicode")
