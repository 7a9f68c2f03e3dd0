"""Scene: a robot and exactly the constraints that the question needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, finite
from condyn_pin.assembly import assemble
from condyn_pin.audit import Audit, audit
from condyn_pin.binding import bind
from condyn_pin.bound import Bound, Coupled
from condyn_pin.constraints import Constraint
from condyn_pin.equations import Equations
from condyn_pin.errors import InvalidArgument, NotAssembled, unknown_name
from condyn_pin.minimum_norm import factorise
from condyn_pin.native import Natives, natives
from condyn_pin.robot import Robot
from condyn_pin.summary import Summary, summarise

if TYPE_CHECKING:
    from condyn_pin.minimal import Minimal
    from condyn_pin.reduction import ReducedScene
    from condyn_pin.solvers.base import Solver


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
    def bounds(self) -> tuple[Bound | Coupled, ...]:
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
    def natives(self) -> Natives:
        """The constraints as Pinocchio's own methods take them."""
        return natives(self.bounds)

    @cached_property
    def audit(self) -> Audit:
        """What the scene is at its nominal state; measured on first use."""
        return audit(self)

    def summary(self) -> Summary:
        """Return rows, rank, redundant rows by name, mobility, and what is not used.

        Everything is measured at the first posture with the loops closed.
        """
        return summarise(self)

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
            The posture, moved as little as closing the loops needs.
        v : (nv,) array
            Zero.

        Raises
        ------
        UnknownName
            If there is no such posture.
        NotAssembled
            If the loops cannot be closed from there; the text says which one is open, and how far.
        """
        q = self.assemble(self.guess(posture))
        return q, np.zeros(self.robot.nv)

    def assemble(self, q: ArrayLike, *, fixed: Sequence[str] = ()) -> Array:
        """Return a configuration near q that satisfies the constraints.

        Parameters
        ----------
        q : (nq,) array_like
            The guess.
        fixed : sequence of str
            Joints that keep their value.

        Raises
        ------
        NotAssembled
            If it cannot be closed from there.
        """
        self.robot.check_unedited()
        model = self.robot.model
        array = normalised(model, "q", q)
        equations = Equations(model, self.bounds)
        result = assemble(equations, array, moving=self._moving(fixed))
        if not result.closed:
            raise NotAssembled(
                f"{self._worst_gap(equations.violation(result.q))} after {result.iterations} "
                "iterations; start nearer to a closed configuration, or fix fewer joints"
            )
        return result.q

    def sample(
        self, rng: np.random.Generator, *, spread: float = 0.2, speed: float = 1.0
    ) -> tuple[Array, Array]:
        """Return a random (q, v) that satisfies the constraints.

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
            If none of 50 random guesses could be closed.
        """
        if not isinstance(rng, np.random.Generator):
            raise InvalidArgument(f"rng = {rng!r}: numpy.random.default_rng(seed) makes one")
        for name, value in (("spread", spread), ("speed", speed)):
            if not finite(name, value, ()) >= 0:
                raise InvalidArgument(f"{name} = {value!r}: a number >= 0 is needed")
        self.robot.check_unedited()
        model, nv = self.robot.model, self.robot.nv
        equations = Equations(model, self.bounds)
        for _ in range(50):
            guess = np.array(pin.integrate(model, self.audit.q, spread * rng.normal(size=nv)))
            result = assemble(equations, guess)
            if result.closed:
                terms = equations.terms(result.q, np.zeros(nv))
                factors = factorise(terms.M, terms.J, tolerances.RANK)
                return result.q, factors.tangent(speed * rng.normal(size=nv))
        raise NotAssembled(
            f"none of 50 random configurations within {spread} of the nominal one could be closed; "
            "use a smaller spread"
        )

    def lock(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene of the smaller robot in which some joints are held at q.

        Exact: it moves as this one does with the joints welded.

        Parameters
        ----------
        joints : sequence of str
            A free-flyer may be among them. Joints coupled to them are locked too.
        q : (nq,) array_like, optional
            Where; the nominal state by default. The other joints move as closing the loops needs;
            the closed configuration is the first posture of the smaller robot, ``locked``.

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
        from condyn_pin.reduction import lock

        return lock(self, joints, q)

    def keep(self, joints: Sequence[str], q: ArrayLike | None = None) -> ReducedScene:
        """Return the scene with all but some joints locked, as by `lock`.

        A free-flyer is kept without being named; `lock` holds it.
        """
        from condyn_pin.reduction import keep

        return keep(self, joints, q)

    def without(self, names: Sequence[str]) -> ReducedScene:
        """Return the scene without some of its constraints."""
        from condyn_pin.reduction import without

        return without(self, names)

    def without_bodies(self, joints: Sequence[str]) -> ReducedScene:
        """Return the scene without the bodies that hang on some joints, their mass included.

        What hangs on these bodies goes with them, and the constraints that are fixed to them.
        """
        from condyn_pin.reduction import without_bodies

        return without_bodies(self, joints)

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
        from condyn_pin.rods import rods_as_distances

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
        from condyn_pin.linkages import without_linkage

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
            (`condyn_pin.price`).
        motion : sequence of (q, v, tau), optional
            Closed states that matter; random ones by default, in which every joint moves.
        watch : sequence of str, optional
            Joints whose accelerations are asked for; by default the floating base and the motors
            that the motion moves, or all that it moves if it moves neither.
        solver : Solver, optional
            What has to take the smaller scene, and is timed; `Proximal()` by default, which takes
            neither distances nor planar pins.

        Returns
        -------
        Minimal
            The scene, sizes and times before and after, the errors, and every step in words.
        """
        from condyn_pin.minimal import minimal

        return minimal(self, error=error, motion=motion, watch=watch, solver=solver)

    def _moving(self, fixed: Sequence[str]) -> list[int] | None:
        model = self.robot.model
        if isinstance(fixed, str) or not isinstance(fixed, Iterable):
            raise InvalidArgument(f"fixed = {fixed!r}: a list of names of joints is needed")
        held: set[int] = set()
        for name in fixed:
            if not isinstance(name, str):
                raise InvalidArgument(f"fixed: {name!r} is not the name of a joint")
            if not model.existJointName(name):
                raise unknown_name("joint", name, self.robot.joints)
            joint = model.joints[model.getJointId(name)]
            held.update(range(joint.idx_v, joint.idx_v + joint.nv))
        return [i for i in range(self.robot.nv) if i not in held] if held else None

    def _worst_gap(self, c: Array) -> str:
        gaps = {b.name: float(np.abs(c[b.rows]).max()) for b in self.bounds}
        name = max(gaps, key=gaps.__getitem__)
        return f"{name} is open by {gaps[name]:.3g} m or rad"

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene, (self.robot, self.constraints)
