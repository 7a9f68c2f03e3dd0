"""Scene: a robot and exactly the constraints that the question needs.

A solve needs no more of it than what is bound, and `nominal`. What a mechanism is, which states it
allows and what can be left out of it is asked for by methods that `condyn_pin.mechanism` answers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import count_text, renamed
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.constraints.kinds import bind
from condyn_pin.constraints.places import with_joint_names
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.nominal import (
    NominalAnalysis,
    described_posture,
    scene_at,
    scene_without_time,
)
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import InvalidArgument, UnsupportedConstraint
from condyn_pin.model.robot import Robot

if TYPE_CHECKING:
    from condyn_pin.constraints.contacts.contact import Contact, Mode
    from condyn_pin.dynamics.symbolic import SymbolicScene
    from condyn_pin.mechanism.closing import Assembly
    from condyn_pin.mechanism.minimal_scene import Minimal
    from condyn_pin.mechanism.rank import Check, Rank
    from condyn_pin.mechanism.reduction import ReducedScene
    from condyn_pin.mechanism.summary import Summary


@dataclass(frozen=True)
class Scene:
    """A robot with constraints; a frozen value that can be pickled and compared.

    Parameters
    ----------
    robot : Robot
    constraints : sequence of Constraint or pin.RigidConstraintModel
        Contacts and loops. Only these exist: the loops of the robot's description are in a scene
        if you put them there, ``Scene(robot, robot.loops)``. Pinocchio's own constraints become
        these, as in `from_pinocchio`.
    contacts : sequence of FrictionalContact, JointLimit, JointFriction or Cable
        Contacts that may open or slide. Rows, rank, states and assembly do not include them.

    Raises
    ------
    UnknownName
        If a frame does not exist.
    InvalidConstraint
        If two constraints share a name, or one constrains nothing.
    InvalidArgument
        If a contact does not fit the robot: both its sides on one body, a joint without limits.
    StaleModel
        If the robot's model was edited since it was loaded.
    """

    robot: Robot
    constraints: Sequence[Constraint] = ()
    contacts: Sequence[Contact] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise InvalidArgument(
                f"robot = {type(self.robot).__name__}: a Robot is needed; "
                "load_robot(name) loads one, Robot(name, model) wraps a pinocchio.Model"
            )
        if isinstance(self.constraints, Constraint):
            raise InvalidArgument(
                "constraints: a list is needed, also for a single constraint: Scene(robot, "
                f"[{self.constraints.name}])"
            )
        for field in ("constraints", "contacts"):
            value = getattr(self, field)
            if isinstance(value, str) or not isinstance(value, Iterable):
                raise InvalidArgument(f"{field} = {value!r}: a list is needed")
            object.__setattr__(self, field, tuple(value))
        self.robot.check_unedited()
        constraints = tuple(map(self._constraint, range(len(self.constraints)), self.constraints))
        object.__setattr__(self, "constraints", constraints)
        object.__setattr__(
            self, "contacts", tuple(with_joint_names(c, self.robot) for c in self.contacts)
        )
        object.__setattr__(self, "_bounds", bind(self.robot, self.constraints))
        object.__setattr__(self, "_contact_bounds", self._bound_contacts() if self.contacts else ())

    def _constraint(self, i: int, given: Any) -> Any:
        """Constraint i of the scene, with names for the numbers of joints."""
        if isinstance(given, pin.RigidConstraintModel):
            # imported here: few scenes have any
            from condyn_pin.constraints.rigid import rigid_constraint

            return rigid_constraint(self.robot, given, i)
        return with_joint_names(given, self.robot) if isinstance(given, Constraint) else given

    def _bound_contacts(self) -> tuple[BoundContact, ...]:
        # shapes and where they meet: most scenes have none
        from condyn_pin.constraints.contacts.kinds import bind_contacts

        return bind_contacts(self.robot, self.contacts, taken=self.names)

    @staticmethod
    def from_pinocchio(
        model: Any, constraint_models: Sequence[Any], contacts: Sequence[Contact] = ()
    ) -> Scene:
        """Return the scene of a Pinocchio model with its own constraints, in their order.

        M a + h = tau + J^T lambda_c,    J a + gamma = -Kd J v - Kp c,    c = -r or -log6(c1Mc2)

        are the equations of `pin.constraintDynamics`, and ``solution.forces[name]`` is its
        lambda_c: on the first joint, in the axes of the reference frame.

        Parameters
        ----------
        model : pin.Model
            The tree; the robot of the scene has its name.
        constraint_models : sequence of pin.RigidConstraintModel
            3D and 6D, LOCAL and LOCAL_WORLD_ALIGNED. One on a single body becomes a `PointContact`
            or a `SurfaceContact`, without an anchor if nothing says where: the second placement is
            the identity, and Kp = 0. The others become a `Loop`, ball or weld. Gains become their
            `drift`, a name theirs, or "constraint i".
        contacts : sequence of FrictionalContact, JointLimit, JointFriction or Cable
            As in `Scene`.

        Raises
        ------
        InvalidConstraint
            If a constraint has what `constraintDynamics` ignores, such as a desired acceleration;
            gains that differ from row to row, or are negative; a joint that the model lacks; or a
            joint that was changed after it was made, which Pinocchio 3.9 does not notice.
        InvalidModel
            If the model is unsound, as for a `Robot`.

        Notes
        -----
        Rows of LOCAL_WORLD_ALIGNED are those of LOCAL, turned. Where J v is not zero gamma of a 6D
        one is the derivative of its rows; Pinocchio leaves out a term there. If the world is the
        first joint of a 6D one that is open, the moment is about the frame on the body.
        """
        robot = Robot(getattr(model, "name", "") or "robot", model)
        return Scene(robot, constraint_models, contacts)

    @property
    def bounds(self) -> tuple[BoundConstraint, ...]:
        """The constraints bound to joints, placements and columns."""
        return self._bounds  # type: ignore[attr-defined, no-any-return]

    @property
    def contact_bounds(self) -> tuple[BoundContact, ...]:
        """The contacts bound to joints; `Candidates` evaluates them together."""
        return self._contact_bounds  # type: ignore[attr-defined, no-any-return]

    @cached_property
    def bilateral(self) -> Scene:
        """The scene without contacts: the scene itself if it has none."""
        if not self.contacts:
            return self
        bare = replace(self, contacts=())
        of = scene_without_time(self)
        return bare if of is self else scene_at(bare, of.bilateral)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the constraints, in order."""
        return tuple(bound.name for bound in self.bounds)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows: ``constraint.axis``."""
        return tuple(name for bound in self.bounds for name in bound.row_names)

    @property
    def rows(self) -> int:
        """Number of rows, m."""
        return sum(bound.size for bound in self.bounds)

    @cached_property
    def nominal(self) -> NominalAnalysis:
        """Rank, redundant rows and scales at the nominal state, each computed on first use."""
        if self.contacts:
            return self.bilateral.nominal
        of = scene_without_time(self)
        if of is not self:
            return of.nominal
        self.robot.check_unedited()
        return NominalAnalysis(self, Equations(self.robot.unedited, self.bounds))

    @cached_property
    def is_driven(self) -> bool:
        """True if some constraints follow a path of time (`Driven`)."""
        return any(constraint.is_rheonomic for constraint in self.constraints)

    def at(self, t: float) -> Scene:
        """Return the scene at a time [s], with driven constraints evaluated there.

        The scene itself if none is driven.
        """
        if not self.is_driven:
            return self
        placed = replace(self, constraints=tuple(each.at(t) for each in self.constraints))
        return scene_at(placed, self)

    def closed(self, modes: Mapping[str, Mode] | None = None) -> Scene:
        """Return the scene with its contacts as constraints, which never open.

        Points that stick are `PointContact`, balls `RollingBall`, and what slides `PlanarContact`,
        all where they are.

        Parameters
        ----------
        modes : mapping of str to {"open", "slide", "stick"}, optional
            Of candidates, by name; those that it leaves out are open. By default all shapes stick.

        Raises
        ------
        UnknownName
            If there is no such candidate.
        UnsupportedConstraint
            If no constraint holds one: a joint at its stop, or two bodies on each other.
        """
        from condyn_pin.constraints.contacts.kinds import held_contacts

        if not self.contacts:
            return self
        held = held_contacts(self.contacts, self.contact_bounds, modes)
        return replace(self, constraints=(*self.constraints, *held), contacts=())

    def summary(self, q: ArrayLike | None = None) -> Summary:
        """Return rows, rank, redundant rows by name, mobility, and what is not used.

        Everything is measured at q (nq,) [rad, m], or at the first posture with the loops closed.
        """
        from condyn_pin.mechanism.summary import summarise

        return summarise(self, q)

    def rank(self, q: ArrayLike | None = None) -> Rank:
        """Return rank, redundant rows, mobility and conditions at q; the nominal state by default.

        q (nq,) [rad, m] is taken as it is: `Rank.violation` says how far it is from being closed.
        """
        from condyn_pin.mechanism.rank import rank

        return rank(self, q)

    def symbolic(self) -> SymbolicScene:
        """Return M, h, J, gamma and the KKT system as formulas of SymPy, for small scenes.

        Joints are hinges, sliders, planes, balls and free-flyers, and rows all but those of your
        own functions and of universal joints. Needs SymPy: the extra ``symbolic``.

        Raises
        ------
        MissingExtra
            If SymPy is not installed.
        UnsupportedConstraint
            If a joint or a constraint has no formula, contacts may open, or rows are driven.

        Notes
        -----
        Seconds for a four-bar; formulas grow with the fourth power of the joints of a chain.
        """
        from condyn_pin.dynamics.symbolic import symbolic

        return symbolic(self)

    def state(
        self, posture: str | None = None, *, on_ground: bool | None = None
    ) -> tuple[Array, Array]:
        """Return (q, v) at a posture: closed, and at rest.

        Parameters
        ----------
        posture : str, optional
            Name of a posture; the first one by default, neutral if the robot has none.
        on_ground : bool, optional
            Whether the base is shifted until the lowest contact touches the ground, as
            `condyn_pin.mechanism.place_on_ground` does. By default only where no posture is named,
            and contacts of the scene have ground below them.

        Returns
        -------
        q : (nq,) array
            The posture [rad, m], moved as closing the loops needs; within the joint limits, if it
            is within them already and can be closed there; on its own side of the dead points, or
            else on that of the first posture.
        v : (nv,) array
            Zero; where constraints are driven, the smallest with J v = s' [rad/s, m/s].

        Raises
        ------
        UnknownName
            If there is no such posture.
        NotAssembled
            If the loops cannot be closed from there; the text says which one is open, and how far.
        InvalidArgument
            If `on_ground` is True and the contacts are constraints, which never open, or
            constraints tie the base to a place.
        """
        if on_ground not in (None, True, False):
            raise InvalidArgument(f"on_ground = {on_ground!r}: True, False or None is needed")
        q = self.closed_posture(posture)
        if on_ground or (on_ground is None and posture is None and self.contacts):
            q = self._on_ground(q, throw=bool(on_ground))
        if self.is_driven:
            from condyn_pin.mechanism.projection import project_velocity

            return q, project_velocity(self, q, np.zeros(self.robot.nv))
        return q, np.zeros(self.robot.nv)

    def _on_ground(self, q: Array, *, throw: bool) -> Array:
        from condyn_pin.mechanism.assembling import place_on_ground

        try:
            return place_on_ground(self, q)
        except InvalidArgument:
            if throw:
                raise
            return q

    def closed_posture(self, posture: str | None = None) -> Array:
        """The q (nq,) of `state` at a `posture` [rad, m]."""
        from condyn_pin.mechanism.assembling import assemble_posture

        self.robot.check_unedited()
        return assemble_posture(self, described_posture(self, posture)).q

    def assemble(
        self,
        q0: ArrayLike,
        *,
        fixed: Sequence[str] = (),
        within_limits: bool = True,
        branch: Mapping[str, int] | None = None,
        budget: int = 100,
        throw: bool = True,
    ) -> Assembly:
        """Close the loops from a guess: ``scene.assemble(q0).q``.

        Parameters
        ----------
        q0 : (nq,) array_like
            The guess [rad, m]; quaternions x y z w.
        fixed : sequence of str
            Joints that keep their value.
        within_limits : bool
            Keep the joints with finite limits inside them; a guess that is outside is moved to
            its limits first.
        branch : mapping of str to int, optional
            The branch to end on, that of an `Assembly`. By default the guess's own, also if the
            guess is far away; with ``{}`` any.
        budget : int
            What all attempts may take together, in ordinary closings: ten steps each. None begins
            after that, and the status is `out_of_budget`.
        throw : bool
            Raise if the status is not CLOSED. With False the same Assembly comes back, whatever its
            status.

        Returns
        -------
        Assembly
            Its `q` is closed; `branch` and `rank` say where.

        Raises
        ------
        NotAssembled
            If the loops stay open; its `assembly` ends at the smallest gap that was found.
        BranchChanged
            If they are closed on the other side of a dead point; its `assembly` is there.
        """
        from condyn_pin.mechanism.assembling import assemble

        return assemble(
            self,
            q0,
            fixed=fixed,
            within_limits=within_limits,
            branch=branch,
            budget=budget,
            throw=throw,
        )

    def sample(
        self,
        rng: np.random.Generator,
        *,
        spread: float = 0.2,
        speed: float = 1.0,
        tries: int = 50,
    ) -> tuple[Array, Array]:
        """Return a random (q, v) that satisfies the constraints.

        `rng`, `spread`, `speed`, `tries` and the errors are those of `condyn_pin.mechanism.sample`.
        """
        from condyn_pin.mechanism.projection import sample

        return sample(self, rng, spread=spread, speed=speed, tries=tries)

    def check(self, q: ArrayLike, v: ArrayLike | None = None) -> Check:
        """Return the gap of each loop at q (nq,), and the constraints that v (nv,) violates."""
        from condyn_pin.mechanism.rank import check

        return check(self, q, v)

    def lock(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene of the smaller robot in which some `joints` are held at `q`: exact.

        The arguments and errors are those of `condyn_pin.mechanism.lock`.
        """
        from condyn_pin.mechanism.reduction import lock

        return lock(self, joints, q)

    def minimal(
        self,
        *,
        error: float,
        motion: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None,
        watch: Sequence[str] | None = None,
        solver: Solver | None = None,
    ) -> Minimal:
        """Return a smaller scene that answers the same question within an `error`.

        `motion`, `watch`, `solver` and the errors are those of `condyn_pin.mechanism.minimal`.
        """
        from condyn_pin.mechanism.minimal_scene import minimal

        return minimal(self, error=error, motion=motion, watch=watch, solver=solver)

    def _repr_html_(self) -> str:
        """Return the scene as HTML for a notebook."""
        from condyn_pin.dynamics.solution import scene_html

        return scene_html(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self.robot, self.constraints, self.contacts)

    # members of the last version, most of them functions of a scene now
    as_planar = renamed("mechanism.as_planar")
    audit = renamed("nominal")
    chains = renamed("mechanism.closed_chains.chains_of", called=True)
    complete_state = renamed("mechanism.complete_state")
    guess = renamed("dynamics.described_posture")
    keep = renamed("mechanism.keep")
    merge_points = renamed("mechanism.merge_points")
    natives = renamed("dynamics.nominal.pinocchio_constraints_of", called=True)
    pinocchio_constraints = renamed("dynamics.nominal.pinocchio_constraints_of", called=True)
    project_acceleration = renamed("mechanism.project_acceleration")
    project_velocity = renamed("mechanism.project_velocity")
    rods_as_distances = renamed("mechanism.rods_as_distances")
    sample_batch = renamed("simulation.sample_batch")
    without = renamed("mechanism.without")
    without_bodies = renamed("mechanism.without_bodies")
    without_linkage = renamed("mechanism.without_linkage")


