"""Springs and dampers, in joints and between frames.

Springs: on a joint, and between two frames; `Robot.passive_torque` applies them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import whole_data
from condyn_pin._core.threads import ThreadCache
from condyn_pin.constraints.constraint import check_size
from condyn_pin.constraints.forces import frame_jacobian
from condyn_pin.constraints.places import FrameLike, set_frames, short_frames
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class Spring:
    """A linear spring on a joint: tau = -stiffness (q - reference).

    Parameters
    ----------
    joint : str
        A joint with one degree of freedom.
    stiffness : float
        [N m/rad] or [N/m].
    reference : float
        Where it is relaxed [rad or m].

    Raises
    ------
    InvalidArgument
        If a number is not finite, or the joint is no name.
    """

    joint: str
    stiffness: float  # [N m/rad] or [N/m]
    reference: float = 0.0  # [rad] or [m]

    def __post_init__(self) -> None:
        if not isinstance(self.joint, str) or not self.joint:
            raise InvalidArgument(f"joint = {self.joint!r}: the name of a joint is needed")
        for argument in ("stiffness", "reference"):
            finite(argument, getattr(self, argument), ())


@dataclass(frozen=True)
class SpringDamper:
    """A spring and a damper in parallel, between the origins of two frames.

    f = stiffness (l - rest_length) + damping l'

    with l the distance of the origins: f > 0 pulls the two bodies towards each other, each at the
    origin of its frame. If the origins coincide there is no direction and no force. Near there the
    direction changes from one step to the next, so to hold two points together use a `Loop`.

    Parameters
    ----------
    frame_a, frame_b : str, (joint, pin.SE3) or pin.Frame
        Frames of two bodies, or one of a body and one of the world.
    stiffness : float
        Stiffness [N/m].
    damping : float
        Damping along the line between the frames [N s/m].
    rest_length : float
        Where it is relaxed [m].

    Raises
    ------
    InvalidArgument
        If a number is negative or not finite, or the frames are no two names.
    """

    frame_a: FrameLike
    frame_b: FrameLike
    stiffness: float  # [N/m]
    damping: float = 0.0  # [N s/m]
    rest_length: float = 0.0  # [m]

    def __post_init__(self) -> None:
        set_frames(self, "frame_a", "frame_b")
        if self.frame_a == self.frame_b:
            raise InvalidArgument(
                f"frame_b = {self.frame_b!r} is frame_a too: a frame of another body is needed"
            )
        for argument in ("stiffness", "damping", "rest_length"):
            value = getattr(self, argument)
            if not finite(argument, value, ()) >= 0:
                raise InvalidArgument(f"{argument} = {value!r}: zero or more is needed")
            check_size(argument, float(value))


# The spring-dampers of a robot bound to its model: lengths, torques, energies, stiffness.
#
# With r the way from the origin of frame a to that of frame b, in the axes of the world, r' = J v,
# and n = r / l of the length l,
#
#     f = k (l - l0) + c n . r',    tau = -J^T n f,    E = 1/2 k (l - l0)^2.
#
# Moved by dr, the force changes by K3 dr + D3 dr',
#
#     K3 = k n n^T + max(k (1 - l0 / l), 0) (1 - n n^T),    D3 = c n n^T,
#
# and tau by J^T of that: the part of the stiffness that holds its ends, and none of what pushes
# them apart, so that implicit methods add nothing negative to M.


_ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

# Origins that are nearer coincide: what is left of their distance is rounding [m].
_COINCIDE: Final = 1e-12

# Directions of a spring-damper less stiff than this, relative to its stiffest, are left out.
_SLACK: Final = 1e-12


class Stretch(NamedTuple):
    """Lengths, directions and Jacobians of the spring-dampers at one configuration."""

    length: Array  # (s,) [m]
    n: Array  # (s, 3), from a to b; zero where the ends coincide
    J: Array  # (s, 3, nv), of the way from a to b


class SpringDampers:
    """Spring-dampers of one robot, and the memory to evaluate them.

    springs, damping: whether they pull, and whether they damp
    """

    def __init__(
        self,
        robot: Robot,
        chosen: Sequence[SpringDamper],
        *,
        springs: bool = True,
        damping: bool = True,
    ) -> None:
        self._model = robot.unedited
        self._data = whole_data(self._model)
        self._ends = [(robot.frame(each.frame_a), robot.frame(each.frame_b)) for each in chosen]
        self.names = tuple(
            f"{short_frames(each.frame_a)} - {short_frames(each.frame_b)}" for each in chosen
        )
        self.k = np.array([each.stiffness * springs for each in chosen], dtype=float)
        self.c = np.array([each.damping * damping for each in chosen], dtype=float)
        self.rest = np.array([each.rest_length for each in chosen], dtype=float)

    def stretch(self, q: Array) -> Stretch:
        """Lengths, directions and Jacobians at q."""
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, q)
        r, J = np.zeros((len(self.k), 3)), np.zeros((len(self.k), 3, model.nv))
        for i, ends in enumerate(self._ends):
            for sign, (joint, placement) in zip((-1.0, 1.0), ends, strict=True):
                r[i] += sign * (data.oMi[joint] * placement).translation
                if joint:
                    J[i] += sign * frame_jacobian(model, data, joint, placement, _ALIGNED)[:3]
        length = np.linalg.norm(r, axis=1)
        apart = length > _COINCIDE
        n = np.where(apart, 1.0, 0.0)[:, None] * r / np.where(apart, length, 1.0)[:, None]
        return Stretch(length, n, J)

    def torque(self, q: Array, v: Array, dt: float = 0.0) -> Array:
        """Torques (nv,) [N, N m]; with dt the explicit part of an implicit step of that size."""
        at = self.stretch(q)
        rate = at.J @ v
        along = np.einsum("sj,sj->s", at.n, rate)
        force = (self.k * (at.length - self.rest) + self.c * along)[:, None] * at.n
        if dt:
            force = force + dt * np.einsum("sij,sj->si", self._stiffness(at), rate)
        return np.asarray(-np.einsum("sin,si->n", at.J, force))

    def energy(self, q: Array) -> Array:
        """Energy of the springs at configurations q (..., nq) [J]."""
        length = np.array([self.stretch(each).length for each in q.reshape(-1, q.shape[-1])])
        return np.asarray(0.5 * (length - self.rest) ** 2 @ self.k).reshape(q.shape[:-1])

    def dissipation(self, q: Array, v: Array) -> Array:
        """Power of the dampers at states q (k, nq), v (k, nv), (k,) [W]."""
        power = np.zeros(len(q))
        if self.c.any():
            for i in range(len(q)):
                at = self.stretch(q[i])
                power[i] = np.einsum("sj,sj->s", at.n, at.J @ v[i]) ** 2 @ self.c
        return power

    def stiffness(self, q: Array) -> Array:
        """Stiffness matrix K (nv, nv), symmetric and positive semidefinite."""
        at = self.stretch(q)
        K3 = self._stiffness(at)
        return np.asarray(np.einsum("sin,sij,sjm->nm", at.J, K3, at.J, optimize=True))

    def damping(self, q: Array) -> Array:
        """Damping matrix D (nv, nv), symmetric and positive semidefinite."""
        rows = self.damping_rows(q)
        return rows.T @ rows

    def damping_rows(self, q: Array) -> Array:
        """Return sqrt(c) n^T J (s, nv): D is the product of their transpose with them."""
        at = self.stretch(q)
        return np.asarray(np.sqrt(self.c)[:, None] * np.einsum("si,sin->sn", at.n, at.J))

    def inertia_rows(self, q: Array, dt: float) -> tuple[Array, Array]:
        """Return rows U (r, nv) and weights w (r,) with dt D + dt^2 K = U^T w U."""
        at = self.stretch(q)
        along = np.einsum("s,si,sj->sij", self.c, at.n, at.n)
        weights, axes = np.linalg.eigh(dt * along + dt**2 * self._stiffness(at))
        kept = weights > _SLACK * weights[:, -1:]
        rows = np.einsum("sij,sin->sjn", axes, at.J)
        return rows[kept], weights[kept]

    def _stiffness(self, at: Stretch) -> Array:
        """Stiffness K3 (s, 3, 3) of each spring between its ends."""
        along = np.einsum("si,sj->sij", at.n, at.n)
        share = 1 - self.rest / np.maximum(at.length, _COINCIDE)
        across = (self.k * np.maximum(share, 0.0))[:, None, None] * (np.eye(3) - along)
        return np.asarray(self.k[:, None, None] * along + across)


# Their memory takes longer to make than to use.
_kept = ThreadCache[SpringDampers]()


def spring_dampers_of(robot: Any) -> SpringDampers:
    """Return this thread's spring-dampers of a robot: earlier ones, or new ones."""
    return _kept.of(robot, None, lambda: SpringDampers(robot, robot.spring_dampers))
