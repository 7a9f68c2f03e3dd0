"""Scene: a robot and exactly the constraints that the question needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

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