# What a verb refuses in a scene, before it begins: each check says what would do.


def check_scene(scene: object, argument: str = "scene") -> None:
    """Refuse what is no scene."""
    if not isinstance(scene, Scene):
        cure = ""
        if isinstance(scene, Robot):
            of = "Scene(robot, robot.loops)" if scene.loops else "Scene(robot, robot.contacts)"
            cure = f", the robot with the constraints that count: {of}"
        raise InvalidArgument(f"{argument} = {type(scene).__name__}: a Scene is needed{cure}")


def check_bilateral(scene: Scene) -> None:
    """Refuse contacts that may open where forces are solved for contacts that never do."""
    if scene.contacts:
        count = sum(len(bound.candidates) for bound in scene.contact_bounds)
        raise UnsupportedConstraint(
            f"{count_text(count, 'contact')} may open: step, its derivatives and simulate take "
            "them; scene.closed() is the scene that holds them"
        )


def check_time(scene: Scene) -> None:
    """Refuse driven constraints where nothing says at which time they are looked at."""
    if moving := [b.name for b in scene.bounds if b.drive and b.drive.time is None]:
        raise UnsupportedConstraint(
            f"{', '.join(moving)} follow{'s' * (len(moving) == 1)} a path of time: "
            "scene.at(t) is the scene at one; simulate takes it through all"
        )


