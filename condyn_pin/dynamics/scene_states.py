"""The methods of a scene that return its states.

Each is found by a module of `mechanism`, which stands above: it is imported when it is called.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.errors import InvalidArgument, unknown_name

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.mechanism.assembly_report import Assembly
    from condyn_pin.mechanism.check import Check
    from condyn_pin.mechanism.completion import CompleteState
    from condyn_pin.mechanism.projection import Metric


class States:
    """The states that a scene allows; `Scene` is the only class of this kind."""

    @property
    def _scene(self) -> Scene:
        return cast("Scene", self)

    def guess(self, posture: str | None = None) -> Array:
        """Return a posture of the robot as it is in the description; neutral if it has none."""
        postures = self._scene.robot.postures
        if posture is None:
            q = next(iter(postures.values()), None)
            return np.array(pin.neutral(self._scene.robot.model) if q is None else q)
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
        self._scene.robot.check_unedited()
        from condyn_pin.mechanism.assembly import assemble_posture

        q = assemble_posture(self._scene, self.guess(posture)).q
        return q, np.zeros(self._scene.robot.nv)

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
            self._scene, q0, fixed=fixed, within_limits=within_limits, branch=branch, throw=throw
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

        return sample(self._scene, rng, spread, speed)

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

        return sample_batch(self._scene, n, rng, spread, speed, executor)

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

        return project_velocity(self._scene, q, v, metric)

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

        return project_acceleration(self._scene, q, v, a, metric)

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

        return complete_state(self._scene, q_actuated, v_actuated, near, within_limits)

    def check(self, q: ArrayLike, v: ArrayLike | None = None) -> Check:
        """Return how far each loop is open at q, and which constraints slip with v."""
        from condyn_pin.mechanism.check import check

        return check(self._scene, q, v)
