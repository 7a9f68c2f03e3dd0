"""Layers of jax: functions of arrays with derivatives of both modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.errors import InvalidArgument, MissingExtra
from condyn_pin.layers.solve_map import SolveMap
from condyn_pin.layers.state_map import StateMap
from condyn_pin.layers.step_map import StepMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.base import Route

_STEWART_TRINKLE: Final = StewartTrinkle()
_ACTIVE_SET: Final = ActiveSet()

# Of q, v and tau, arrays of 64 bits; here without its type, for jax is imported when it is used.
JaxLayer = Callable[[Any, Any, Any], tuple[Any, Any]]


def jax_solve(
    scene: Scene, *, solver: Solver | None = None, drift: Baumgarte | None = None
) -> JaxLayer:
    """Return `solve` as a function of jax arrays, through which jax differentiates.

    (a, lam) = f(q, v, tau),    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da = -s_q dq - s_v dv

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional
        As in `solve`.
    drift : Baumgarte, optional
        As in `solve`.

    Returns
    -------
    callable
        Of q (..., nq), v (..., nv) and tau (..., nv), arrays of 64 bits whose leading axes
        broadcast; returns a (..., nv) and lam (..., m). Where rows are redundant, lam is the
        smallest. Unit quaternions of q are normalised, and the gradient by q has an entry for each
        of its numbers; `tangent_gradient` takes it to the tangent.

    Raises
    ------
    InvalidArgument
        By the function: if an array is not of 64 bits
        (``jax.config.update("jax_enable_x64", True)``), or has a wrong size.
    MissingExtra
        If jax is not installed.

    Notes
    -----
    A callback to the CPU, a state at a time: a batch of k costs k solves, where derivatives are
    asked for k of them with all their matrices. `jax.jit`, `jax.vmap`, `jax.grad`, `jax.jvp` and
    `jax.jacfwd` work; second derivatives do not. What `solve` raises comes inside of jax's own
    error.

    References
    ----------
    Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
    """
    return jax_layer(SolveMap(scene, solver, drift))


def jax_step(
    scene: Scene,
    *,
    dt: float,
    integrator: ContactScheme = _STEWART_TRINKLE,
    route: Route = _ACTIVE_SET,
) -> JaxLayer:
    """Return a step with contacts as a function of jax arrays, through which jax differentiates.

    (q+, v+) = f(q, v, tau)

    Parameters
    ----------
    scene : Scene
        Its `contacts` may open and slide.
    dt : float
        [s]
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default.
    route : Route, optional
        What is made of kinks and jumps, `ActiveSet()` by default; the step is that of the route.

    Returns
    -------
    callable
        As that of `jax_solve`; returns q+ (..., nq) and v+ (..., nv), so that steps follow one
        another, as in `jax.lax.scan`.

    Raises
    ------
    InvalidArgument
        If dt is not positive, or the integrator or the route cannot be used; by the function, as
        that of `jax_solve`.
    MissingExtra
        If jax is not installed.

    Notes
    -----
    Cost: a step for each state, and what `Route.cost` says where derivatives are asked for.
    """
    return jax_layer(StepMap(scene, dt, integrator, route))


def jax_layer(of: StateMap) -> JaxLayer:
    """Return a map as a function of jax arrays."""
    try:
        import jax
        import jax.numpy as jnp
    except ModuleNotFoundError as error:
        if error.name != "jax":
            raise
        raise MissingExtra('jax is missing: python -m pip install "condyn_pin[jax]"') from error
    sizes, size = {"q": of.nq, "v": of.nv, "tau": of.nv}, of.x_size + of.y_size

    def ask(function: Any, state: tuple[Any, ...], *shapes: tuple[int, ...]) -> Any:
        leading = state[0].shape[:-1]
        kinds = tuple(jax.ShapeDtypeStruct((*leading, *shape), np.float64) for shape in shapes)

        def call(*arrays: Any) -> Any:
            return function(*map(np.asarray, arrays))

        return jax.pure_callback(call, kinds, *state, vmap_method="broadcast_all")

    def value(*state: Any) -> Any:
        return ask(of.value, state, (of.x_size,), (of.y_size,))

    def moved(state: tuple[Any, ...], steps: tuple[Any, ...]) -> Any:
        x, y, A = ask(of.linear, state, (of.x_size,), (of.y_size,), (size, of.nq + 2 * of.nv))
        change = jnp.einsum("...ij,...j->...i", A, jnp.concatenate(steps, axis=-1))
        return (x, y), (change[..., : of.x_size], change[..., of.x_size :])

    differentiable = jax.custom_jvp(value)
    differentiable.defjvp(moved)

    def layer(q: Any, v: Any, tau: Any) -> tuple[Any, Any]:
        arrays = [
            _checked(name, jnp.asarray(each), wanted)
            for (name, wanted), each in zip(sizes.items(), (q, v, tau), strict=True)
        ]
        try:
            leading = jnp.broadcast_shapes(*(each.shape[:-1] for each in arrays))
        except ValueError:
            shapes = ", ".join(str(each.shape) for each in arrays)
            raise InvalidArgument(
                f"q, v, tau have the shapes {shapes}: leading axes that broadcast are needed"
            ) from None
        x, y = differentiable(
            *(jnp.broadcast_to(each, (*leading, each.shape[-1])) for each in arrays)
        )
        return x, y

    return layer


def _checked(name: str, array: Any, size: int) -> Any:
    if array.dtype != np.float64:
        raise InvalidArgument(
            f"{name} is {array.dtype}: 64 bits are needed, for constraints are solved to 1e-12; "
            f'jax.config.update("jax_enable_x64", True), then {name}.astype(float)'
        )
    if not array.ndim or array.shape[-1] != size:
        raise InvalidArgument(
            f"{name} has shape {array.shape}: the last axis has to be {size} long"
        )
    return array
