"""Smaller scenes: what may be left out, and what it costs.

Joints locked, constraints dropped, bodies cut off.

Locking is exact: the smaller scene moves as the full one does under constraints a_i = 0 on the
locked joints, whose forces are then inside a body and cost nothing. Dropping a constraint or a body
changes the robot; `Scene.minimal` measures by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked_names, listed, normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import Indices, indices
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.contacts.contact import Contact
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled, UnknownName
from condyn_pin.mechanism.summary import Summary
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import free_flyers, smaller_robot, split_constraints, with_held


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
    named = checked_names("joints", joints, scene.robot.joints, "joint")
    names, remarks = _with_partners(scene, named)
    if not names:
        return reduced_scene(scene, scene.robot, scene.constraints, described_posture(scene), ())
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
    kept, idle = split_constraints(robot, with_held(scene.robot, scene.constraints, names, closed))
    remarks += [f"constraint {c.name}: both of its sides are one body now" for c in idle]
    return reduced_scene(scene, robot, kept, closed, (words, *remarks))


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
    kept = {
        *checked_names("joints", joints, scene.robot.joints, "joint"),
        *free_flyers(scene.robot),
    }
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
    gone = checked_names("names", names, scene.names, "constraint")
    kept = [c for c in scene.constraints if c.name not in gone]
    dropped = tuple(f"constraint {name}: left out" for name in gone)
    return reduced_scene(scene, scene.robot, kept, described_posture(scene), dropped)


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
    named = checked_names("joints", joints, scene.robot.joints, "joint")
    numbers = {int(i) for name in named for i in model.subtrees[model.getJointId(name)]}
    names = [name for name in scene.robot.joints if model.getJointId(name) in numbers]
    if len(names) == len(scene.robot.joints):
        raise InvalidArgument(f"joints = {list(named)}: nothing is left of {scene.robot.name}")
    words = f"bodies cut off: those of {listed(names)}"
    q = scene.state()[0]
    robot = smaller_robot(scene.robot, names, q, words, cut=True)
    kept, idle = split_constraints(robot, scene.constraints)
    remarks = [f"constraint {c.name}: a body of it was cut off" for c in idle]
    return reduced_scene(scene, robot, kept, q, (words, *remarks), found=names)


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


# ReducedScene: a smaller scene that knows the one that it comes from, and the way back.
#
# With the joints of the smaller scene first, and the others held still or following from the loops,
#
#     q_full = (q, q_held, q_found(q)),        v_full = (v, 0, v_found(q, v)).


@dataclass(frozen=True, kw_only=True)
class ReducedScene(Scene):
    """A smaller scene that knows the scene it was made from.

    Attributes
    ----------
    full : Scene
        The scene before the first step.
    held : tuple of float
        A configuration of the full robot: locked joints are there.
    found : tuple of str
        Joints of the full robot whose bodies were cut off: where they are follows from the loops.
    dropped : tuple of str
        What was left out, and why, a sentence each.
    """

    full: Scene
    held: tuple[float, ...]
    found: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()

    def reduce_state(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Return (q, v) of this scene from those of the full one.

        Raises
        ------
        InvalidArgument
            If a locked joint is elsewhere than it is locked, or moves.
        """
        robot = self.full.robot
        q_, v_ = normalised(robot.model, "q", q), finite("v", v, robot.nv)
        away = np.abs(np.array(pin.difference(robot.model, np.array(self.held), q_)))
        for name in robot.joints:
            if name in self.robot.joints or name in self.found:
                continue
            _, index = indices(robot.model, [name])
            for what, size in (("away from where it is locked", away), ("moving", np.abs(v_))):
                if size[index].max() > tolerances.CLOSED:
                    raise InvalidArgument(
                        f"joint {name!r} is {what} by {size[index].max():.3g}; lock it at this q, "
                        "or start from a state in which it is at rest there"
                    )
        index_q, index_v = self._places
        return q_[index_q], v_[index_v]

    def expand_state(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Return (q, v) of the full scene from those of this one.

        Locked joints stand still; joints of bodies that were cut off are found from the loops.
        Whatever the loops do not determine, such as the spin of a rod about itself, keeps its
        nominal value, at rest.

        Raises
        ------
        NotAssembled
            If the loops of what was cut off cannot be closed at q.
        """
        index_q, index_v = self._places
        q_, v_ = np.array(self.held), np.zeros(self.full.robot.nv)
        q_[index_q] = normalised(self.robot.model, "q", q)
        v_[index_v] = finite("v", v, self.robot.nv)
        return self._find(q_, v_) if self.found else (q_, v_)

    def reduce_torque(self, tau: ArrayLike) -> Array:
        """Return the torques (nv,) of the joints that are left; on locked ones they do nothing."""
        return finite("tau", tau, self.full.robot.nv)[self._places[1]]

    def summary(self, q: ArrayLike | None = None) -> Summary:
        """Return the summary of the smaller scene; its notes say what was left out."""
        summary = super().summary(q)
        said = tuple(text for text in self.dropped if text not in summary.unused)
        return replace(summary, notes=(*said, *summary.notes))

    def __str__(self) -> str:
        left_out = [*self.dropped] or ["nothing is left out"]
        sizes = (
            f"{self.robot.name}: nv {self.full.robot.nv} -> {self.robot.nv}, "
            f"rows {self.full.rows} -> {self.rows}"
        )
        return "\n".join([sizes, *left_out])

    @cached_property
    def _places(self) -> tuple[Indices, Indices]:
        return indices(self.full.robot.model, self.robot.joints)

    def _find(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the state with the joints of cut-off bodies where their loops want them."""
        full, scene = self.full, self._cut_off
        if not scene.constraints:
            return q, v
        known = [name for name in full.robot.joints if name not in self.found]
        q = scene.assemble(q, fixed=known, within_limits=False).q
        _, index = indices(full.robot.model, self.found)
        J = equations_of(scene).jacobian(q)
        v[index] = -np.linalg.lstsq(J[:, index], J @ v, rcond=tolerances.RANK)[0]
        return q, v

    @cached_property
    def _cut_off(self) -> Scene:
        """The full robot with the loops of the bodies that were cut off."""
        full = self.full
        numbers = {full.robot.model.getJointId(name) for name in self.found}
        return Scene(
            full.robot, [c for c in full.constraints if numbers & set(c.sides(full.robot))]
        )

    def __reduce__(self) -> tuple[Any, ...]:
        rest = {key: getattr(self, key) for key in ("full", "held", "found", "dropped")}
        return partial(ReducedScene, **rest), (self.robot, self.constraints, self.contacts)


@one_blas_thread
def reduced_scene(
    scene: Scene,
    robot: Robot,
    constraints: Sequence[Any],
    q: Array,
    dropped: Sequence[str],
    *,
    found: Sequence[str] = (),
) -> ReducedScene:
    """Return the scene after one more step, with `robot` and `constraints`."""
    # It was made at the configuration q of `scene`, left out what `dropped` says, and cut off the
    # bodies of the joints `found`. The full scene is that before the first step. Contacts go with
    # it, but for those that nothing is left of.
    model = scene.robot.model
    gone = [(name, model.joints[model.getJointId(name)]) for name in scene.robot.joints
            if name not in robot.joints]  # fmt: skip
    held_at = {name: float(q[joint.idx_q]) for name, joint in gone if joint.nq == 1}
    contacts, idle = _fitting(robot, [each.with_held(held_at) for each in scene.contacts])
    dropped = (*dropped, *(f"contact {name}: its body or its joint is held, or cut off"
                           for name in idle))  # fmt: skip
    if not isinstance(scene, ReducedScene):
        held, before = tuple(q.tolist()), Scene(scene.robot, scene.constraints, scene.contacts)
        return ReducedScene(
            robot, constraints, contacts,
            full=before, held=held, found=tuple(found), dropped=dropped,
        )  # fmt: skip
    all_held = np.array(scene.held)
    all_held[indices(scene.full.robot.model, scene.robot.joints)[0]] = q
    return ReducedScene(
        robot,
        constraints,
        contacts,
        full=scene.full,
        held=tuple(all_held.tolist()),
        found=(*scene.found, *found),
        dropped=(*scene.dropped, *dropped),
    )


def _fitting(
    robot: Robot, contacts: Sequence[Contact]
) -> tuple[tuple[Contact, ...], tuple[str, ...]]:
    """Return the contacts that a smaller robot still has, and the names of the others."""
    kept, idle = [], []
    for contact in contacts:
        try:
            contact.bind(robot)
            kept.append(contact)
        except (InvalidArgument, UnknownName):  # both sides on one body, or no such frame or joint
            idle.append(contact.name)
    return tuple(kept), tuple(idle)
