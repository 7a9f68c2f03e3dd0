"""Joints locked, constraints dropped, bodies cut off.

Locking is exact: the smaller scene moves as the full one does under constraints a_i = 0 on the
locked joints, whose forces are then inside a body and cost nothing. Dropping a constraint or a body
changes the robot; `Scene.minimal` measures by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from condyn_pin._core.arguments import checked, listed, normalised
from condyn_pin._core.joints import indices
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene, reduced
from condyn_pin.model.smaller import free_flyers, sifted, smaller_robot, with_held


def lock(scene: Scene, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
    """Return the scene of the smaller robot in which some joints are held at q.

    Exact: it moves as this one does with the joints welded.

    Parameters
    ----------
    scene : Scene
    joints : sequence of str
        A free-flyer may be among them. Joints coupled to them are locked too, where the
        couplings want them.
    q : (nq,) array_like, optional
        Where; the nominal state by default. The other joints move as closing the loops needs;
        the closed configuration, without the locked joints, is the first posture of the smaller
        robot, ``locked``.

    Returns
    -------
    ReducedScene
        A scene; its `expand_state` and `reduce_state` lead back and forth, and `dropped` says
        what is left out, such as loops whose two sides are one body now.

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidArgument
        If all of them are locked.
    NotAssembled
        If the loops cannot be closed with the joints there.
    """
    named = checked("joints", joints, scene.robot.joints, "joint")
    names, remarks = _with_partners(scene, named)
    if not names:
        return reduced(scene, scene.robot, scene.constraints, described_posture(scene), ())
    if len(names) == len(scene.robot.joints):
        raise InvalidArgument("joints: with all of them locked nothing moves; leave one at least")
    start = scene.state()[0] if q is None else normalised(scene.robot.model, "q", q)
    try:
        closed = scene.assemble(start, fixed=named, within_limits=False).q
    except NotAssembled as error:
        said = f"with {listed(named)} locked, {error}"
        raise type(error)(said, error.assembly) from error
    words = f"joints locked: {listed(names)}"
    robot = smaller_robot(scene.robot, names, closed, words)
    rest, _ = indices(scene.robot.model, robot.joints)
    others = {name: posture for name, posture in robot.postures.items() if name != "locked"}
    robot = replace(robot, postures={"locked": closed[rest], **others})
    kept, idle = sifted(robot, with_held(scene.robot, scene.constraints, names, closed))
    remarks += [f"constraint {c.name}: both of its sides are one body now" for c in idle]
    return reduced(scene, robot, kept, closed, (words, *remarks))


def keep(scene: Scene, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
    """Return the scene with all but some joints locked, as by `lock`.

    Parameters
    ----------
    scene : Scene
    joints : sequence of str
        What moves on. A free-flyer is kept without being named; `Scene.lock` holds it.
    q : (nq,) array_like, optional
        Where the others are held; the nominal state by default.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidArgument, NotAssembled
        As `lock`.
    """
    kept = {*checked("joints", joints, scene.robot.joints, "joint"), *free_flyers(scene.robot)}
    return lock(scene, [name for name in scene.robot.joints if name not in kept], q)


def without(scene: Scene, names: Sequence[str]) -> ReducedScene:
    """Return the scene without some of its constraints.

    Parameters
    ----------
    scene : Scene
    names : sequence of str
        Of constraints.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such constraint.
    """
    gone = checked("names", names, scene.names, "constraint")
    kept = [c for c in scene.constraints if c.name not in gone]
    dropped = tuple(f"constraint {name}: left out" for name in gone)
    return reduced(scene, scene.robot, kept, described_posture(scene), dropped)


def without_bodies(scene: Scene, joints: Sequence[str]) -> ReducedScene:
    """Return the scene without the bodies that hang on some joints, their mass included.

    Bodies further out go with them, and so do the constraints that are fixed to them.

    Parameters
    ----------
    scene : Scene
    joints : sequence of str

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidArgument
        If nothing is left of the robot.
    """
    model = scene.robot.model
    named = checked("joints", joints, scene.robot.joints, "joint")
    numbers = {int(i) for name in named for i in model.subtrees[model.getJointId(name)]}
    names = [name for name in scene.robot.joints if model.getJointId(name) in numbers]
    if len(names) == len(scene.robot.joints):
        raise InvalidArgument(f"joints = {list(named)}: nothing is left of {scene.robot.name}")
    words = f"bodies cut off: those of {listed(names)}"
    q = scene.state()[0]
    robot = smaller_robot(scene.robot, names, q, words, cut=True)
    kept, idle = sifted(robot, scene.constraints)
    remarks = [f"constraint {c.name}: a body of it was cut off" for c in idle]
    return reduced(scene, robot, kept, q, (words, *remarks), found=names)


def _with_partners(scene: Scene, joints: Sequence[str]) -> tuple[tuple[str, ...], list[str]]:
    """Return the joints with those that couplings hold when these are held, and a remark each."""
    held, remarks = dict.fromkeys(joints), []
    couplings = [c for c in scene.constraints if c.joints]
    for _ in couplings:
        for c in couplings:
            moving = [joint for joint in c.joints if joint not in held]
            if len(moving) == 1 < len(c.joints):
                (other,) = moving
                held[other] = None
                partners = listed([joint for joint in c.joints if joint != other])
                remarks.append(f"joint {other}: locked with {partners}, by the coupling {c.name}")
    return tuple(held), remarks
