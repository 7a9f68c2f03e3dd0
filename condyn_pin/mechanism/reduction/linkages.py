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

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked, listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import indices
from condyn_pin._core.linalg import rank_of
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, InvalidConstraint
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene, reduced
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import free_flyers, sifted, smaller_robot


def without_linkage(scene: Scene, loops: Sequence[str], joints: Sequence[str]) -> ReducedScene:
    """Return the scene without a linkage that only follows another joint.

    Its loops are left out and its bodies welded at the nominal state; their inertia and damping
    are reflected onto the joints that they followed, as armature and damping.

    Parameters
    ----------
    scene : Scene
    loops : sequence of str
        Names of constraints.
    joints : sequence of str
        The joints of the linkage.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such loop or joint.
    InvalidArgument
        If a motor or a spring acts on one of the joints.
    InvalidConstraint
        If the loops also hold other joints than these.
    """
    gone = checked("loops", loops, scene.names, "constraint")
    names = checked("joints", joints, scene.robot.joints, "joint")
    for name in names:
        check_passive(scene.robot, name)
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
    return reduced(scene, robot, kept, q, (words,), found=names)


def check_passive(robot: Robot, joint: str) -> None:
    """Raise InvalidArgument if a motor or a spring acts on a joint."""
    if joint in robot.actuated or joint in (spring.joint for spring in robot.springs):
        what = "motor" if joint in robot.actuated else "spring"
        raise InvalidArgument(f"joint {joint!r}: a {what} acts on it, so it does not only follow")


def follows(scene: Scene, loops: Sequence[str], joints: Sequence[str]) -> bool:
    """Return whether loops tell some joints where to be, and the others nothing.

    It is so if the rows of the loops have no less rank in the columns of these joints alone.
    """
    J = _of_loops(scene, scene.nominal.terms, loops)
    p = indices(scene.robot.model, joints)[1]
    of_passive, of_all = (rank_of(np.linalg.svd(each, compute_uv=False)) for each in (J[:, p], J))
    return of_passive == of_all


def _of_loops(scene: Scene, terms: Terms, loops: Sequence[str]) -> Array:
    return terms.J[rows_of([bound for bound in scene.bounds if bound.name in loops])]


def _reflected(
    scene: Scene, loops: Sequence[str], joints: Sequence[str], q: Array
) -> tuple[Array, Array]:
    """Return what armature and damping the joints of the tree gain, an entry each of v."""
    if not follows(scene, loops, joints):
        raise InvalidConstraint(
            f"loops {listed(loops)}: they do not only tell {listed(joints)} where to be, they also "
            "hold other joints"
        )
    model = scene.robot.model
    terms = equations_of(scene).terms(q, np.zeros(model.nv))
    _, p = indices(model, joints)
    _, floating = indices(model, free_flyers(scene.robot))
    r = np.setdiff1d(np.arange(model.nv), [*p, *floating])
    J = _of_loops(scene, terms, loops)
    G = -np.linalg.pinv(J[:, p], rcond=tolerances.RANK) @ J[:, r]
    armature, damping = np.zeros((2, model.nv))
    armature[r] = np.einsum("ir,ij,jr->r", G, terms.M[np.ix_(p, p)], G)
    damping[r] = np.array(model.damping)[p] @ G**2
    return armature, damping
