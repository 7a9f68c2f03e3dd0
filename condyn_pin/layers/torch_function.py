"""The autograd function of all layers of torch; it alone imports torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument
from condyn_pin.layers.state_map import StateMap
from condyn_pin.layers.torch_layer import TorchLayer

Tensor = Any  # a torch.Tensor: whose types are not read, that takes longer than all of ours


def layer(of: StateMap) -> TorchLayer:
    """Return a map as a function of tensors."""
    sizes = {"q": of.nq, "v": of.nv, "tau": of.nv}

    def call(q: Tensor, v: Tensor, tau: Tensor) -> tuple[Tensor, Tensor]:
        tensors = [q, v, tau]
        for (name, size), tensor in zip(sizes.items(), tensors, strict=True):
            _check(name, tensor, size)
        try:
            leading = torch.broadcast_shapes(*(each.shape[:-1] for each in tensors))
        except RuntimeError:
            shapes = ", ".join(str(tuple(each.shape)) for each in tensors)
            raise InvalidArgument(
                f"q, v, tau have the shapes {shapes}: leading axes that broadcast are needed"
            ) from None
        found = _Layer.apply(of, *(each.expand(*leading, each.shape[-1]) for each in tensors))
        return found  # type: ignore[no-any-return]

    return call


class _Layer(torch.autograd.Function):  # type: ignore[misc]
    """x, y = f(q, v, tau), all with the same leading axes."""

    @staticmethod
    def forward(of: StateMap, q: Tensor, v: Tensor, tau: Tensor) -> tuple[Tensor, Tensor]:
        x, y = of.value(*map(_numbers, (q, v, tau)))
        return torch.from_numpy(x), torch.from_numpy(y)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        ctx.of, *state = inputs
        ctx.save_for_backward(*state)
        ctx.save_for_forward(*state)

    @staticmethod
    def backward(ctx: Any, dx: Tensor, dy: Tensor) -> Any:
        return None, *_Slopes.apply(ctx.of.vjp, 3, *ctx.saved_tensors, dx, dy)

    @staticmethod
    def jvp(ctx: Any, _: None, *steps: Tensor | None) -> Any:
        state = ctx.saved_tensors
        moved = [
            torch.zeros_like(at) if step is None else step
            for step, at in zip(steps, state, strict=True)
        ]
        return _Slopes.apply(ctx.of.jvp, 2, *state, *moved)

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], of: StateMap, *tensors: Tensor) -> Any:
        return _Layer.apply(of, *_in_front(info, in_dims[1:], tensors)), (0, 0)


class _Slopes(torch.autograd.Function):  # type: ignore[misc]
    """What a `jvp` or a `vjp` of a map returns, `count` tensors; differentiated no further."""

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
    return np.asarray(tensor.detach().numpy())


def _in_front(info: Any, in_dims: tuple[Any, ...], tensors: tuple[Tensor, ...]) -> list[Tensor]:
    """Return the tensors with the axis of a vmap in front."""
    return [
        each.expand(info.batch_size, *each.shape) if at is None else each.movedim(at, 0)
        for each, at in zip(tensors, in_dims, strict=True)
    ]


def _check(name: str, tensor: Any, size: int) -> None:
    if not isinstance(tensor, torch.Tensor):
        raise InvalidArgument(f"{name} is a {type(tensor).__name__}: a torch.Tensor is needed")
    if tensor.dtype != torch.float64:
        raise InvalidArgument(
            f"{name} is {str(tensor.dtype).removeprefix('torch.')}: 64 bits are needed, for "
            f"constraints are solved to 1e-12; {name}.double() has them"
        )
    if tensor.device.type != "cpu":
        raise InvalidArgument(
            f"{name} is on {tensor.device}: Pinocchio computes on the CPU; {name}.cpu() is there"
        )
    if not tensor.ndim or tensor.shape[-1] != size:
        raise InvalidArgument(
            f"{name} has shape {tuple(tensor.shape)}: the last axis has to be {size} long"
        )
