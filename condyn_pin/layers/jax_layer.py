"""Layers of jax: the functions of `torch_layer`, of jax's arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.errors import MissingExtra
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.base import Route
from condyn_pin.layers.answers import RunMap, SolveMap, StepMap
from condyn_pin.layers.maps import Layer, LayerMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle

_STEWART_TRINKLE: Final = StewartTrinkle()
_ACTIVE_SET: Final = ActiveSet()


def jax_solve(
    scene: Scene,
    *,
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    wrt: Sequence[str] = (),
) -> Layer:
    """Return `torch_solve` for arrays of jax, with `jax.jvp` and `jax.jacfwd` too.

    Parameters
    ----------
    scene : Scene
    solver, drift, wrt : optional
        As in `torch_solve`.

    Returns
    -------
    Layer
        As that of `torch_solve`.

    Raises
    ------
    InvalidArgument
        By the layer: if an array is not of 64 bits, or has a wrong size.
    MissingExtra
        If jax is not installed.

    Notes
    -----
    Cost: a callback, and a solve for each state; where derivatives are asked for, with all their
    matrices.
    """
    return _layer(SolveMap(scene, solver, drift, wrt))


def jax_step(
    scene: Scene,
    *,
    dt: float,
    integrator: ContactScheme = _STEWART_TRINKLE,
    route: Route = _ACTIVE_SET,
    wrt: Sequence[str] = (),
) -> Layer:
    """Return `torch_step` for arrays of jax: one step, as for `jax.lax.scan`.

    Parameters
    ----------
    scene : Scene
    dt : float
        Time step [s].
    integrator, route, wrt : optional
        As in `torch_step`.

    Returns
    -------
    Layer
        As that of `torch_step`.

    Raises
    ------
    InvalidArgument
        As `torch_step`; by the layer, as that of `jax_solve`.
    MissingExtra
        If jax is not installed.

    Notes
    -----
    Cost: a callback, and a step for each state; where derivatives are asked for, what `Route.cost`
    says.
    """
    return _layer(StepMap(scene, dt, integrator, route, wrt))


def jax_simulate(
    scene: Scene,
    *,
    dt: float,
    integrator: ContactScheme = _STEWART_TRINKLE,
    route: Route = _ACTIVE_SET,
    wrt: Sequence[str] = (),
    every: int | None = None,
) -> Layer:
    """Return `torch_simulate` for arrays of jax: whole motions, for `jax.grad` and `jax.jacrev`.

    Parameters
    ----------
    scene : Scene
    dt : float
        Time step [s].
    integrator, route, wrt, every : optional
        As in `torch_simulate`.

    Returns
    -------
    Layer
        As that of `torch_simulate`, with derivatives of the reverse mode alone.

    Raises
    ------
    InvalidArgument
        As `torch_simulate`; by the layer, as that of `jax_solve`.
    MissingExtra
        If jax is not installed.

    Notes
    -----
    Cost: two callbacks, and what `torch_simulate` says.
    """
    return _layer(RunMap(scene, dt, integrator, route, wrt, every))


def _layer(of: LayerMap) -> Layer:
    """Return a map as a function of jax arrays."""
    try:
        from condyn_pin.layers.jax_function import JaxLayer
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "jax":
            raise
        raise MissingExtra('jax is missing: python -m pip install "condyn_pin[jax]"') from error
    return JaxLayer(of)