def time_of(scene: Scene) -> float:
    """Return the time at which a scene is looked at [s]; 0 where nothing is driven."""
    check_time(scene)
    times = {b.drive.time or 0.0 for b in scene.bounds if b.drive} or {0.0}
    if len(times) > 1:
        raise UnsupportedConstraint(
            f"driven rows are at {', '.join(f'{t:g}' for t in sorted(times))} s: one time is "
            "needed, and scene.at(t) gives all of them the same"
        )
    return times.pop()


def check_at_all_times(scene: Scene, why: str) -> None:
    """Refuse driven constraints that stay at one time, where time goes on; `why` says what for."""
    if placed := [b.name for b in scene.bounds if b.drive and b.drive.time is not None]:
        raise InvalidArgument(
            f"scene: {', '.join(placed)} stays at one time, as scene.at(t) has it; {why}: pass the "
            "scene without at(t)"
        )


def check_not_driven(scene: Scene, what: str) -> None:
    """Refuse driven constraints where `what` needs J v = 0."""
    if moving := [b.name for b in scene.bounds if b.drive]:
        raise UnsupportedConstraint(
            f"{', '.join(moving)}: driven along a path, J v = s'(t), and {what} takes J v = 0; "
            "leave it out, or take its constraint without Driven"
        )


# The scenes that every robot brings by itself, for benchmarks, tests and the command line.


