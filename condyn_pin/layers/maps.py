"""Layers: functions of arrays that another library differentiates through, by name.

Layer: what all layers have in common, whatever library differentiates through them.

LayerMap: what a layer is made of, a function of arrays with its derivatives.

    (x, y) = f(q, v, tau, ...)

1. A map says by name what it is a function of, with the shape that each has for one state (None
   for an axis of any length), and `outputs`, the shapes of x and y.
2. It says for one state what x and y are, how they change along steps of the inputs, and what a
   gradient by x and y is by the inputs. Leading axes are here.
3. Steps and gradients by configurations are numbers, one for each of q: `Configurations`.
4. Maps are called from the threads of other libraries, one at a time.

StateMap: a layer of (q, v, tau) whose derivatives are matrices in the tangent.

    (x, y) = f(q, v, tau, p)

1. A map says the sizes of x and y, and for one state what they are, and how they change:
   `MapDerivatives`, with `jvp`, `vjp` and `matrix` in the tangent. Derivatives of solves and of
   steps are such.
2. Where x is a configuration (`ends_in_q`), it is one number for each of q, and its change comes
   in the tangent as well; all else about manifolds is here.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import hypot, prod
from typing import Any, ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.linear_steps import LinearizedStep
from condyn_pin.gradients.routes.route import Route, check_parameters, linear_steps
from condyn_pin.gradients.routes.step_derivatives import Columns
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller import weighing
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme


class Layer(Protocol):
    """A function of arrays of torch or jax, through which that library differentiates.

    (x, y) = f(q, v, tau, parameters)

    Each array has the shape of its docstring behind leading axes, which are batches and broadcast:
    q (..., nq), v (..., nv). A state at a time is computed, so that a batch of k costs k of them,
    and backward k with their derivatives; nothing but the arrays is kept for it.

    **Numbers** have 64 bits and are on the CPU: constraints are solved to 1e-12, and arrays of 32
    bits are refused (``.double()``; in jax ``jax.config.update("jax_enable_x64", True)``).

    **Configurations** are numbers, quaternions and (cos, sin) of any length: they are normalised,
    and the gradient by q has an entry for each of its numbers, none along what is normalised away.
    `tangent_gradient` takes it to where ``pin.integrate`` steps.

    **Parameters** are those that `wrt` has named, in its order: friction and restitution (..., k)
    of each `FrictionalContact` of the scene, solref (..., 2), and inertias (..., joints, 10), in
    the order of ``pin.Inertia.toDynamicParameters``: the mass, mass times centre of mass, and the
    inertia about the joint's origin xx xy yy xz yz zz. The scene has its own where none are given.

    **First derivatives** only. torch: both modes, `torch.func.vmap`, `grad`, `jvp`, `jacrev`. jax:
    `jit`, `vmap`, `grad`, and but for whole motions `jvp` and `jacfwd`; shapes and dtypes
    are checked when jax traces. Within `jit` and `vmap` a call is a callback to the CPU, and what
    is raised there about numbers is the last line of jax's own error; elsewhere it is raised as it
    is.

    **Copies**, by ``pickle`` or ``copy.deepcopy``, are made anew from the scene, solver, integrator
    and route.
    """

    def __call__(self, q: Any, v: Any, tau: Any, *parameters: Any) -> tuple[Any, Any]:
        """Return x and y at q, v, tau and the values of the parameters that `wrt` has named."""


# LayerMap: what a layer is made of, a function of arrays with its derivatives.


Pair = tuple[Array, Array]
Shape = tuple[int, ...]
Wanted = tuple[int | None, ...]  # a shape of which some axes may have any length


class LayerMap(ABC):
    """A function of arrays with any leading axes, and its derivatives."""

    def __init__(self, inputs: Mapping[str, Wanted]) -> None:
        # shapes of the arguments by name, in order
        self.inputs, self._lock = dict(inputs), threading.Lock()

    @abstractmethod
    def outputs(self, shapes: Sequence[Shape]) -> tuple[Shape, Shape]:
        """Return the shapes of x and y of one state, for inputs of these."""

    @abstractmethod
    def value_of(self, *inputs: Array) -> Pair:
        """Return x and y of one state."""

    @abstractmethod
    def jvp_of(self, inputs: Sequence[Array], steps: Sequence[Array]) -> Pair:
        """Return the changes of x and y of one state along steps of the inputs."""

    @abstractmethod
    def vjp_of(self, inputs: Sequence[Array], dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs of one state of dx . x + dy . y."""

    def value(self, *arrays: Array) -> tuple[Array, ...]:
        """Return x and y."""
        return self.each(self.value_of, arrays, self.outputs(self.shapes(arrays)))

    def jvp(self, *arrays: Array) -> tuple[Array, ...]:
        """Return the changes of x and y: of inputs, and then of their steps."""
        k = len(self.inputs)

        def jvp_of(*numbers: Array) -> Pair:
            return self.jvp_of(numbers[:k], numbers[k:])

        return self.each(jvp_of, arrays, self.outputs(self.shapes(arrays)))

    def vjp(self, *arrays: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs: of inputs, and then of dx and dy."""

        def vjp_of(*numbers: Array) -> tuple[Array, ...]:
            return self.vjp_of(numbers[:-2], *numbers[-2:])

        return self.each(vjp_of, arrays, self.shapes(arrays))

    def shapes(self, arrays: Sequence[Array]) -> list[Shape]:
        """Return the shapes of the inputs without their leading axes."""
        wanted = self.inputs.values()
        return [each.shape[-len(w) :] for each, w in zip(arrays, wanted, strict=False)]

    def leading(self, shapes: Sequence[Shape]) -> list[Shape]:
        """Return the leading axes of inputs; InvalidArgument if one has a wrong shape."""
        if len(shapes) != len(self.inputs):
            raise InvalidArgument(
                f"{len(shapes)} arrays: {len(self.inputs)} are needed, {', '.join(self.inputs)}"
            )
        found = []
        for (name, wanted), shape in zip(self.inputs.items(), shapes, strict=True):
            k = len(wanted)
            fits = len(shape) >= k and all(
                w in (None, n) for w, n in zip(wanted, shape[-k:], strict=True)
            )
            if not fits:
                axes = ", ".join("steps" if w is None else str(w) for w in wanted)
                last = "axis has" if k == 1 else f"{k} axes have"
                raise InvalidArgument(
                    f"{name} has shape {tuple(shape)}: the last {last} to be "
                    f"{axes if k == 1 else f'({axes})'} long"
                )
            found.append(tuple(shape[:-k]))
        return found

    def not_broadcast(self, shapes: Sequence[Shape]) -> str:
        """Message on leading axes that do not broadcast."""
        shown = ", ".join(str(tuple(shape)) for shape in shapes)
        return (
            f"{', '.join(self.inputs)} have the shapes {shown}: leading axes that broadcast are "
            "needed"
        )

    def each(
        self, of_one: Callable[..., Sequence[Array]], arrays: Sequence[Array],
        shapes: Sequence[Shape],
    ) -> tuple[Array, ...]:  # fmt: skip
        """Arrays of these `shapes`, the values of `of_one` state stacked over all states."""
        for name, array in zip(self.inputs, arrays, strict=False):
            finite(name, array, array.shape)
        first = next(iter(self.inputs.values()))
        leading = arrays[0].shape[: arrays[0].ndim - len(first)]
        count = prod(leading)
        rows = [
            np.ascontiguousarray(each).reshape(count, *each.shape[len(leading) :])
            for each in arrays
        ]
        out = [np.empty((count, *shape)) for shape in shapes]
        quiet = np.errstate(all="ignore")  # what is not finite is refused
        with self._lock, one_blas_thread, quiet:
            for i in range(count):
                found = of_one(*(each[i] for each in rows))
                for array, part in zip(out, found, strict=True):
                    array[i] = part
        return tuple(array.reshape(*leading, *array.shape[1:]) for array in out)


# Parameters: what a scene is made of, as arrays that a layer is a function of.


class ParametrisedScene(NamedTuple):
    """A scene with its parameters, and how its steps are taken."""

    scene: Scene
    scheme: ContactScheme  # as asked for; steps are those of ``route.scheme(scheme)``
    route: Route


class Parameters:
    """Some of the parameters of a scene, by name."""

    def __init__(self, made: ParametrisedScene, names: Sequence[str]) -> None:
        self.made = self._last = made  # the scene as it was given, with its own parameters
        self._values: tuple[bytes, ...] = ()
        self._contacts = [
            i for i, c in enumerate(made.scene.contacts) if isinstance(c, FrictionalContact)
        ]
        self._owners = _owners(made.scene, self._contacts)
        k, bodies = len(self._contacts), made.scene.robot.model.njoints - 1
        known: dict[str, Shape] = {
            "friction": (k,), "restitution": (k,), "solref": (2,), "inertias": (bodies, 10),
        }  # fmt: skip
        names = check_parameters(made.route, made.scheme, names)
        if len(set(names)) < len(names):
            raise InvalidArgument(f"wrt = {list(names)}: each name once")
        # of friction and restitution one number for each `FrictionalContact`, of solref two, and of
        # inertias ten for each joint
        self.shapes = {name: known[name] for name in names}

    def steps(self, values: Sequence[Array], dt: float) -> tuple[LinearizedStep, Route]:
        """Return the steps of the scene with these values, and their route."""
        key = tuple(each.tobytes() for each in values)
        if key != self._values:
            self._last, self._values = self._with(values), key
        scene, scheme, route = self._last
        return linear_steps(scene, route.scheme(scheme), dt, tuple(self.shapes)), route

    def of(self, rows: Array, columns: Columns) -> list[Array]:
        """Blocks (k, numbers) of derivative rows (k, columns), one for each parameter."""
        found = []
        for name in self.shapes:
            block = rows[..., columns.of(name)]
            found.append(block @ self._owners if name in ("friction", "restitution") else block)
        return found

    def _with(self, values: Sequence[Array]) -> ParametrisedScene:
        scene, scheme, route = self.made
        contacts = list(scene.contacts)
        for name, value in zip(self.shapes, values, strict=True):
            if name in ("friction", "restitution"):
                for i, x in zip(self._contacts, value.tolist(), strict=True):
                    contacts[i] = replace(contacts[i], **{name: x})
            elif name == "solref":
                solref: Any = {"solref": tuple(value.tolist())}
                if hasattr(scheme, "solref"):
                    scheme = replace(scheme, **solref)
                else:
                    route = replace(route, **solref)
            else:
                scene = replace(scene, robot=weighing(scene.robot, value))
        return ParametrisedScene(replace(scene, contacts=tuple(contacts)), scheme, route)


def _owners(scene: Scene, contacts: Sequence[int]) -> Array:
    """Return 1 where a cone is of a contact (cones, contacts)."""
    bounds = scene.contact_bounds
    of_cones = [i for i in contacts for _ in bounds[i].touches]
    of_cones += [i for i in contacts for pair in bounds[i].pairs for _ in range(pair.points)]
    owners = np.zeros((len(of_cones), len(contacts)))
    for cone, i in enumerate(of_cones):
        owners[cone, contacts.index(i)] = 1.0
    return owners


# Configurations as arrays of nq numbers, and as points of a manifold of nv dimensions.
#
# A step t of the tangent moves the numbers of q by D(q) t:
#
#     plain joints           q' = t
#     quaternion x           x' = (w t + x_xyz x t, -x_xyz . t) / 2
#     pair (cos, sin)        x' = (-sin, cos) t
#     position before these  p' = R(x) t
#
# What programs do to q leaves the unit numbers at any length, so a layer is that of q with these
# normalised. With N their lengths (one elsewhere) and W = (D^T D)^-1, four for quaternions and one
# elsewhere, numbers dq step along, and a gradient g of the tangent has for each number,
#
#     t = W D^T N^-1 dq,        g_q = N^-1 D W g.


# A unit part that is shorter than this has no direction.
_SHORTEST: Final = 1e-100

# What rounding leaves of a length of one: to divide by it would move the last bits again and again.
_ROUNDED: Final = 4 * float(np.finfo(float).eps)


class Configurations:
    """The configurations of one robot."""

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        self.nq, self.nv = model.nq, model.nv
        joints = [j for j in model.joints if j.idx_q >= 0]
        curved = [j for j in joints if j.nq != j.nv]
        # of each curved joint: its numbers, its tangent, and where its unit part begins
        self._curved = [
            (slice(j.idx_q, j.idx_q + j.nq), slice(j.idx_v, j.idx_v + j.nv), part.start - j.idx_q)
            for j, part in zip(curved, robot.arguments.units, strict=True)
        ]
        self._units = robot.arguments.units
        self._plain = np.zeros((self.nq, self.nv))
        for j in joints:
            if j.nq == j.nv:
                at = np.arange(j.nq)
                self._plain[j.idx_q + at, j.idx_v + at] = 1.0

    def unit(self, q: Array) -> tuple[Array, Array]:
        """Return q with its unit parts normalised, and their lengths, one for all other numbers."""
        # InvalidArgument if a unit part is zero.
        lengths = np.ones(self.nq)
        for part in self._units:
            length = hypot(*q[part])
            if abs(length - 1.0) > _ROUNDED:
                lengths[part] = length
            if not length > _SHORTEST:
                raise InvalidArgument(
                    f"q[{part.start}:{part.stop}] = {q[part]}: a unit quaternion (x y z w) or "
                    "(cos, sin) is needed, and zero has no direction; pin.neutral(robot.model) "
                    "is a start"
                )
        return q / lengths, lengths

    def rates(self, q: Array) -> Array:
        """Return D (nq, nv) at a normalised q: what its numbers do along a tangent step."""
        if not self._curved:
            return self._plain
        D = self._plain.copy()
        for numbers, tangent, head in self._curved:
            D[numbers, tangent] = _of_joint(q[numbers], head)
        return D

    def steps(self, q: Array, lengths: Array) -> Array:
        """Return T (nv, nq): the tangent step that numbers dq make, T dq; its transpose pulls back.

        `q` and `lengths` are those that `unit` has found.
        """
        D = self.rates(q)
        if not self._curved:
            return D.T
        W = 1.0 / np.einsum("ij,ij->j", D, D)  # the columns of D are orthogonal
        return np.asarray((D * W).T / lengths)


def tangent_gradient(robot: Robot, q: ArrayLike, gradient: ArrayLike) -> Array:
    """Convert a gradient with respect to the numbers of q into the tangent space.

    g_v = D(q)^T g_q,    q' = D(q) v

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like
        Configuration; quaternions x y z w.
    gradient : (nq,) array_like
        Of any quantity by the numbers of q [1 / unit of q].

    Returns
    -------
    (nv,) array
        The gradient in the tangent [1/m, 1/rad]: slopes along ``pin.integrate(model, q, t e_i)``.
        A step downhill is ``pin.integrate(model, q, -rate * g_v)``.

    Raises
    ------
    InvalidArgument
        If a size is wrong, a number is not finite, or a quaternion is zero.

    Notes
    -----
    Takes about 10 us.
    """
    space = Configurations(robot)
    unit, lengths = space.unit(finite("q", q, space.nq))
    return np.asarray((finite("gradient", gradient, space.nq) * lengths) @ space.rates(unit))


def _of_joint(x: Array, head: int) -> Array:
    """Return D of one joint: `head` numbers of a position, and then a quaternion or a pair."""
    unit = x[head:]
    if len(unit) == 4:
        turn = np.vstack([unit[3] * np.eye(3) + pin.skew(unit[:3]), -unit[:3]]) / 2
        R: Any = pin.Quaternion(unit[3], *unit[:3]).toRotationMatrix() if head else None
    else:
        cos, sin = unit
        turn = np.array([[-sin], [cos]])
        R = np.array([[cos, -sin], [sin, cos]])
    D = np.zeros((len(x), head + turn.shape[1]))
    if head:
        D[:head, :head] = R
    D[head:, head:] = turn
    return D


# StateMap: a layer of (q, v, tau) whose derivatives are matrices in the tangent.


class MapDerivatives:
    """Derivatives of x and y by q, v, tau and parameters, in the tangent space.

    matrix (x_size + y_size, numbers): of x and then y by all numbers of the inputs
    shapes: shapes of the inputs
    """

    def __init__(self, matrix: Array, x_size: int, shapes: Sequence[Shape]) -> None:
        self.matrix, self._x_size, self._shapes = matrix, x_size, shapes

    def jvp(self, *steps: Array) -> Pair:
        """Return (dx, dy) along steps of the inputs."""
        moved = self.matrix @ np.concatenate([step.ravel() for step in steps])
        return moved[: self._x_size], moved[self._x_size :]

    def vjp(self, dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs of dx . x + dy . y."""
        cuts = np.cumsum([prod(shape) for shape in self._shapes])[:-1]
        by = np.split(np.concatenate((dx, dy)) @ self.matrix, cuts)
        return tuple(each.reshape(s) for each, s in zip(by, self._shapes, strict=True))


class StateMap(LayerMap):
    """A function of (q, v, tau) and of parameters."""

    ends_in_q: ClassVar[bool] = False
    x_size: int
    y_size: int

    def __init__(self, robot: Robot, parameters: Mapping[str, Shape] | None = None) -> None:
        self.space = Configurations(robot)
        self.nq, self.nv = self.space.nq, self.space.nv
        state = {"q": (self.nq,), "v": (self.nv,), "tau": (self.nv,)}
        super().__init__({**state, **(parameters or {})})

    @abstractmethod
    def answer(self, q: Array, v: Array, tau: Array, *p: Array) -> Pair:
        """Return x and y at one state."""

    @abstractmethod
    def change(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, Any]:
        """Return x and y at one state, and their `MapDerivatives`, or what has its members."""

    def outputs(self, shapes: Sequence[Shape]) -> tuple[Shape, Shape]:
        """Return the shapes of x and y."""
        return (self.x_size,), (self.y_size,)

    def value_of(self, *inputs: Array) -> Pair:
        """Return x and y of one state."""
        q, *others = inputs
        return self.answer(self.space.unit(q)[0], *others)

    def jvp_of(self, inputs: Sequence[Array], steps: Sequence[Array]) -> Pair:
        """Return the changes of x and y of one state."""
        T, end, _, change = self._at(*inputs)
        dq, *others = steps
        dx, dy = change.jvp(T @ dq, *others)
        return (dx if end is None else end @ dx), dy

    def vjp_of(self, inputs: Sequence[Array], dx: Array, dy: Array) -> tuple[Array, ...]:
        """Return the gradients by the inputs of one state."""
        T, end, _, change = self._at(*inputs)
        by_q, *others = change.vjp(dx if end is None else dx @ end, dy)
        return (by_q @ T, *others)

    def linear(self, *arrays: Array) -> tuple[Array, ...]:
        """Return x, y, and their derivatives (..., x_size + y_size, numbers of all inputs)."""
        size = self.x_size + self.y_size
        numbers = sum(map(prod, self.shapes(arrays)))

        def linear_of(*inputs: Array) -> tuple[Array, ...]:
            T, end, (x, y), change = self._at(*inputs)
            A = change.matrix
            if end is not None:
                A = np.vstack([end @ A[: self.nv], A[self.nv :]])
            return x, y, np.hstack([A[:, : self.nv] @ T, A[:, self.nv :]])

        shapes = (self.x_size,), (self.y_size,), (size, numbers)
        return self.each(linear_of, arrays, shapes)

    def _at(self, q: Array, *others: Array) -> tuple[Array, Array | None, Pair, Any]:
        """Return T at the start, D at the end where there is one, x and y, and their change."""
        unit, lengths = self.space.unit(q)
        pair, change = self.change(unit, *others)
        end = self.space.rates(pair[0]) if self.ends_in_q else None
        return self.space.steps(unit, lengths), end, pair, change
