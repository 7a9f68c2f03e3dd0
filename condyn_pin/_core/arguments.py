"""What users hand in: sizes, finiteness, unit quaternions."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from struct import Struct
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidArgument, InvalidModel

Given = tuple[ArrayLike, ArrayLike, ArrayLike]  # q, v and tau as they are handed in
State = tuple[Array, Array, Array]  # and as they are accepted

# Limits of the squared norm of a unit part of q.
LOW: Final = 1.0 - 2 * tolerances.QUATERNION
HIGH: Final = 1.0 + 2 * tolerances.QUATERNION

# | |quaternion| - 1 | from which on a quaternion is normalised before it is used. Accelerations of
# light bodies are off by hundreds of times as much; float32 leaves 1e-8, integration 1e-16.
LOOSE: Final = 1e-12
NOT_LOOSE: Final = (1.0 - 2 * LOOSE, 1.0 + 2 * LOOSE)

# | |quaternion| - 1 | that normalising a quaternion leaves.
NORMALISED: Final = 4 * float(np.finfo(float).eps)

# The one dtype that goes to Pinocchio as it is: 64 bits in the byte order of this machine. An array
# that was pickled comes back with another object for it: compare with ==, never with `is`.
FLOAT: Final = np.dtype(np.float64)

# Reads a quaternion out of a contiguous q twice as fast as a slice does; ValueError otherwise.
unpack_quaternion: Final[Callable[[Any, int], tuple[float, ...]]] = Struct("4d").unpack_from

# Where the unit part of a joint's configuration begins, and its size.
_UNIT_PARTS = {
    "JointModelFreeFlyer": (3, 4),
    "JointModelSpherical": (0, 4),
    "JointModelPlanar": (2, 2),
    "JointModelRUBX": (0, 2),
    "JointModelRUBY": (0, 2),
    "JointModelRUBZ": (0, 2),
    "JointModelRevoluteUnboundedUnaligned": (0, 2),
}


class Arguments:
    """The check of (q, v, tau) for one model.

    Attributes
    ----------
    quaternions : tuple of int
        Where q holds quaternions [bytes from its start].
    pairs : tuple of slice
        Where q holds (cos, sin).
    units : tuple of slice
        Where q holds either.
    roots : tuple of int
        Where v begins for each joint on the world: what is not finite in the input shows there.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        self._shapes = ((model.nq,), (model.nv,), (model.nv,))
        self.units = _unit_parts(model)
        self.quaternions = tuple(
            FLOAT.itemsize * part.start for part in self.units if part.stop - part.start == 4
        )
        self.pairs = tuple(part for part in self.units if part.stop - part.start == 2)
        on_world = [*zip(model.idx_vs, model.parents, strict=True)][1:]  # but for the world itself
        self.roots = tuple(int(v) for v, parent in on_world if parent == 0 and v >= 0)

    def check_pairs(self, q: Array) -> None:
        """Raise ValueError if a (cos, sin) of q is not a unit vector."""
        for part in self.pairs:
            cos, sin = q[part].tolist()
            if not LOW < cos * cos + sin * sin < HIGH:
                raise ValueError

    def accept(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> State:
        """Return the arguments as float arrays of the right size, or raise InvalidArgument.

        Arrays that are right already pass in half a microsecond, without a look at their
        finiteness: what is not finite shows in the answer, and `check` then finds it.
        """
        if (
            type(q) is np.ndarray
            and type(v) is np.ndarray
            and type(tau) is np.ndarray
            and self._shapes == (q.shape, v.shape, tau.shape)
            and q.dtype == v.dtype == tau.dtype == FLOAT
            and q.flags.c_contiguous
            and not self.pairs
        ):
            for offset in self.quaternions:
                x, y, z, w = unpack_quaternion(q, offset)
                if not LOW < x * x + y * y + z * z + w * w < HIGH:
                    break
            else:
                return q, v, tau
        return self.check(q, v, tau)

    def check(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> State:
        """Return the arguments converted, after looking at every number of them.

        Raises
        ------
        InvalidArgument
            Naming the argument, the entry and its value, and what would do.
        """
        (nq,), (nv,), _ = self._shapes
        q_ = finite("q", q, nq)
        self._check_units("q", q_)
        return q_, finite("v", v, nv), joint_torques("tau", tau, nv)

    def configuration(self, name: str, q: ArrayLike) -> Array:
        """Return the q of a state that a user handed in, normalised to rounding.

        InvalidArgument if its quaternions are further from norm 1 than `check` allows.
        """
        array = np.array(finite(name, q, self._model.nq))
        if pin.isNormalized(self._model, array, NORMALISED):
            return array
        self._check_units(name, array)
        return np.array(pin.normalize(self._model, array))

    def _check_units(self, name: str, q: Array) -> None:
        for part in self.units:
            x = q[part]
            norm = hypot(*x)
            if not LOW < norm * norm < HIGH:
                raise not_of_norm_one(name, f"{part.start}:{part.stop}", x, norm)


def not_of_norm_one(name: str, at: str, x: Array, norm: float, row: str = "") -> InvalidArgument:
    """Return the error of a quaternion, or a (cos, sin), in a state."""
    index = f"{row}, {at}" if row else at
    of = f"{name}[{row}]" if row else name
    return InvalidArgument(
        f"{name}[{index}] = {x} has norm {norm:.9g}: a unit quaternion (x y z w) or (cos, sin) is "
        f"needed; pin.normalize(robot.model, {of}) makes one"
    )


def joint_torques(name: str, tau: ArrayLike, nv: int) -> Array:
    """Return torques (nv,) that a user handed in, where 0 stands for none."""
    return finite(name, np.zeros(nv) if is_none(tau) else tau, nv)


def is_none(tau: object) -> bool:
    """Return whether what a user handed in is the plain 0 that stands for no torques."""
    return isinstance(tau, int | float) and not isinstance(tau, bool) and tau == 0


def normalised(model: Any, name: str, q: ArrayLike) -> Array:
    """Return a guess or a posture that a user handed in, its quaternions normalised.

    One that is normalised already is returned as it is, digit by digit: pin.normalize would move
    the last bits of it again and again.
    """
    array = np.array(finite(name, q, model.nq))
    if pin.isNormalized(model, array, NORMALISED):
        return array
    array = np.array(pin.normalize(model, array))
    if not pin.isNormalized(model, array, tolerances.QUATERNION):
        raise InvalidArgument(f"{name}: a quaternion of it is zero; use 0 0 0 1")
    return array


def _unit_parts(model: Any) -> tuple[slice, ...]:
    """Return where q holds quaternions and (cos, sin) pairs, which have to be normalised."""
    parts = []
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.idx_q < 0 or joint.nq == joint.nv:  # the world, or a plain joint
            continue
        if joint.shortname() not in _UNIT_PARTS:
            raise InvalidModel(
                f"joint {name!r} is a {joint.shortname()} whose configuration cannot be checked; "
                "split it into joints that Pinocchio has by themselves"
            )
        start, size = _UNIT_PARTS[joint.shortname()]
        parts.append(slice(joint.idx_q + start, joint.idx_q + start + size))
    return tuple(parts)
