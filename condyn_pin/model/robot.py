"""Robot: a Pinocchio model with what its description says beside it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from sys import getrefcount
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import show, tolerances
from condyn_pin._core._pin import dry_friction, pin, set_numbers, without_infinity
from condyn_pin._core.arguments import Arguments, check_type, count_text, normalised
from condyn_pin._core.arrays import Array, finite, read_only
from condyn_pin._core.models import rotation_fault
from condyn_pin.constraints.constraint import Constraint, check_size, no_joint
from condyn_pin.constraints.contacts.ground import Ground
from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.constraints.kinds import of_loops
from condyn_pin.constraints.loop import Loop
from condyn_pin.constraints.places import WORLD, FrameLike, find_frame, with_joint_names
from condyn_pin.constraints.rows.equations import least_pivots
from condyn_pin.errors import InvalidArgument, InvalidModel, StaleModel, unknown_name
from condyn_pin.model import joints as robot_joints
from condyn_pin.model.joints import CoupledMotor, Limits, check_coupled, joint_of
from condyn_pin.model.soundness import check_model
from condyn_pin.model.springs import Spring, SpringDamper, spring_dampers_of

if TYPE_CHECKING:
    from condyn_pin.constraints.contacts.contact import Contact
    from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
    from condyn_pin.constraints.contacts.joint_friction import JointFriction
    from condyn_pin.constraints.contacts.joint_limit import JointLimit


# What the fields of a Robot have to be.


# The fields that are lists, and what is in them, but for loops: of these kinds may be more.
_MEMBERS: Final[Mapping[str, tuple[type, ...]]] = {
    "contacts": (Constraint,),
    "actuated": (str,),
    "springs": (Spring,),
    "spring_dampers": (SpringDamper,),
    "unused": (str,),
    "unmodelled": (str,),
    "package_dirs": (str,),
    "coupled_motors": (CoupledMotor,),
    "lost_rows": (str,),
}


def lists() -> Mapping[str, tuple[type, ...]]:
    """Fields of a robot that are lists, and the types of their members."""
    return {"loops": of_loops(), **_MEMBERS}


def members(argument: str, value: Any, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    """Tuple of a list whose members are of some kinds, or InvalidArgument."""
    wanted = " or ".join(kind.__name__ for kind in kinds)
    if isinstance(value, (str, Mapping)) or not isinstance(value, Iterable):
        raise InvalidArgument(f"{argument} = {value!r}: a list of {wanted} is needed")
    found = tuple(value)
    for member in found:
        if not isinstance(member, kinds):
            raise InvalidArgument(f"{argument}: {member!r} is not a {wanted}")
    return found


def check_origin(name: Any, model: Any) -> None:
    """Raise InvalidArgument or InvalidModel unless a name is a text, and a model is sound."""
    if not isinstance(model, pin.Model):
        raise InvalidArgument(
            f"model = {type(model).__name__}: a pinocchio.Model is needed; "
            "load_robot reads one from a file"
        )
    check_type("name", name, str, "a text is needed")
    check_model(model)


def check_precision(precision: Any) -> None:
    """Raise InvalidArgument unless a precision is a number from 0 to the largest usable one."""
    if not 0.0 <= finite("precision", precision, ()) <= tolerances.LEAST_PRECISE:
        raise InvalidArgument(
            f"precision = {precision!r}: a number from 0 to {tolerances.LEAST_PRECISE:g} is "
            "needed, 1e-5 for a file with five digits"
        )


def check_joints(robot: Robot) -> None:
    """Raise UnknownName, InvalidArgument or InvalidModel unless motors and springs have joints."""
    for joint in (*robot.actuated, *(spring.joint for spring in robot.springs)):
        if joint in [loop.name for loop in robot.loops] and joint not in robot.joints:
            raise no_joint(robot, joint)
    for joint in robot.actuated:
        joint_of(robot.model, joint)
        if robot.actuated.count(joint) > 1:
            raise InvalidArgument(f"actuated: {joint!r} is named twice; name it once")
    check_coupled(robot.model, robot.coupled_motors)
    for spring in robot.springs:
        if joint_of(robot.model, spring.joint).nq != 1:
            raise InvalidModel(
                f"spring on {spring.joint!r}: a joint with one degree of freedom is needed"
            )


def check_ends(robot: Robot) -> None:
    """Raise UnknownName or InvalidModel unless spring-dampers are between frames of two bodies."""
    for each in robot.spring_dampers:
        if robot.frame(each.frame_a)[0] == robot.frame(each.frame_b)[0]:
            raise InvalidModel(
                f"spring-damper between {each.frame_a!r} and {each.frame_b!r}: both are on one "
                "body, where it does nothing; frames of two bodies are needed"
            )


def exclusions(robot: Robot) -> frozenset[frozenset[str]]:
    """Sets of bodies that do not touch, or InvalidArgument or UnknownName."""
    known = {*robot.frames, *robot.joints, *WORLD}
    found = set[frozenset[str]]()
    for each in members("exclusions", robot.exclusions, (Collection,)):
        names = frozenset(members("exclusions", each, (str,)))
        if len(names) < 2:
            raise InvalidArgument(f"exclusions: {each!r}: two or more bodies are needed")
        for name in names - known:
            raise unknown_name("frame", name, sorted(known))
        found.add(names)
    return frozenset(found)


def postures(model: Any, value: Any) -> Mapping[str, Array]:
    """Configurations by name, normalised and read-only; InvalidArgument if they are none."""
    check_type("postures", value, Mapping, "a mapping of names is needed")
    return MappingProxyType({name: _posture(model, name, q) for name, q in value.items()})


def _posture(model: Any, name: str, q: ArrayLike) -> Array:
    if not isinstance(name, str):
        raise InvalidArgument(f"postures: {name!r} is not the name of a posture")
    array = normalised(model, f"posture {name!r}", q)
    array.flags.writeable = False
    return array


# A model with one more frame.


def model_with_frame(
    robot: Robot, name: str, parent: FrameLike, translation: Any, rotation: ArrayLike | None
) -> Any:
    """Return the robot's model with one more frame; see `Robot.with_frame`."""
    if not isinstance(name, str) or not name:
        raise InvalidArgument(f"name = {name!r}: a text is needed")
    if name in robot.frames or name in WORLD:
        raise InvalidArgument(f"name = {name!r}: {robot.name} has a frame of this name")
    joint, placement = find_frame(robot, parent)
    if isinstance(translation, pin.SE3):
        if rotation is not None:
            raise InvalidArgument("rotation: the placement has one; leave it out")
        translation, rotation = translation.translation, translation.rotation
    p = finite("translation", translation, (3,))
    check_size("translation", *p)
    R = finite("rotation", np.eye(3) if rotation is None else rotation, (3, 3))
    fault = rotation_fault(R)
    if fault:
        raise InvalidArgument(
            f"rotation = {R.tolist()}: {fault}; an orthonormal matrix with determinant 1 is needed"
        )
    model = pin.Model(robot.model)
    model.addFrame(pin.Frame(name, joint, 0, placement * pin.SE3(R, p), pin.FrameType.OP_FRAME))
    return model


