"""Pinocchio models: joints by name, rotations, and the data of models with many trees.

Joints: where q and v hold them, steps between q, which are lengths, and whose axes turn.

v_J = S(q) v

A `pin.Data` has four tensors for second derivatives, nv^3 numbers each: 0.4 GB of forty free
bodies, 7 GB of a hundred, although bodies that no joint connects have nothing in common. The
`Forest` of such a model is memory for each of its trees, and has the algorithms of Pinocchio by
their names, to be called as those:

    algorithms(data).crba(model, data, q)
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import atan2, inf
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin, placements_view
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel

Indices = NDArray[np.int_]

# Pinocchio's own way to say that there is no limit; 3.9 cannot unpickle a model that has infinity.
UNLIMITED: Final = float(np.finfo(float).max)

# Names of Pinocchio's joints whose coordinates are all lengths begin so.
_SLIDERS = (
    "JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismatic", "JointModelTranslation",
)  # fmt: skip

# Those whose last coordinate is an angle that q holds as (cos, sin).
_PAIRS = ("JointModelPlanar", "JointModelRUB", "JointModelRevoluteUnbounded")

# Columns of S are unit axes, or lengths of levers: what changes them by less is rounding.
_SAME = 1e-9

# Configurations at which S is looked at: steps from the neutral one that repeat nowhere [rad, m].
_LOOKS = ((0.7, 1.3), (0.4, 2.9), (0.9, 4.1))


def indices(model: Any, joints: Sequence[str]) -> tuple[Indices, Indices]:
    """Indices of some joints in q and in v, in the order given."""
    chosen = [model.joints[model.getJointId(name)] for name in joints]
    index_q = [i for joint in chosen for i in range(joint.idx_q, joint.idx_q + joint.nq)]
    index_v = [i for joint in chosen for i in range(joint.idx_v, joint.idx_v + joint.nv)]
    return np.array(index_q, dtype=np.int_), np.array(index_v, dtype=np.int_)


def lengths(joint: Any) -> tuple[bool, ...]:
    """Flag of each coordinate of a joint with nq = nv: length [m], or else angle [rad]."""
    if joint.shortname() == "JointModelComposite":
        return tuple(length for part in joint.extract().joints for length in lengths(part))
    return (joint.shortname().startswith(_SLIDERS),) * int(joint.nv)


def difference(model: Any, q0: NDArray[np.float64], q1: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the tangent step (nv,) from q0 to q1, also where it is small."""
    # `pin.difference` takes a plane turn for none where rounding leaves its 2 cos above 2: of those
    # below 1e-8 rad some are lost, and of those between numbers off unit length larger ones.
    step = np.array(pin.difference(model, q0, q1))
    for joint in model.joints:
        if joint.shortname().startswith(_PAIRS):
            end = joint.idx_q + joint.nq
            (c0, s0), (c1, s1) = (q[end - 2 : end].tolist() for q in (q0, q1))
            angle = atan2(c0 * s1 - s0 * c1, c0 * c1 + s0 * s1)
            step[joint.idx_v + joint.nv - 1] = angle
    return step


def unbounded(model: Any) -> tuple[int, ...]:
    """Indices in v of the rates of angles that q has as (cos, sin)."""
    chosen = [joint for joint in model.joints if joint.shortname().startswith(_PAIRS)]
    return tuple(joint.idx_v + joint.nv - 1 for joint in chosen)


def joints_with_turning_axes(model: Any) -> tuple[int, ...]:
    """Joints whose axes turn with their own q: S(q) is not constant in the body's axes."""
    # Pinocchio's derivatives, and its Coriolis matrix, take S for one. S is looked at itself, at a
    # few configurations, so that no list of kinds has to be complete. A joint of one coordinate is
    # a screw, whose axis stays.
    still, numbers = pin.neutral(model), np.arange(model.nv)
    steps = (size * np.sin(start + 1.7 * numbers) for size, start in _LOOKS)
    looks = [pin.integrate(model, still, step) for step in steps]

    def turns(joint: Any) -> bool:
        first, *others = (axes(joint, q) for q in looks)
        return any(np.abs(S - first).max() > _SAME * np.abs(first).max() for S in others)

    return tuple(joint.id for joint in list(model.joints)[1:] if joint.nv > 1 and turns(joint))


