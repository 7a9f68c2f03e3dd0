"""The autograd function of all layers of torch; it alone imports torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument
from condyn_pin.layers.maps import Layer, LayerMap

Tensor = Any  # a torch.Tensor: whose types are not read, that takes longer than all of ours


class TorchLayer(Layer):
    """A map as a function of tensors; deep copies, also pickled ones, have maps of their own."""

    def __init__(self, of: LayerMap) -> None:
        self._of = of

    def __call__(
        self, q: Tensor, v: Tensor, tau: Tensor, *parameters: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return x and y."""
        call = _call_function
        if torch.compiler.is_dynamo_compiling():  # which cannot look into Pinocchio
            call = torch.compiler.disable(_call_function)
        return call(self._of, q, v, tau, *parameters)


def _call_function(of: LayerMap, *tensors: Tensor) -> tuple[Tensor, Tensor]:
    for name, tensor in zip(of.inputs, tensors, strict=False):
        _check(name, tensor)
    axes = of.leading([tuple(each.shape) for each in tensors])
    try:
        leading = torch.broadcast_shapes(*axes)
    except RuntimeError:
        raise InvalidArgument(of.not_broadcast([each.shape for each in tensors])) from None
    spread = (
        each.expand(*leading, *each.shape[len(own) :])
        for own, each in zip(axes, tensors, strict=True)
    )
    return _Function.apply(of, *spread)  # type: ignore[no-any-return]


class _Function(torch.autograd.Function):  # type: ignore[misc]
    """x, y = f(q, v, tau, ...), all with the same leading axes."""

    @staticmethod
    def forward(of: LayerMap, *inputs: Tensor) -> tuple[Tensor, Tensor]:
        x, y = of.value(*map(_numbers, inputs))
        return torch.from_numpy(x), torch.from_numpy(y)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        ctx.of, *state = inputs
        ctx.save_for_backward(*state)
        ctx.save_for_forward(*state)

    @staticmethod
    def backward(ctx: Any, dx: Tensor, dy: Tensor) -> Any:
        return None, *_Slopes.apply(ctx.of.vjp, len(ctx.of.inputs), *ctx.saved_tensors, dx, dy)

    @staticmethod
    def jvp(ctx: Any, _: None, *steps: Tensor | None) -> Any:
        state = ctx.saved_tensors
        moved = [
            torch.zeros_like(at) if step is None else step
            for step, at in zip(steps, state, strict=True)
        ]
        return _Slopes.apply(ctx.of.jvp, 2, *state, *moved)

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], of: LayerMap, *tensors: Tensor) -> Any:
        return _Function.apply(of, *_in_front(info, in_dims[1:], tensors)), (0, 0)


class _Slopes(torch.autograd.Function):  # type: ignore[misc]
    """`count` tensors of a `jvp` or `vjp` of a map, without derivatives of their own."""

    @staticmethod
    def forward(slopes: Any, count: int, *tensors: Tensor) -> tuple[Tensor, ...]:
        return tuple(torch.from_numpy(each) for each in slopes(*map(_numbers, tensors)))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        """Keep nothing."""

    @staticmethod
    def backward(ctx: Any, *_: Tensor) -> Any:
        raise InvalidArgument("a layer has first derivatives only; differentiate it once")

    @staticmethod
    def jvp(ctx: Any, *_: Any) -> Any:
        raise InvalidArgument("a layer has first derivatives only; differentiate it once")

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], slopes: Any, count: int, *tensors: Tensor) -> Any:
        found = _Slopes.apply(slopes, count, *_in_front(info, in_dims[2:], tensors))
        return found, (0,) * count


def _numbers(tensor: Tensor) -> Array:
    try:
        return np.asarray(tensor.numpy(force=True))  # also of views that torch negates when read
    except RuntimeError as error:  # of the batches of an older vmap of torch
        raise InvalidArgument(
            f"a layer cannot read this tensor ({str(error).splitlines()[0]}); in place of "
            "is_grads_batched and vectorize=True take torch.func.jacrev or torch.func.vmap"
        ) from error


def _in_front(info: Any, in_dims: tuple[Any, ...], tensors: tuple[Tensor, ...]) -> list[Tensor]:
    """Return the tensors with the axis of a vmap in front."""
    return [
        each.expand(info.batch_size, *each.shape) if at is None else each.movedim(at, 0)
        for each, at in zip(tensors, in_dims, strict=True)
    ]


def _check(name: str, tensor: Any) -> None:
    if not isinstance(tensor, torch.Tensor):
        raise InvalidArgument(f"{name} is a {type(tensor).__name__}: a torch.Tensor is needed")
    if tensor.dtype != torch.float64:
        raise InvalidArgument(
            f"{name} is {str(tensor.dtype).removeprefix('torch.')}: 64 bits are needed, for "
            f"constraints are solved to 1e-12; {name}.double() has them"
        )
    if tensor.layout is not torch.strided:
        raise InvalidArgument(f"{name} is sparse: {name}.to_dense() is needed")
    if tensor.device.type != "cpu":
        raise InvalidArgument(
            f"{name} is on {tensor.device}: Pinocchio computes on the CPU; {name}.cpu() is there"
        )


layer = TorchLayer