# Robot: a Pinocchio model with what its description says beside it.


class _Model:
    """Model of a robot, marked as read: an edit in place needs somebody who holds it."""

    def __get__(self, robot: Robot | None, _: type[Robot]) -> Any:
        if robot is None:  # a field without a default
            raise AttributeError("model")
        fields = robot.__dict__
        fields["_read"] = True
        return fields["model"]

    def __set__(self, robot: Robot, model: Any) -> None:
        robot.__dict__["model"] = model


# References to an object that one dictionary alone holds, as `getrefcount` counts them.
_SAMPLE: Final = {"model": object()}
_HELD_BY_ONE: Final = getrefcount(_SAMPLE["model"])


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot: a kinematic tree, its loops, its postures, and their origin.

    Parameters
    ----------
    name : str
        Name of the robot.
    model : pin.Model
        The tree. A robot is a value: to change the model, change a copy of it and make another
        robot from that. An edit in place is noticed and refused (`StaleModel`).
    postures : mapping of str to (nq,) array, optional
        Configurations by name [rad, m]. Loops may be open in them: `Scene.state` closes them.
    loops : sequence of Loop or Coupling, optional
        The closures of the description, and its gears.
    contacts : sequence of Constraint, optional
        Ready-made contacts, where the robot usually touches the ground.
    actuated : sequence of str, optional
        Names of the joints with a motor of their own.
    springs : sequence of Spring, optional
        Springs of the description. They act in `step` and `simulate`; in `solve` and `derivatives`
        only if you add `passive_torque` to tau.
    unused : sequence of str, optional
        What the description has and the dynamics do not use, but for what is `unmodelled`.
    source, licence : str, optional
        Where the description comes from, and its licence.
    description : str, optional
        Path of the file that it was read from, where `view` finds its shapes.
    spring_dampers : sequence of SpringDamper, optional
        Springs and dampers between two frames. They act as `springs` do.
    precision : float, optional
        Precision of the geometry [rad, and lengths in sizes of a loop], 1e-3 at most. Rows that
        count by no more at every closed state are redundant. Rounding, 1e-11, for models that are
        built in Python; `load_robot` gives files 1e-5. 0 takes every row at its word, at open
        states too, and no status doubts a state.
    unmodelled : sequence of str, optional
        What the description has, changes the motion, and is not in the model, a sentence each.
    package_dirs : sequence of str, optional
        Folders in which the meshes of the description are looked for.
    coupled_motors : sequence of CoupledMotor, optional
        Motors that act on several joints at once, through a differential or a cable.
    lost_rows : sequence of str, optional
        Those of `unmodelled` that close the robot: the model without them is another mechanism.
    exclusions : collection of sets of str, optional
        Bodies that do not touch each other, by their frames: pairs, or more of which no two touch.

    Raises
    ------
    InvalidModel
        If Pinocchio's algorithms would be silently wrong on the model: joints not added
        depth-first, mimic joints, a joint that moves no inertia. Or if a spring-damper has both
        its ends on one body.
    """

    name: str
    model: Any = _Model()
    postures: Mapping[str, Array] = field(default_factory=dict)
    loops: Sequence[Constraint] = ()
    contacts: Sequence[Constraint] = ()
    actuated: Sequence[str] = ()
    springs: Sequence[Spring] = ()
    unused: Sequence[str] = ()
    source: str = ""
    licence: str = ""
    description: str = ""
    spring_dampers: Sequence[SpringDamper] = ()
    precision: float = tolerances.ROUNDED_GEOMETRY
    unmodelled: Sequence[str] = ()
    package_dirs: Sequence[str] = ()
    coupled_motors: Sequence[CoupledMotor] = ()
    lost_rows: Sequence[str] = ()
    exclusions: Collection[Collection[str]] = frozenset()

    def __post_init__(self) -> None:
        check_origin(self.name, self.model)
        check_precision(self.precision)
        for key, kind in lists().items():
            object.__setattr__(self, key, members(key, getattr(self, key), kind))
        for key in ("loops", "contacts", "spring_dampers"):
            its = tuple(with_joint_names(each, self) for each in getattr(self, key))
            object.__setattr__(self, key, its)
        check_joints(self)
        check_ends(self)
        object.__setattr__(self, "exclusions", exclusions(self))
        object.__setattr__(self, "postures", postures(self.model, self.postures))
        # A private copy: what the model was when it was checked.
        object.__setattr__(self, "_pristine", pin.Model(self.model))
        if self.model != self.unedited:
            raise InvalidModel(
                "the model differs from its own copy: one of its numbers is NaN, such as a limit; "
                "use infinity for a limit that does not exist"
            )

    @property
    def unedited(self) -> Any:
        """Copy of the model from when it was checked, which edits do not reach."""
        return self._pristine  # type: ignore[attr-defined]

    @property
    def nq(self) -> int:
        """Size of a configuration."""
        return int(self.model.nq)

    @property
    def nv(self) -> int:
        """Size of a velocity: the degrees of freedom of the tree."""
        return int(self.model.nv)

    @cached_property
    def mass(self) -> float:
        """Total mass [kg], with what is fixed to the world."""
        return float(sum(inertia.mass for inertia in self.model.inertias))

    @cached_property
    def longest_link(self) -> float:
        """The largest distance from a joint to its parent [m]."""
        return max(float(np.linalg.norm(p.translation)) for p in self.model.jointPlacements)

    @cached_property
    def least_pivots(self) -> Array:
        """Lower bounds of the pivots of the mass matrix at any q (nv,) [kg, kg m^2]."""
        return read_only(least_pivots(self.unedited))

    @cached_property
    def arguments(self) -> Arguments:
        """The check that (q, v, tau) have their sizes, and quaternions and (cos, sin) norm 1."""
        return Arguments(self.unedited)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames that constraints can use, beside those of joints."""
        return tuple(dict.fromkeys(frame.name for frame in self.model.frames))

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, the world's not among them."""
        return tuple(self.model.names)[1:]

    @property
    def motor_joints(self) -> tuple[str, ...]:
        """Names of the joints on which motors act, alone or several at once."""
        coupled = (joint for motor in self.coupled_motors for joint in motor.weights)
        return tuple(dict.fromkeys((*self.actuated, *coupled)))

    def index_q(self, joint: str) -> int:
        """Return the index in q of a hinge or a slider: ``q[robot.index_q("knee")]``.

        A joint with several numbers has no single index: `configuration` sets it by name.

        Raises
        ------
        UnknownName
            If there is no such joint; the text lists the nearest names.
        InvalidArgument
            If the joint has several numbers in q.
        """
        return robot_joints.index(self, joint, "q")

    def index_v(self, joint: str) -> int:
        """Return the index of a joint in v, a and tau: ``tau[robot.index_v("knee")]``.

        Raises
        ------
        UnknownName
            If there is no such joint; the text lists the nearest names.
        InvalidArgument
            If the joint has several numbers in v.
        """
        return robot_joints.index(self, joint, "v")

    def configuration(
        self, values: Mapping[str, ArrayLike], *, start: ArrayLike | None = None
    ) -> Array:
        """Return a configuration by joint names: ``robot.configuration({"knee": 0.3})``.

        Loops may be open in it; `Scene.assemble` closes them.

        Parameters
        ----------
        values : mapping of str to float or array_like
            Value of each joint [rad or m]. A joint without limits takes its angle, a free-flyer
            x y z and the quaternion x y z w.
        start : (nq,) array_like, optional
            What the other joints keep: by default the first posture, else neutral.

        Returns
        -------
        q : (nq,) array
            Configuration [rad, m].

        Raises
        ------
        UnknownName
            If there is no such joint; the text lists the nearest names.
        InvalidArgument
            If a joint has another number of values, or a quaternion is not of norm 1.
        """
        return robot_joints.configuration(self, values, start)

    def joint_values(self, q: ArrayLike) -> dict[str, float | Array]:
        """Return the value of each joint in q, by name: what `configuration` takes.

        Angles [rad], also of joints without limits; slides [m]; of other joints all numbers (k,).

        Parameters
        ----------
        q : (nq,) array_like
            Configuration [rad, m]; quaternions x y z w.
        """
        return robot_joints.joint_values(self, q)

    def joint_vector(self, values: Mapping[str, ArrayLike]) -> Array:
        """Return a v, an a or a tau (nv,) by joint names, zero for the others.

        ``tau = robot.joint_vector({"knee": 60.0})`` is a torque of 60 N m in the knee.

        Parameters
        ----------
        values : mapping of str to float or array_like
            Of each joint; of a free-flyer six, linear first, in its body frame.

        Returns
        -------
        (nv,) array
            In the units of what it is: of a tau [N m, N].

        Raises
        ------
        UnknownName
            If there is no such joint; the text lists the nearest names.
        InvalidArgument
            If a joint has another number of values, or one is not finite.
        """
        return robot_joints.joint_vector(self, values)

    def frame_pose(self, q: ArrayLike, frame: FrameLike) -> Any:
        """Return the pose of a frame in the world at q, a `pinocchio.SE3`.

        ``robot.frame_pose(q, "foot").translation`` is where the foot is [m].

        Parameters
        ----------
        q : (nq,) array_like
            Configuration [rad, m]; quaternions x y z w.
        frame : str, (joint, pin.SE3) or pin.Frame
            One of `frames`, or a placement on a joint, as in `frame`.

        Raises
        ------
        UnknownName, InvalidModel
            As in `frame`.
        InvalidArgument
            If q has a wrong size, is not finite, or has an unnormalised quaternion.
        """
        return robot_joints.frame_pose(self, q, frame)

    def center_of_mass(self, q: ArrayLike) -> Array:
        """Return the centre of mass in the world at q (3,) [m]."""
        return robot_joints.center_of_mass(self, q)

    def frame(self, name: FrameLike) -> tuple[int, Any]:
        """Return the number of the joint that carries a frame, and its `pinocchio.SE3` on it.

        Parameters
        ----------
        name : str, (joint, pin.SE3) or pin.Frame
            Wherever a frame is needed it may also be a placement on a joint, by the joint's name or
            number, or a `pin.Frame` that the model need not have. As a text such a pair is
            ``"knee + [0.1 0 0]"``, with the quaternion x y z w behind where it is turned.

        Raises
        ------
        UnknownName
            If there is no such frame or joint; the text lists the nearest names.
        InvalidModel
            If several frames of this name are in different places, or one with the world's name
            is elsewhere.
        """
        return find_frame(self, name)

    def with_frame(
        self, name: str, parent: FrameLike, translation: Any, rotation: ArrayLike | None = None
    ) -> Robot:
        """Return a robot with one more frame, for a constraint to use.

        Parameters
        ----------
        name : str
            Name of the new frame.
        parent : str, (joint, pin.SE3) or pin.Frame
            Frame that it is fixed to; "world" for a point of the world.
        translation : (3,) array_like or pinocchio.SE3
            Its origin in the parent frame [m]; or its whole placement there.
        rotation : (3, 3) array_like, optional
            Its axes in the parent frame; the same axes by default.

        Raises
        ------
        InvalidArgument
            If the name is taken, or `rotation` is no rotation.
        UnknownName
            If there is no such parent frame.
        """
        model = model_with_frame(self, name, parent, translation, rotation)
        return replace(self, model=model)

    def with_masses(self, masses: Mapping[str, float]) -> Robot:
        """Return a robot some of whose bodies are heavier or lighter, for a payload or a doubt.

        I = (m / m_0) I_0: the centre of mass stays, the inertia grows with the mass.

        Parameters
        ----------
        masses : mapping of str to float
            Of the body that a joint moves, with what is fixed to it, by the name of the joint [kg].

        Raises
        ------
        UnknownName
            If there is no such joint; the text lists the nearest names.
        InvalidArgument
            If a mass is not positive, or the body has none whose inertia could grow.
        """
        return replace(self, model=robot_joints.model_with_masses(self.model, masses))

    def with_motors(self, *motors: str | CoupledMotor) -> Robot:
        """Return a robot with these motors, and no others.

        Parameters
        ----------
        *motors : str or CoupledMotor
            Joints with a motor of their own, and motors that act on several joints.
        """
        coupled = [motor for motor in motors if isinstance(motor, CoupledMotor)]
        joints = [motor for motor in motors if not isinstance(motor, CoupledMotor)]
        return replace(self, actuated=joints, coupled_motors=coupled)

    def with_loops(self, *loops: Constraint) -> Robot:
        """Return a robot with more loops and couplings."""
        return replace(self, loops=(*self.loops, *loops))

    def with_whole_joints(self, *loops: str | Loop) -> Robot:
        """Return a robot in whose tree the joints that close loops are joints like the others.

        The joint is in q and v by the name of the loop: stops, springs, friction, motors and drives
        act in it. It carries a piece of the body behind it; a weld ``NAME_weld`` holds the rest.

        Parameters
        ----------
        *loops : str or Loop
            Names of `loops` that are joints with coordinates, or such loops themselves.

        Returns
        -------
        Robot
            A cylindrical joint is ``NAME_slide`` and ``NAME_turn``, a universal one ``NAME_axis``
            and ``NAME_axis2``. Coordinates are of `frame_b` relative to `frame_a`; those of
            postures are between -pi and pi, and count turns in a motion.

        Raises
        ------
        UnknownName
            If there is no such loop; the text lists the nearest names.
        InvalidArgument
            If a loop is of another kind.
        InvalidModel
            If neither body has an inertia that the joint would move, or its name is taken.

        Notes
        -----
        The pieces of a body have equal shares of its inertia: change masses before.
        """
        from condyn_pin.model.whole_joints import with_whole_joints

        return with_whole_joints(self, loops)

    def with_contacts(self, *contacts: Constraint) -> Robot:
        """Return a robot with more ready-made contacts."""
        return replace(self, contacts=(*self.contacts, *contacts))

    def with_posture(self, name: str, values: Mapping[str, ArrayLike]) -> Robot:
        """Return a robot with one more posture, the first: its default from then on.

        Parameters
        ----------
        name : str
        values : mapping of str to float or array_like
            By joint, as for `configuration`, which has the others as well [rad, m].
        """
        others = {key: q for key, q in self.postures.items() if key != name}
        return replace(self, postures={name: self.configuration(values), **others})

    def with_limits(self, limits: Mapping[str, tuple[float, float]]) -> Robot:
        """Return a robot with other limits of position.

        Parameters
        ----------
        limits : mapping of str to (float, float)
            Lower and upper limit of joints with one coordinate [rad, m]; infinity for none.

        Raises
        ------
        UnknownName
            If there is no such joint; the text lists the nearest names.
        InvalidArgument
            If a joint has several coordinates, or its lower limit is above the upper one.
        """
        return replace(self, model=robot_joints.model_with_limits(self, limits))

    def frictional_contacts(
        self, friction: float, *, on: Plane | Ground | None = None
    ) -> tuple[FrictionalContact, ...]:
        """Return the robot's contacts as ones that may open and slide, for `Scene(contacts=...)`.

        Points and balls by their names, edges by their ends, surfaces by their corners.

        Parameters
        ----------
        friction : float
            Coulomb's coefficient [1].
        on : Plane or Ground, optional
            The ground; z = 0 of the world by default.

        Raises
        ------
        InvalidArgument
            If a contact does not say its size, or has no points that touch, such as a wheel.
        """
        from condyn_pin.constraints.contacts.kinds import feet_of

        return feet_of(self.contacts, friction, on)

    def collisions(
        self,
        friction: float,
        *,
        ground: Plane | Ground | None = None,
        shapes: Sequence[str] | None = None,
    ) -> tuple[FrictionalContact, ...]:
        """Return a contact of each collision shape of the file, for `Scene(contacts=...)`.

        Spheres, boxes, capsules, cylinders and ellipsoids as they are, meshes as their convex
        hulls, which over planes is the same. Those of the world, and of links that the file lets
        through it, are left out. They are named after link and kind, ``"base box"``; where a
        ready-made contact stands on a shape, that has its name: use either these contacts or
        `frictional_contacts`, a scene with both is refused.

        Parameters
        ----------
        friction : float
            Coulomb's coefficient [1].
        ground : Plane or Ground, optional
            The ground; z = 0 of the world by default.
        shapes : sequence of str, optional
            Names of the links, or of single shapes, to take; all of them by default.

        Raises
        ------
        InvalidModel
            If the robot has no file with collision shapes, or one of them cannot be read, or cannot
            touch; the text names it.
        UnknownName
            If `shapes` names none of them.

        Notes
        -----
        The shapes are read from `description`, and their meshes looked for in `package_dirs`.
        """
        from condyn_pin.io.collisions import collisions

        return collisions(self, friction, Plane() if ground is None else ground, shapes)

    def self_collisions(
        self,
        friction: float,
        *,
        shapes: Sequence[str] | None = None,
        without: Sequence[Sequence[str]] = (),
    ) -> tuple[FrictionalContact, ...]:
        """Return a contact of each pair of collision shapes that may meet, for `Scene(contacts=)`.

        Shapes on one joint, or on two that a joint connects, are no pair, and neither are those
        that the SRDF, SDF or MJCF excludes (`exclusions`). Meshes are their convex hulls: what is
        hollow in a mesh is filled. Cylinders are prisms of 32 sides in them.

        Parameters
        ----------
        friction : float
            Coulomb's coefficient [1].
        shapes : sequence of str, optional
            Names of the links, or of single shapes, to take; all of them by default.
        without : sequence of (str, str), optional
            Pairs of links or shapes to leave out.

        Raises
        ------
        InvalidModel
            If shapes cannot be read, or overlap in the first posture of the file; the text has
            `without` for these.
        InvalidArgument
            If a shape touches planes alone: an ellipsoid.
        UnknownName
            If `shapes` or `without` names none of them.
        """
        from condyn_pin.io.collisions import self_collisions

        return self_collisions(self, friction, shapes, without)

    def limits(self) -> tuple[JointLimit, ...]:
        """Return the stops of all joints with a finite limit, for `Scene(contacts=...)`."""
        from condyn_pin.constraints.contacts.joint_limit import JointLimit

        return tuple(JointLimit(joint) for joint in dict.fromkeys(Limits.of(self.model).joints))

    def frictions(self) -> tuple[JointFriction, ...]:
        """Return the dry friction of all joints to which the file gives one, as contacts.

        |lam| <= torque of the file [N m, N], for `Scene(contacts=...)`.
        """
        from condyn_pin.constraints.contacts.joint_friction import JointFriction

        rubs, joints = dry_friction(self.model) > 0.0, self.model.joints[1:]
        return tuple(
            JointFriction(name)
            for name, joint in zip(self.joints, joints, strict=True)
            if rubs[joint.idx_v : joint.idx_v + joint.nv].any()
        )

    def passive_torque(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the torque (nv,) of springs and dampers [N m, N]; add it to the tau of `solve`.

        tau_i = -k_i (q_i - q0_i) - d_i v_i - sum_s (J_s^T n_s f_s)_i

        with f_s the tension of a spring-damper, n_s its direction, and J_s v the rate of its ends.
        Pinocchio reads stiffness and damping from the file and leaves them out of its dynamics.

        Parameters
        ----------
        q, v : (nq,), (nv,) array_like
            Configuration [rad, m] and velocity [rad/s, m/s].
        """
        q_, v_ = finite("q", q, self.nq), finite("v", v, self.nv)
        tau: Array = -np.asarray(self.model.damping, dtype=float) * v_
        for spring in self.springs:
            joint = robot_joints.joint_of(self.model, spring.joint)
            tau[joint.idx_v] -= spring.stiffness * (q_[joint.idx_q] - spring.reference)
        if self.spring_dampers:
            tau += spring_dampers_of(self).torque(q_, v_)
        return tau

    def to_mjcf(
        self,
        *,
        without: Sequence[str] = (),
        contacts: Sequence[Contact] = (),
        shapes: bool = False,
    ) -> str:
        """Return the robot with its loops as MJCF, for MuJoCo.

        Joints with armature, damping, springs and limits, frames as sites, loops and couplings as
        equalities, spring-dampers as tendons, motors, those of several joints on fixed tendons, and
        postures as keyframes. Limits of velocity have no place in it, and a comment counts them. A
        hinge loop is two points of its axis, and `load_robot` reads these
        as two balls.

        Parameters
        ----------
        without : sequence of str
            Names of loops to leave out, such as sliders, for which MuJoCo has no equality.
        contacts : sequence of Contact, optional
            What may open and slide, such as ``robot.frictional_contacts(friction=0.7)``: two geoms
            and a pair each, so that nothing else collides. MuJoCo's contacts are soft.
        shapes : bool
            Write what the description draws, as geoms that collide with nothing; meshes are in the
            file itself.

        Raises
        ------
        InvalidModel
            If MuJoCo has nothing like a joint, a loop or a contact, or a mesh cannot be read; the
            text names it.
        UnknownName
            If `without` names no loop.
        """
        from condyn_pin.io.mjcf_write import to_mjcf

        return to_mjcf(self, without=without, contacts=contacts, shapes=shapes)

    def check_unedited(self) -> None:
        """Raise `StaleModel` if the model was edited since the robot was made.

        A comparison takes microseconds. It is made if `model` was read since the last one, or if
        anybody holds the model or a part of it now: all parts hold the whole.
        """
        fields = self.__dict__
        if not fields["_read"] and getrefcount(fields["model"]) <= _HELD_BY_ONE:
            return
        fields["_read"] = False
        if fields["model"] != self.unedited:
            fields["_read"] = True
            raise StaleModel(
                f"the model of {self.name} was edited after the robot was made; "
                "edit a copy, pin.Model(robot.model), and make a new one: "
                "dataclasses.replace(robot, model=edited)"
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Robot):
            return NotImplemented
        if self is other:
            return True
        plain = ("name", *lists(), "source", "licence", "precision", "exclusions")
        return (
            all(getattr(self, key) == getattr(other, key) for key in plain)
            and self.postures.keys() == other.postures.keys()
            and all(np.array_equal(self.postures[k], other.postures[k]) for k in self.postures)
            and self.model == other.model
        )

    def __hash__(self) -> int:
        return hash((self.name, self.nq, self.nv, self.loops))

    def __reduce__(self) -> tuple[Any, ...]:
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        own["model"], infinite = without_infinity(self.model)
        return _unpickled, (own | {"postures": dict(self.postures)}, infinite)

    def _repr_html_(self) -> str:
        """HTML summary for notebooks."""
        return robot_html(self)

    def __repr__(self) -> str:
        return (
            f"Robot({self.name!r}: nq {self.nq}, nv {self.nv}, {self.mass:.4g} kg, "
            f"{count_text(len(self.loops), 'loop')}, "
            f"{count_text(len(self.actuated) + len(self.coupled_motors), 'motor')}, "
            f"postures: {', '.join(self.postures) or 'none'})"
        )


def _unpickled(own: dict[str, Any], infinite: Mapping[str, Array]) -> Robot:
    set_numbers(own["model"], infinite)
    return Robot(**own)


# A Robot as a notebook shows it.


def robot_html(robot: Robot) -> str:
    """HTML summary of a robot: its joints, loops, contacts, and unused parts of its description."""
    joints = [
        (name, _kind(joint), _indices(joint.idx_q, joint.nq), _indices(joint.idx_v, joint.nv),
         _motors(robot, name))
        for name, joint in zip(robot.joints, robot.model.joints[1:], strict=True)
    ]  # fmt: skip
    loops = [(loop.name, loop.title, str(loop.rows)) for loop in robot.loops]
    contacts = [(contact.name, contact.title, str(contact.rows)) for contact in robot.contacts]
    said = {
        "coordinates": f"nq {robot.nq}, nv {robot.nv}",
        "mass": f"{robot.mass:.6g} kg",
        "motors": str(len(robot.actuated) + len(robot.coupled_motors)),
        "postures": ", ".join(robot.postures) or "none",
        "source": robot.source or "unknown",
        "licence": robot.licence or "unknown",
    }
    columns = ("name", "kind", "rows")
    return show.page(
        f"Robot {robot.name}",
        show.facts(said.items()),
        show.folded_html(
            count_text(len(joints), "joint"),
            show.grid(("joint", "kind", "in q", "in v", ""), joints),
            count=len(joints),
        ),
        show.folded_html(
            count_text(len(loops), "loop"), show.grid(columns, loops), count=len(loops)
        ),
        show.folded_html(
            count_text(len(contacts), "ready-made contact"),
            show.grid(columns, contacts),
            count=len(contacts),
        ),
        show.folded_html(
            "changes the motion, and is not modelled", show.notes(robot.unmodelled), count=0
        ),
        show.folded_html("in the file and not used", show.notes(robot.unused)),
    )


def _motors(robot: Robot, joint: str) -> str:
    """Motors that act on a joint, those of several joints by name."""
    own = ["motor"] if joint in robot.actuated else []
    return ", ".join([*own, *(m.name for m in robot.coupled_motors if joint in m.weights)])


def _kind(joint: Any) -> str:
    return str(joint.shortname()).removeprefix("JointModel")


def _indices(start: int, count: int) -> str:
    return str(start) if count == 1 else f"{start}:{start + count}"
