"""Linkages that only follow: passive bodies whose motion a loop ties to another joint.

A loop over the passive joints p and the others r gives

    J_p v_p + J_r v_r = 0,      v_p = G v_r,      G = -J_p^+ J_r.

Without the loop, and with the passive bodies welded where they are, each other joint moves the
inertia and the damping that it felt through the linkage,

    armature_r += (G^T M_pp G)_rr,      damping_r += (G^T D_pp G)_rr,

at the nominal state. What is lost is how G and M_pp vary, and how the bodies move the centre of
mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.equations import Equations
from condyn_pin.errors import InvalidConstraint
from condyn_pin.reduction import ReducedScene, checked, free_flyers, listed, reduced
from condyn_pin.robot import Robot
from condyn_pin.scene import Scene
from condyn_pin.smaller_robot import sifted, smaller_robot
from condyn_pin.smaller_tree import indices


def without_linkage(scene: Scene, loops: Sequence[str], joints: Sequence[str]) -> ReducedScene:
    """Return the scene without a linkage that only follows; see `Scene.without_linkage`."""
    gone = checked("loops", loops, scene.names, "constraint")
    names = checked("joints", joints, scene.robot.joints, "joint")
    q = scene.state()[0]
    armature, damping = _reflected(scene, gone, names, q)
    model = pin.Model(scene.robot.model)
    model.armature = np.array(model.armature) + armature
    model.damping = np.array(model.damping) + damping
    words = (
        f"linkages that only follow: bodies of {listed(names)} welded, loops {listed(gone)} left "
        "out; inertia and damping reflected onto the joints that they followed"
    )
    open_robot: Robot = replace(
        scene.robot,
        model=model,
        loops=tuple(loop for loop in scene.robot.loops if loop.name not in gone),
    )
    robot = smaller_robot(open_robot, names, q, words)
    kept, _ = sifted(robot, [c for c in scene.constraints if c.name not in gone])
    result = reduced(scene, robot, kept, q, (words,), found=names)
    if result.audit.mobility != scene.audit.mobility:
        raise InvalidConstraint(
            f"loops {listed(gone)}: without them and {listed(names)} the mobility is "
            f"{result.audit.mobility} instead of {scene.audit.mobility}: they do more than follow"
        )
    return result


def _reflected(
    scene: Scene, loops: Sequence[str], joints: Sequence[str], q: Array
) -> tuple[Array, Array]:
    """Return what armature and damping the joints of the tree gain, an entry each of v."""
    model = scene.robot.model
    terms = Equations(model, scene.bounds).terms(q, np.zeros(model.nv))
    rows = np.concatenate([np.arange(model.nv)[:0], *_rows(scene, loops)])
    _, p = indices(model, joints)
    _, floating = indices(model, free_flyers(scene.robot))
    r = np.setdiff1d(np.arange(model.nv), [*p, *floating])
    J = terms.J[rows]
    G = -np.linalg.pinv(J[:, p], rcond=tolerances.RANK) @ J[:, r]
    armature, damping = np.zeros((2, model.nv))
    armature[r] = np.einsum("ir,ij,jr->r", G, terms.M[np.ix_(p, p)], G)
    damping[r] = np.array(model.damping)[p] @ G**2
    return armature, damping


def _rows(scene: Scene, names: Sequence[str]) -> list[Array]:
    return [np.arange(b.rows.start, b.rows.stop) for b in scene.bounds if b.name in names]
