"""Scene: a robot and exactly the constraints that the question needs.

A solve needs no more of it than what is bound, and `audit`. What a mechanism is, which states it
allows and what can be left out of it is asked for by methods that `condyn_pin.mechanism` answers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.renamed import renamed
from condyn_pin.constraints.constraints import Constraint
from condyn_pin.constraints.rows.binding import bind
from condyn_pin.constraints.rows.bound import AnyBound
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.pinocchio_constraints import (
    PinocchioConstraints,
    pinocchio_constraints,
)
from condyn_pin.dynamics.nominal import NominalAnalysis
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.model.robot import Robot

if TYPE_CHECKING:
    from condyn_pin.dynamics.solvers.base import Solver
    from condyn_pin.mechanism.assembly import Assembly
    from condyn_pin.mechanism.check import Check
    from condyn_pin.mechanism.closed_chains import ClosedChains
    from condyn_pin.mechanism.completion import CompleteState
    from condyn_pin.mechanism.projection import Metric
    from condyn_pin.mechanism.rank import Rank
    from condyn_pin.mechanism.reduction.minimal_report import Minimal
    from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene
    from condyn_pin.mechanism.summary import Summary


@dataclass(frozen=True)
class Scene:
    """A robot with constraints; a frozen value that pickles and compares.

    Parameters
    ----------
    robot : Robot
    constraints : sequence of Constraint
        Contacts and loops. Only these exist: the loops of the robot's description are in a scene
        if you put them there, ``Scene(robot, robot.loops)``.

    Raises
    ------
    UnknownName
        If a frame does not exist.
    InvalidConstraint
        If two constraints share a name, or one constrains nothing.
    StaleModel
        If the robot's model was edited since it was loaded.
    """

    robot: Robot
    constraints: Sequence[Constraint] = ()

    audit = renamed("nominal")

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise InvalidArgument(
                f"robot = {type(self.robot).__name__}: a Robot is needed; "
                "load_robot(name) loads one, Robot(name, model) wraps a pinocchio.Model"
            )
        if isinstance(self.constraints, Constraint):
            raise InvalidArgument("constraints: a list is needed, also for a single constraint")
        if isinstance(self.constraints, str) or not isinstance(self.constraints, Iterable):
            raise InvalidArgument(f"constraints = {self.constraints!r}: a list is needed")
        self.robot.check_unedited()
        object.__setattr__(self, "constraints", tuple(self.constraints))
        object.__setattr__(self, "_bounds", bind(self.robot, self.constraints))

    @property
    def bounds(self) -> tuple[AnyBound, ...]:
        """The constraints bound to joints, placements and columns."""
        return self._bounds  # type: ignore[attr-defined, no-any-return]

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
    def chains(self) -> ClosedChains:
        """Which joints the loops determine, and where their dead points are; found on first use."""
        from condyn_pin.mechanism.closed_chains import chains

        return read_only(chains(self))

    @cached_property
    def pinocchio_constraints(self) -> PinocchioConstraints:
        """The constraints as Pinocchio's own methods take them."""
        return pinocchio_constraints(
            self.robot.model, self.bounds, lambda: self.nominal.whitened_rows()
        )

    @cached_property
    def nominal(self) -> NominalAnalysis:
        """What the scene is at its nominal state; each figure is measured on first use."""
        return NominalAnalysis(self, Equations(self.robot.unedited, self.bounds))

    def summary(self, q: ArrayLike | None = None) -> Summary:
        """Return rows, rank, redundant rows by name, mobility, and what is not used.

        Everything is measured at q, or at the first posture with the loops closed.
        """
        from condyn_pin.mechanism.summary import summarise

        return summarise(self, q)

    def rank(self, q: ArrayLike | None = None) -> Rank:
        """Return rank, redundant rows, mobility and conditions at q; the nominal state by default.

        q is taken as it is: `Rank.violation` says how far it is from being closed.
        """
        from condyn_pin.mechanism.rank import rank

        return rank(self, q)

    def guess(self, posture: str | None = None) -> Array:
        """Return a posture of the robot as it is in the description; neutral if it has none."""
        postures = self.robot.postures
        if posture is None:
            q = next(iter(postures.values()), None)
            return np.array(pin.neutral(self.robot.model) if q is None else q)
        if not isinstance(posture, str):
            raise InvalidArgument(f"posture = {posture!r}: the name of a posture is needed")
        if posture not in postures:
            raise unknown_name("posture", posture, postures)
        return np.array(postures[posture])

    def state(self, posture: str | None = None) -> tuple[Array, Array]:
        """Return (q, v) at a posture: closed, and at rest.

        Parameters
        ----------
        posture : str, optional
            Name of a posture; the first one by default, neutral if the robot has none.

        Returns
        -------
        q : (nq,) array
            The posture, moved as closing the loops needs; within the joint limits, if it is within
            them already and can be closed there; on its own side of the dead points, or else on
            that of the first posture.
        v : (nv,) array
            Zero.

        Raises
        ------
        UnknownName
            If there is no such posture.
        NotAssembled
            If the loops cannot be closed from there; the text says which one is open, and how far.
        """
        from condyn_pin.mechanism.assembly import assemble_posture

        self.robot.check_unedited()
        q = assemble_posture(self, self.guess(posture)).q
        return q, np.zeros(self.robot.nv)

    def assemble(
        self,
        q0: ArrayLike,
        *,
        fixed: Sequence[str] = (),
        within_limits: bool = True,
        branch: Mapping[str, int] | None = None,
        throw: bool = True,
    ) -> Assembly:
        """Close the loops from a guess: ``scene.assemble(q0).q``.

        Parameters
        ----------
        q0 : (nq,) array_like
            The guess.
        fixed : sequence of str
            Joints that keep their value.
        within_limits : bool
            Keep the joints with finite limits inside them; a guess that is outside is moved to
            its limits first.
        branch : mapping of str to int, optional
            The branch to end on, that of an `Assembly`. By default the guess's own, also if the
            guess is far away; with ``{}`` any.
        throw : bool
            Raise if the status is not CLOSED. With False the same Assembly comes back, whatever its
            status.

        Raises
        ------
        NotAssembled
            If the loops stay open; its `assembly` ends at the smallest gap that was found.
        BranchChanged
            If they are closed on the other side of a dead point; its `assembly` is there.
        """
        from condyn_pin.mechanism.assembly import assemble

        return assemble(
            self, q0, fixed=fixed, within_limits=within_limits, branch=branch, throw=throw
        )

    def sample(
        self, rng: np.random.Generator, *, spread: float = 0.2, speed: float = 1.0
    ) -> tuple[Array, Array]:
        """Return a random (q, v) that satisfies the constraints.

        It is on the branch of the first posture, and within the joint limits if that is.

        Parameters
        ----------
        rng : numpy.random.Generator
            The source of randomness; the same generator gives the same states.
        spread : float
            Standard deviation of each joint about the nominal state, before closing [rad, m].
        speed : float
            Standard deviation of each velocity, before projection to J v = 0 [rad/s, m/s].

        Raises
        ------
        NotAssembled
            If the loops cannot be closed at the nominal state, or from none of 50 random guesses.
        """
        from condyn_pin.mechanism.sampling import sample

        return sample(self, rng, spread, speed)

    def sample_batch(
        self,
        n: int,
        rng: np.random.Generator,
        *,
        spread: float = 0.2,
        speed: float = 1.0,
        executor: Executor | None = None,
    ) -> tuple[Array, Array]:
        """Return n random states that satisfy the constraints, a row each.

        Row i is ``sample(rng.spawn(n)[i])``: each state has a stream of its own, so that the states
        do not depend on who draws them. A second call with the same generator gives others.

        Parameters
        ----------
        n : int
        rng : numpy.random.Generator
            The source of randomness, made from a seed.
        spread, speed
            As in `sample`.
        executor : Executor, optional
            Who does the work, as in `solve_batch`; this process by default.

        Returns
        -------
        Q : (n, nq) array
        V : (n, nv) array

        Raises
        ------
        InvalidArgument
            If an argument is none of these.
        NotAssembled
            As in `sample`, for any of the states.
        WorkersLost
            As in `solve_batch`.
        """
        from condyn_pin.simulation.batch.sampling import sample_batch

        return sample_batch(self, n, rng, spread, speed, executor)

    def project_velocity(self, q: ArrayLike, v: ArrayLike, *, metric: Metric = "mass") -> Array:
        """Return the velocity nearest to v with J v = 0.

        Parameters
        ----------
        q : (nq,) array_like
            A closed configuration.
        v : (nv,) array_like
        metric : {"mass", "euclidean"}
            What near means: kinetic energy of the difference, or its squares in rad/s and m/s.

        Raises
        ------
        NotAssembled
            If a loop is open by more than 1e-4 m or rad, or by less but no velocity satisfies its
            rows there; the text names it.
        """
        from condyn_pin.mechanism.projection import project_velocity

        return project_velocity(self, q, v, metric)

    def project_acceleration(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, metric: Metric = "mass"
    ) -> Array:
        """Return the acceleration nearest to a with J a + gamma(q, v) = 0.

        Parameters
        ----------
        q : (nq,) array_like
            A closed configuration.
        v : (nv,) array_like
            A velocity with J v = 0.
        a : (nv,) array_like
        metric : {"mass", "euclidean"}
            With "mass", and a the unconstrained acceleration, this is Gauss's principle.

        Raises
        ------
        NotAssembled
            As `project_velocity`; also if v does not fit and no acceleration satisfies its rows.
        """
        from condyn_pin.mechanism.projection import project_acceleration

        return project_acceleration(self, q, v, a, metric)

    def complete_state(
        self,
        q_actuated: ArrayLike,
        v_actuated: ArrayLike | None = None,
        *,
        near: ArrayLike | None = None,
        within_limits: bool = True,
    ) -> CompleteState:
        """Return the whole state from that of the motors, as their encoders measure it.

        Parameters
        ----------
        q_actuated : array_like
            Positions of the actuated joints, in the order of ``robot.actuated``.
        v_actuated : array_like, optional
            Their velocities; at rest by default.
        near : (nq,) array_like, optional
            Where everything starts that the motors do not determine, and stays if the loops do not
            either: a floating base, springs, the spin of a rod. The nominal state by default. The
            motors are followed from there, in a straight line of their coordinates and in strides
            of 0.1 rad or less, so that its branch is kept.
        within_limits : bool
            Refuse motors outside their limits, and those that take another joint out of its.

        Raises
        ------
        InvalidArgument
            If a motor is outside its limits, or the robot has none.
        NotAssembled
            If the loops cannot be closed with the motors there, or only beyond joint limits.
        BranchChanged
            If a dead point lies on the way, whether or not the loops close beyond it.
        """
        from condyn_pin.mechanism.completion import complete_state

        return complete_state(self, q_actuated, v_actuated, near, within_limits)

    def check(self, q: ArrayLike, v: ArrayLike | None = None) -> Check:
        """Return how far each loop is open at q, and which constraints slip with v."""
        from condyn_pin.mechanism.check import check

        return check(self, q, v)

    def lock(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene of the smaller robot in which some joints are held at q.

        Exact: it moves as this one does with the joints welded.

        Parameters
        ----------
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
        NotAssembled
            If the loops cannot be closed with the joints there.
        """
        from condyn_pin.mechanism.reduction.reduction import lock

        return lock(self, joints, q)

    def keep(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene with all but some joints locked, as by `lock`.

        A free-flyer is kept without being named; `lock` holds it.
        """
        from condyn_pin.mechanism.reduction.reduction import keep

        return keep(self, joints, q)

    def without(self, names: Sequence[str]) -> ReducedScene:
        """Return the scene without some of its constraints, given by their names."""
        from condyn_pin.mechanism.reduction.reduction import without

        return without(self, names)

    def without_bodies(self, joints: Sequence[str]) -> ReducedScene:
        """Return the scene without the bodies that hang on some joints, their mass included.

        What hangs on these bodies goes with them, and the constraints that are fixed to them.
        """
        from condyn_pin.mechanism.reduction.reduction import without_bodies

        return without_bodies(self, joints)

    def merge_points(self, *, edges: bool = True) -> ReducedScene:
        """Return the scene with the points on each frame merged into an edge or a surface: exact.

        Only points without an anchor: they say nothing about where the body is, so nothing is lost.
        The merged contact has the name of the frame, or ``frame/edge``, an edge being on a new
        frame; with a number behind it if that name is another's.

        Parameters
        ----------
        edges : bool
            Merge points on a line too. Solvers that know no edges make two points of it again.
        """
        from condyn_pin.mechanism.reduction.fewer_rows import merge_points

        return merge_points(self, edges=edges)

    def as_planar(self, name: str) -> ReducedScene:
        """Return the scene in which a ball loop says nothing across the plane of its linkage.

        Exact: of the three rows of such a ball, two are independent.

        Parameters
        ----------
        name : str
            Of the loop.

        Raises
        ------
        UnknownName
            If there is no such constraint.
        InvalidConstraint
            If the loop is no ball, or its rows have another rank than 2.
        """
        from condyn_pin.mechanism.reduction.fewer_rows import as_planar

        return as_planar(self, name)

    def rods_as_distances(
        self, joints: Sequence[str], *, mass: Literal["ends", "drop"] = "ends"
    ) -> ReducedScene:
        """Return the scene in which rods are one row each: the distance of their two ends.

        Parameters
        ----------
        joints : sequence of str
            The joints on which the rods hang: balls, or hinges of a planar linkage. Each rod ends
            a branch, and one loop of kind ball or planar ties its other end.
        mass : {"ends", "drop"}
            Whether a rod's mass is shared by its two ends, so that total mass and centre of mass
            along the rod stay, or dropped.

        Raises
        ------
        InvalidArgument
            If a body is no rod; the text says why.
        InvalidConstraint
            If a rod does more than keep a distance: without it the mobility is another.
        """
        from condyn_pin.mechanism.reduction.rods import rods_as_distances

        return rods_as_distances(self, joints, mass=mass)

    def without_linkage(self, loops: Sequence[str], joints: Sequence[str]) -> ReducedScene:
        """Return the scene without a linkage that only follows another joint.

        Its loops are left out and its bodies welded at the nominal state; their inertia and damping
        are reflected onto the joints that they followed, as armature and damping.

        Parameters
        ----------
        loops : sequence of str
            Names of constraints.
        joints : sequence of str
            The joints of the linkage.

        Raises
        ------
        InvalidArgument
            If a motor or a spring acts on one of the joints.
        InvalidConstraint
            If the loops also hold other joints than these.
        """
        from condyn_pin.mechanism.reduction.linkages import without_linkage

        return without_linkage(self, loops, joints)

    def minimal(
        self,
        *,
        error: float,
        motion: Sequence[tuple[ArrayLike, ArrayLike, ArrayLike]] | None = None,
        watch: Sequence[str] | None = None,
        solver: Solver | None = None,
    ) -> Minimal:
        """Return a smaller scene that answers the same question within an error.

        Tried in this order, each kept if the errors stay within the limit: joints that do not move
        are locked, points of contact merged, implied constraints left out, linkages that only
        follow reflected onto what they follow, rods replaced by distances, balls of planar
        linkages by planar pins.

        Parameters
        ----------
        error : float
            Largest relative error of accelerations and contact wrench that is allowed
            (`condyn_pin.mechanism.reduction.price`). Zero allows only what is exact, to 1e-9.
        motion : sequence of (q, v, tau), optional
            Closed states that matter, by which everything is judged. By default random ones, in
            which every joint moves: some to choose by, 50 others to judge by.
        watch : sequence of str, optional
            Joints whose accelerations are asked for; by default the floating base and the motors
            that the motion moves, or all that it moves if it moves neither.
        solver : Solver, optional
            What has to take the smaller scene, and is timed; by default that of `solve`. Proximal()
            takes neither distances nor planar pins, DenseKKT() does.

        Returns
        -------
        Minimal
            The scene, sizes and times before and after, the errors, and every step in words.

        Raises
        ------
        NotAssembled
            If a state of the motion is not on the constraints; the text says which.
        """
        from condyn_pin.mechanism.reduction.minimal import minimal

        return minimal(self, error=error, motion=motion, watch=watch, solver=solver)

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self.robot, self.constraints)


def check_scene(scene: object, argument: str = "scene") -> None:
    """Refuse what is no scene."""
    if not isinstance(scene, Scene):
        raise InvalidArgument(f"{argument} = {type(scene).__name__}: a Scene is needed")
