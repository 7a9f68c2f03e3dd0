"""The functions of all layers of jax; it alone imports jax."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import prod
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument
from condyn_pin.layers.maps import Layer, LayerMap, Shape, StateMap

Arrays = tuple[Any, ...]  # of jax, whose types are not read


class JaxLayer(Layer):
    """A map as a function of jax arrays; deep copies, also pickled ones, have maps of their own."""

    def __init__(self, of: LayerMap) -> None:
        self._of = of
        self._function = _both_ways(of) if isinstance(of, StateMap) else _backward(of)

    def __call__(self, q: Any, v: Any, tau: Any, *parameters: Any) -> tuple[Any, Any]:
        """Return x and y."""
        of, arrays = self._of, [jnp.asarray(each) for each in (q, v, tau, *parameters)]
        for name, array in zip(of.inputs, arrays, strict=False):
            if array.dtype != np.float64:
                raise InvalidArgument(
                    f"{name} is {array.dtype}: 64 bits are needed, for constraints are solved to "
                    f'1e-12; jax.config.update("jax_enable_x64", True), then {name}.astype(float)'
                )
        axes = of.leading([each.shape for each in arrays])
        try:
            leading = jnp.broadcast_shapes(*axes)
        except ValueError:
            raise InvalidArgument(of.not_broadcast([each.shape for each in arrays])) from None
        spread = (
            jnp.broadcast_to(each, (*leading, *each.shape[len(own) :]))
            for own, each in zip(axes, arrays, strict=True)
        )
        x, y = self._function(*spread)
        return x, y

    def __reduce__(self) -> tuple[Any, ...]:
        return JaxLayer, (self._of,)


def _both_ways(of: StateMap) -> Callable[..., Arrays]:
    """Return a map with derivatives of both modes, by its matrices."""

    def moved(state: Arrays, steps: Arrays) -> tuple[Arrays, Arrays]:
        shapes = of.shapes(state)
        numbers = sum(map(prod, shapes))
        size = of.x_size + of.y_size
        x, y, A = _call_function(
            of, of.linear, state, ((of.x_size,), (of.y_size,), (size, numbers))
        )
        flat = [
            step.reshape(*step.shape[: step.ndim - len(shape)], prod(shape))
            for step, shape in zip(steps, shapes, strict=True)
        ]
        change = jnp.einsum("...ij,...j->...i", A, jnp.concatenate(flat, axis=-1))
        return (x, y), (change[..., : of.x_size], change[..., of.x_size :])

    found: Any = jax.custom_jvp(partial(_value, of))
    found.defjvp(moved)
    return found  # type: ignore[no-any-return]


def _backward(of: LayerMap) -> Callable[..., Arrays]:
    """Return a map with derivatives of the reverse mode alone."""

    def begun(*inputs: Any) -> tuple[Arrays, Arrays]:
        return _value(of, *inputs), inputs

    def back(inputs: Arrays, by: Arrays) -> Arrays:
        return _call_function(of, of.vjp, (*inputs, *by), of.shapes(inputs))

    found: Any = jax.custom_vjp(partial(_value, of))
    found.defvjp(begun, back)
    return found  # type: ignore[no-any-return]


def _value(of: LayerMap, *inputs: Any) -> Arrays:
    return _call_function(of, of.value, inputs, of.outputs(of.shapes(inputs)))


def _call_function(of: LayerMap, function: Any, arrays: Arrays, shapes: Sequence[Shape]) -> Arrays:
    """Values of a map's function for arrays; for arrays that jax traces, by a callback."""
    first = next(iter(of.inputs.values()))
    leading = arrays[0].shape[: arrays[0].ndim - len(first)]
    kinds = tuple(jax.ShapeDtypeStruct((*leading, *shape), np.float64) for shape in shapes)

    def call(*given: Any) -> tuple[Array, ...]:
        found: tuple[Array, ...] = function(*map(np.asarray, given))
        return found

    def called(*arrays: Any) -> Arrays:
        if not any(isinstance(each, jax.core.Tracer) for each in arrays):
            return tuple(map(jnp.asarray, call(*arrays)))  # what it raises is raised as it is
        found: Arrays = jax.pure_callback(call, kinds, *arrays, vmap_method="broadcast_all")
        return found

    def refused(*_: Any) -> Any:
        raise InvalidArgument("a layer has first derivatives only; differentiate it once")

    once = jax.custom_jvp(called)
    once.defjvp(refused)
    return once(*arrays)  # type: ignore[no-any-return]


layer = JaxLayer