def standard_scenes(robot: Robot) -> dict[str, Scene]:
    """Return the scenes of a robot by label."""
    # Its loops alone; its loops with its ready-made contacts; and the same with each surface
    # replaced by its four corners.
    loops = tuple(robot.loops)
    scenes = {}
    if loops:
        scenes[f"{robot.name} loops"] = Scene(robot, loops)
    if robot.contacts:
        label = f"{robot.name} loops + contacts" if loops else f"{robot.name} contacts"
        scenes[label] = Scene(robot, (*loops, *robot.contacts))
    corners = _corners(robot)
    if corners != tuple(robot.contacts):
        scenes[f"{robot.name} corners"] = Scene(robot, (*loops, *corners))
    if not scenes:
        scenes[f"{robot.name} free"] = Scene(robot)
    return scenes


def _corners(robot: Robot) -> tuple[Constraint, ...]:
    found: list[Constraint] = []
    for contact in robot.contacts:
        flat = contact.support and contact.support.half_length and contact.support.half_width
        found.extend(contact.by_points(robot)[1] if flat else [contact])
    return tuple(found)


def motor_torque(robot: Robot, rng: np.random.Generator) -> Array:
    """Return random torques in the motors, a tenth of the robot's weight at one metre."""
    # Only in the motors: a torque of that size about the axis of a thin rod would spin it at a
    # million radians per second squared, and no error elsewhere would be seen beside that.
    tau = np.zeros(robot.nv)
    for name in robot.actuated:
        joint = robot.model.joints[robot.model.getJointId(name)]
        tau[joint.idx_v : joint.idx_v + joint.nv] = rng.normal(size=joint.nv)
    for motor in robot.coupled_motors:
        tau += rng.normal() * robot.joint_vector(motor.weights)
    return 0.1 * 9.81 * robot.mass * tau