def axes(joint: Any, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motion subspace S(q) (6, nv) of a joint of a model, in the axes of its body."""
    data = joint.createData()
    joint.calc(data, q)
    return np.array(data.S).reshape(6, joint.nv)


# Rotation matrices: whether nine numbers are one, and the least that turns z to a direction.


def rotation_fault(R: Array) -> str:
    """Fault of a rotation matrix; empty if it is one."""
    if not np.isfinite(R).all():
        return "it is not finite"
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > tolerances.ROTATION:
        return f"its axes are not orthonormal, R R^T - 1 has an entry of {error:.3g}"
    return "it is left-handed, det R = -1" if np.linalg.det(R) < 0 else ""


def frames_along(directions: Array) -> Array:
    """Rotations of `z_along` for unit vectors (k, 3), as (k, 3, 3)."""
    x, y, z = directions.T
    c = 1.0 + z
    up = c > 0.0
    c = np.where(up, c, 1.0)
    xy = -x * y / c
    down = np.where(up, 1.0, -1.0)  # about x where z turns over
    rows = (1.0 - x * x / c, xy, x, xy, down * (1.0 - y * y / c), y, -x, -y, z)
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)


def z_along(direction: Array) -> Array:
    """Smallest rotation (3, 3) that turns z to a direction (3,), of any length."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction)
    return np.array(turn.matrix())


# Tensors that are small: a model with fewer bodies has one pin.Data [bytes].
_SMALL: Final = 2**25


def data_of(model: Any) -> Any:
    """Memory for Pinocchio's algorithms, a pin.Data or a `Forest`, or InvalidModel."""
    return Forest(model) if is_forest(model) else whole_data(model)


def whole_data(model: Any) -> Any:
    """`pin.Data` of a model; InvalidModel, before it is allocated, if memory is not enough."""
    needed = tensors_of(model)
    try:
        if needed > _SMALL and needed > available_memory():
            raise MemoryError
        return model.createData()
    except MemoryError as error:
        raise InvalidModel(
            f"the model has {model.nv} degrees of freedom, and Pinocchio's Data of it would take "
            f"{needed / 1e9:.2g} GB, more than this machine has left "
            f"({available_memory() / 1e9:.2g} GB); fix or lock joints, or take fewer bodies into "
            "one scene"
        ) from error


def tensors_of(model: Any) -> float:
    """Memory of the tensors of a `pin.Data`: 4 nv x nv x nv numbers [bytes]."""
    return float(4 * 8 * model.nv**3)


def available_memory() -> float:
    """Free or reclaimable memory [bytes]; a process that exceeds it may be killed."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if "MemAvailable" in line)
    except (OSError, StopIteration, ValueError):
        try:
            return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
        except (AttributeError, ValueError, OSError):  # Windows, where such a request fails
            return inf


def algorithms(data: Any) -> Any:
    """Pinocchio's algorithms for a memory, under their names in Pinocchio: a `Forest`, or `pin`."""
    return data if isinstance(data, Forest) else pin


def is_forest(model: Any) -> bool:
    """True if a model has several trees and is large enough for a pin.Data per tree."""
    if tensors_of(model) <= _SMALL or len(model.children[0]) <= 1:
        return False
    roots = _roots(model)
    return roots == sorted(roots)  # the joints of each tree are contiguous


def _roots(model: Any) -> list[int]:
    """Root joint of the tree of each joint, without the world."""
    roots = [0]
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        roots.append(roots[parent] if parent else joint)
    return roots[1:]


class ModelTree(NamedTuple):
    """One tree of a model, as a model of its own, and its indices in the whole."""

    model: Any
    data: Any
    joints: slice
    q: slice
    v: slice


def trees_of(model: Any) -> Iterator[ModelTree]:
    """Yield the trees of a model with contiguous joints, without armature."""
    # That is what steps change in a model, so that the model at hand has it.
    roots = [*_roots(model), model.njoints]
    first = 1
    while first < model.njoints:
        last = next(j for j in range(first, model.njoints + 1) if roots[j - 1] != first)
        tree = pin.Model()
        tree.gravity = model.gravity
        for joint in range(first, last):
            parent = model.parents[joint]
            tree.addJoint(
                parent - first + 1 if parent else 0, model.joints[joint],
                model.jointPlacements[joint], model.names[joint],
            )  # fmt: skip
            tree.inertias[joint - first + 1] = model.inertias[joint]
        q, v = model.idx_qs[first], model.idx_vs[first]
        at_q, at_v = slice(q, q + tree.nq), slice(v, v + tree.nv)
        yield ModelTree(tree, tree.createData(), slice(first, last), at_q, at_v)
        first = last


class Forest:
    """Memory of each tree of a model, and Pinocchio's algorithms on all of them."""

    def __init__(self, model: Any) -> None:
        self._nv, self._shapes = model.nv, ((model.nq,), (model.nv,))
        self._trees = list(trees_of(model))
        self.oMi = pin.StdVec_SE3()  # placements of all joints in the world
        for _ in range(model.njoints):
            self.oMi.append(pin.SE3.Identity())
        placed = placements_view(self.oMi, 0, model.njoints)
        self._placements = [
            (placed[:, 4 * tree.joints.start : 4 * tree.joints.stop],
             placements_view(tree.data.oMi, 1, tree.model.njoints - 1))
            for tree in self._trees
        ]  # fmt: skip
        # v, a: of all joints, in their axes
        self.v, self.a = (_JointQuantity(self._trees, name) for name in "va")
        # (6, nv) of all joints, in the axes of the world and at its origin
        self.J = np.zeros((6, model.nv), order="F")

    def is_sound(self) -> bool:
        """True if each tree passes Pinocchio's check of model and data."""
        return all(tree.model.check(tree.data) for tree in self._trees)

    def forwardKinematics(self, model: Any, data: Any, q: Array, *rates: Array) -> None:
        """Compute placements, velocities and accelerations of the joints."""
        self._each(pin.forwardKinematics, q, *rates)
        self._place()

    def computeJointJacobians(self, model: Any, data: Any, *q: Array) -> Array:
        """Compute placements and J; without q at those of the last call."""
        self._each(pin.computeJointJacobians, *q)
        self._place()
        for tree in self._trees:
            self.J[:, tree.v] = tree.data.J.reshape(6, -1)
        return self.J

    def crba(self, model: Any, data: Any, q: Array, convention: Any = None) -> Array:
        """Mass matrix M (nv, nv), owned by the caller; computes the Jacobians of the joints too."""
        self.computeJointJacobians(model, data, q)
        M = np.zeros((self._nv, self._nv))
        how = () if convention is None else (convention,)
        for tree, block in zip(self._trees, self._each(pin.crba, q, *how), strict=True):
            M[tree.v, tree.v] = block
        np.einsum("ii->i", M)[:] += model.armature
        return M

    def nonLinearEffects(self, model: Any, data: Any, q: Array, v: Array) -> Array:
        """Bias torques h (nv,): Coriolis, centrifugal and gravity."""
        return self._joined(pin.nonLinearEffects, q, v)

    def rnea(self, model: Any, data: Any, q: Array, v: Array, a: Array, *wrenches: Any) -> Array:
        """Torques M a + h (nv,), less those of external wrenches on the joints."""
        return np.asarray(self._joined(pin.rnea, q, v, a, *wrenches) + model.armature * a)

    def aba(self, model: Any, data: Any, q: Array, v: Array, tau: Array, *wrenches: Any) -> Array:
        """Acceleration (nv,) under tau and external wrenches on the joints."""
        for tree in self._trees:
            tree.model.armature = np.array(model.armature[tree.v])
        a = self._joined(pin.aba, q, v, tau, *wrenches)
        for tree in self._trees:
            tree.model.armature = np.zeros(tree.model.nv)
        return a

    def computeGeneralizedGravity(self, model: Any, data: Any, q: Array) -> Array:
        """Gravity torques (nv,)."""
        return self._joined(pin.computeGeneralizedGravity, q)

    def computeStaticTorque(self, model: Any, data: Any, q: Array, wrenches: Any) -> Array:
        """Static torques (nv,) against gravity and external wrenches on the joints."""
        return self._joined(pin.computeStaticTorque, q, wrenches)

    def computeKineticEnergy(self, model: Any, data: Any, *state: Array) -> float:
        """Kinetic energy of the links [J]; without a state that of the last call."""
        return float(sum(self._each(pin.computeKineticEnergy, *state)))

    def computePotentialEnergy(self, model: Any, data: Any, *q: Array) -> float:
        """Potential energy [J]; without q that of the last call."""
        return float(sum(self._each(pin.computePotentialEnergy, *q)))

    def getFrameJacobian(
        self, model: Any, data: Any, joint: int, placement: Any, axes: Any
    ) -> Array:
        """Return the Jacobian (6, nv) of a frame on a joint, right after those of the joints."""
        J = np.zeros((6, self._nv))
        tree = next(each for each in self._trees if joint < each.joints.stop)
        local = joint - tree.joints.start + 1
        block = pin.getFrameJacobian(tree.model, tree.data, local, placement, axes)
        J[:, tree.v] = block.reshape(6, -1)
        return J

    def centerOfMass(self, model: Any, data: Any, q: Array) -> Array:
        """Centre of mass (3,) in the world [m]."""
        places = np.array(self._each(pin.centerOfMass, q))
        masses = np.array([tree.data.mass[0] for tree in self._trees])
        return np.asarray(masses @ places / masses.sum())

    def jacobianCenterOfMass(self, model: Any, data: Any, q: Array) -> Array:
        """Jacobian (3, nv) of the centre of mass."""
        blocks = self._each(pin.jacobianCenterOfMass, q)
        masses = [tree.data.mass[0] for tree in self._trees]
        weighed = [m * J.reshape(3, -1) for m, J in zip(masses, blocks, strict=True)]
        return np.asarray(np.hstack(weighed) / sum(masses))

    def computeCentroidalMomentum(self, model: Any, data: Any, q: Array, v: Array) -> Any:
        """Centroidal momentum, a pin.Force."""
        total, mass, moment = pin.Force.Zero(), 0.0, np.zeros(3)
        momenta = self._each(pin.computeCentroidalMomentum, q, v)
        for tree, momentum in zip(self._trees, momenta, strict=True):
            total += pin.SE3(np.eye(3), tree.data.com[0]).act(momentum)
            mass += tree.data.mass[0]
            moment += tree.data.mass[0] * tree.data.com[0]
        return pin.SE3(np.eye(3), moment / mass).actInv(total)

    def _joined(self, algorithm: Callable[..., Any], *arguments: Any) -> Array:
        return np.concatenate(self._each(algorithm, *arguments))

    def _each(self, algorithm: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Results of an algorithm for each tree; the first argument is q."""
        # ValueError of arrays of another size, as Pinocchio has it.
        for i, argument in enumerate(arguments):
            if isinstance(argument, np.ndarray) and argument.shape != self._shapes[i > 0]:
                raise ValueError(f"an array has shape {argument.shape}")
        return [algorithm(tree.model, tree.data, *_part(tree, arguments)) for tree in self._trees]

    def _place(self) -> None:
        for place, of_tree in self._placements:
            place[:] = of_tree


def _part(tree: ModelTree, arguments: tuple[Any, ...]) -> Iterator[Any]:
    """Yield the arguments of one tree: its part of q, of vectors along v, and of joint wrenches."""
    for i, argument in enumerate(arguments):
        if isinstance(argument, np.ndarray):
            yield argument[tree.v if i else tree.q]
        elif isinstance(argument, pin.StdVec_Force):
            wrenches = pin.StdVec_Force()
            wrenches.append(pin.Force.Zero())
            for joint in range(tree.joints.start, tree.joints.stop):
                wrenches.append(argument[joint])
            yield wrenches
        else:
            yield argument


class _JointQuantity:
    """Quantity of each joint, read from the memory of its tree."""

    def __init__(self, trees: list[ModelTree], name: str) -> None:
        self._of = [
            partial(getattr(tree.data, name).__getitem__, joint)
            for tree in trees
            for joint in range(1, tree.model.njoints)
        ]

    def __getitem__(self, joint: int) -> Any:
        return self._of[joint - 1]()
