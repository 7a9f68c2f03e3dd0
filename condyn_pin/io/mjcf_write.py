"""Write a robot with its loops as MJCF.

A Pinocchio joint and what it carries become a body that stands where the joint does at q0: the
posture ``qpos0``, which a robot has from an MJCF, else neutral; what is not zero there is the `ref`
of its joint. A joint that carries nothing and has one child, as in a universal joint, moves the
same body as its child: with B the pose of the body in the joint, its point is that of B⁻¹ and its
axis s becomes B⁻¹ s.

Coordinates mean the same in both, but for

    joint        Pinocchio                    MuJoCo
    free-flyer   pose in its placement xyzw   pose in the world, wxyz
    spherical    xyzw                         wxyz
    unbounded    (cos α, sin α)               α

Loops are given by sites, since an anchor would take its second point from where the file draws the
model. MuJoCo has two equalities between bodies; a hinge is two points of its axis.
"""

from __future__ import annotations

from collections.abc import Iterable

from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.constraints.contacts.kinds import bind_contacts
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.io.mjcf_write_robot import RobotWriter
from condyn_pin.model.robot import Robot


def to_mjcf(
    robot: Robot,
    *,
    without: Iterable[str] = (),
    contacts: Iterable[Contact] = (),
    shapes: bool = False,
) -> str:
    """Return a robot as MJCF; `Robot.to_mjcf` says what is written.

    Parameters
    ----------
    robot : Robot
    without : iterable of str
        Names of loops to leave out.
    contacts : iterable of Contact
        What may open and slide.
    shapes : bool
        Write what the description draws.
    """
    robot.check_unedited()
    if isinstance(contacts, str) or not isinstance(contacts, Iterable):
        raise InvalidArgument(f"contacts = {contacts!r}: a list of contacts is needed")
    touching = tuple(contacts)
    bind_contacts(robot, touching)
    return RobotWriter(robot).write(_kept(robot, without), touching, shapes)


def _kept(robot: Robot, without: Iterable[str]) -> tuple[Constraint, ...]:
    """Return the loops to write; kinds that MuJoCo lacks are refused."""
    if isinstance(without, str) or not isinstance(without, Iterable):
        raise InvalidArgument(f"without = {without!r}: a list of names of loops is needed")
    left_out = tuple(without)
    names = [loop.name for loop in robot.loops]
    for name in left_out:
        if name not in names:
            raise unknown_name("loop", str(name), names)
    kept = tuple(loop for loop in robot.loops if loop.name not in left_out)
    for loop in kept:
        if not loop.in_mjcf:
            pin = "a ball does the same in a mechanism that moves in a plane, kind='ball'; "
            raise InvalidModel(
                f"loop {loop.name!r} is a {loop.called}, for which MuJoCo has no equality; "
                f"{pin if loop.called == 'planar' else ''}to_mjcf(without=[{loop.name!r}]) writes "
                "the machine without it"
            )
    return kept
