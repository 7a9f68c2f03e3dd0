"""InverseDynamics: motor torques and constraint forces that produce a motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import counted
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.control.actuation import Actuation
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce, Sites, pulling

# Torques are large where motors drive a direction this much more weakly than their strongest.
_WEAK = 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class InverseDynamics:
    """Motor torques and constraint forces that produce a motion.

    B u + J^T lam = M a + h - passive - sum J_f^T f

    Attributes
    ----------
    u : (k,) array
        Torques of the motors [N m, N], the smallest that do, of least sum of squares, or those that
        a `ForceDistribution` chose.
    lam : (m,) array
        Constraint forces, all rows, in the axes of each constraint [N, N m].
    a : (nv,) array
        The acceleration that results: the one asked for if the constraints allow it and the motors
        can make it, else the nearest in the metric of M.
    residual : (nv,) array
        Generalised force that is missing for the motion [N m, N], M a_wanted + h - passive -
        sum J_f^T f - B u - J^T lam with a_wanted the nearest that the constraints allow.
    projected : float
        max abs(J a + gamma) of the acceleration asked for [m/s^2, rad/s^2]: how far it is from
        what the constraints allow.
    rank : int
        Independent directions in which the motors drive the robot.
    mobility : int
        Directions that the constraints leave, nv minus their rank at q.
    weakest : float
        Of the directions that the motors drive, how weakly the weakest is driven: its singular
        value over the largest of L^-1 B [1]; 1 if they drive none.
    null_space : (k + m, d) array
        Internal forces: a basis of (u, lam) with B u + J^T lam = 0 [N m, N]. First the ways in
        which motors work against each other through the constraints, with orthonormal u; then
        forces of redundant rows alone.
    actuation : Actuation
    scene : Scene
    q : (nq,) array
        Configuration [rad, m].
    applied : tuple of AppliedForce
        The forces from outside that were applied.
    """

    u: Array
    lam: Array
    a: Array
    residual: Array
    projected: float  # [m/s^2, rad/s^2]
    rank: int
    mobility: int
    weakest: float
    null_space: Array
    actuation: Actuation
    scene: Scene
    q: Array
    applied: tuple[AppliedForce, ...] = ()

    @property
    def tau(self) -> Array:
        """B u (nv,): the joint torques that the motors give [N m, N], for `solve`."""
        return np.asarray(self.actuation.B @ self.u)

    @property
    def torques(self) -> dict[str, float]:
        """The torques of the motors by name [N m, N]."""
        return dict(zip(self.actuation.motors, self.u.tolist(), strict=True))

    @property
    def fully_actuated(self) -> bool:
        """Whether the motors can make every motion that the constraints allow."""
        return self.rank == self.mobility

    @property
    def forces(self) -> dict[str, ConstraintForce]:
        """The constraint forces by name, as those of a `Solution`."""
        return self._sites.forces(self.lam)

    @property
    def notices(self) -> tuple[str, ...]:
        """What deserves attention, a sentence each."""
        said = []
        floor = max(float(np.abs(self.a).max()), 1.0)
        if self.projected > tolerances.SOLVED * floor:
            said.append(
                f"the acceleration asked for breaks the constraints by {self.projected:.3g} m/s^2 "
                "or rad/s^2: the nearest that keeps them was taken"
            )
        missing = float(np.abs(self.residual).max())
        if missing > tolerances.SOLVED * max(float(np.abs(self.tau).max()), 1.0):
            said.append(
                f"the motors drive {self.rank} of {self.mobility} degrees of freedom: up to "
                f"{missing:.3g} N or N m are missing, and `a` is what comes out"
            )
        if self.weakest < _WEAK:
            said.append(
                f"the motors drive one direction {1 / self.weakest:.0f} times more weakly than "
                "another: the configuration is nearly singular, and torques are large"
            )
        return (*said, *pulling(self.forces, self._sites))

    @cached_property
    def _sites(self) -> Sites:
        return Sites(self.scene, self.q)

    def __repr__(self) -> str:
        motors, missing = counted(len(self.u), "motor"), np.abs(self.residual).max()
        return (
            f"InverseDynamics({self.scene.robot.name}: {motors} for {self.rank} of {self.mobility} "
            f"degrees of freedom, missing {missing:.1e})"
        )

    def __str__(self) -> str:
        lines = [repr(self), "torques of the motors [N m, N]:"]
        lines += [f"{name:<28} {value:.6g}" for name, value in self.torques.items()]
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)
