"""Layers of torch and jax: answers as functions of arrays, with gradients.

`torch_function` and `jax_function` import these libraries, when a layer is made.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Final, cast

from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import MissingExtra
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.route import Route
from condyn_pin.layers.answers import RunMap, SolveMap, StepMap
from condyn_pin.layers.maps import Layer, LayerMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.schemes.stewart_trinkle import StewartTrinkle

_STEWART_TRINKLE: Final = StewartTrinkle()
_ACTIVE_SET: Final = ActiveSet()


def torch_solve(
    scene: Scene,
    *,
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    wrt: Sequence[str] = (),
) -> Layer:
    """Return `solve` as a function of tensors, through which torch differentiates.

    (a, lam) = f(q, v, tau, pi),
    M da - J^T dlam = dtau - r_q dq - r_v dv - Y dpi,    J da = -s_q dq - s_v dv

    Parameters
    ----------
    scene : Scene
    solver, drift : optional
        As in `solve`.
    wrt : sequence of {"inertias"}
        What else it is a function of.

    Returns
    -------
    Layer
        Of q, v, tau (..., nv) and what `wrt` names; returns a (..., nv) and lam (..., m), the
        smallest one where rows are redundant.

    Raises
    ------
    InvalidArgument
        If `wrt` names anything else; by the layer, if a tensor is of another dtype, on another
        device, or has a wrong size.
    MissingExtra
        If torch is not installed.
    SolveFailed
        By the layer, as in `solve`.

    Notes
    -----
    Cost: a solve for each state, and one with its derivatives backward.

    References
    ----------
    Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
    """
    return _layer("torch", SolveMap(scene, solver, drift, wrt))


def torch_step(
    scene: Scene,
    *,
    dt: float,
    integrator: ContactScheme = _STEWART_TRINKLE,
    route: Route = _ACTIVE_SET,
    wrt: Sequence[str] = (),
) -> Layer:
    """Return a step with contacts as a function of tensors, through which torch differentiates.

    (q+, v+) = f(q, v, tau, parameters)

    Parameters
    ----------
    scene : Scene
        Its `contacts` may open and slide.
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default.
    route : Route, optional
        What is made of kinks and jumps, `ActiveSet()` by default; the step is that of the route.
    wrt : sequence of {"friction", "restitution", "solref", "inertias"}
        What else it is a function of.

    Returns
    -------
    Layer
        Of q, v, tau (..., nv) and what `wrt` names; returns q+ (..., nq) and v+ (..., nv), so that
        steps follow one another.

    Raises
    ------
    InvalidArgument
        If dt is not positive, the integrator or the route cannot be used, or its steps do not
        depend on a parameter; by the layer, as that of `torch_solve`.
    MissingExtra
        If torch is not installed.
    SolveFailed
        By the layer, if the contacts have no answer.

    Notes
    -----
    Cost: a step for each state, and what `Route.cost` says for each of them backward. Where
    parameters change, the scene is made anew: some 30 steps.
    """
    return _layer("torch", StepMap(scene, dt, integrator, route, wrt))


def torch_simulate(
    scene: Scene,
    *,
    dt: float,
    integrator: ContactScheme = _STEWART_TRINKLE,
    route: Route = _ACTIVE_SET,
    wrt: Sequence[str] = (),
    every: int | None = None,
) -> Layer:
    """Return a whole motion as a function of tensors, through which torch differentiates.

    x_i+1 = step(x_i, tau_i, parameters),    y_i = g_i + A_i^T y_i+1

    Parameters
    ----------
    scene : Scene
        With contacts that may open and slide, or without any.
    dt : float
        Time step [s].
    integrator : ContactScheme, optional
        `StewartTrinkle()` by default. Without contacts `Moreau()` is of second order.
    route : Route, optional
        What is made of kinks and jumps, `ActiveSet()` by default; the steps are those of the route.
    wrt : sequence of {"friction", "restitution", "solref", "inertias"}
        What else it is a function of.
    every : int, optional
        Return the states after each so many steps; the end alone by default.

    Returns
    -------
    Layer
        Of q, v, tau (..., steps, nv), a row held in each step, and what `wrt` names; returns q
        (..., nq) and v (..., nv) at the end, or (..., k, nq) and (..., k, nv) after `every` steps.

    Raises
    ------
    InvalidArgument
        As `torch_step`; by the layer also if tau has a wrong number of steps.
    MissingExtra
        If torch is not installed.
    SolveFailed, StepFailed
        By the layer, if contacts have no answer.

    Notes
    -----
    Cost: the steps; backward all of them twice more, and what `Route.cost` says for each. Memory of
    the sweep back: some sqrt(steps) states and the matrices of one step. For feedback, loop over
    `torch_step`.

    References
    ----------
    Griewank, Walther. Evaluating Derivatives. SIAM, 2008, chapter 12: checkpoints.
    """
    return _layer("torch", RunMap(scene, dt, integrator, route, wrt, every))


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
    return _layer("jax", SolveMap(scene, solver, drift, wrt))


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
    return _layer("jax", StepMap(scene, dt, integrator, route, wrt))


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
    return _layer("jax", RunMap(scene, dt, integrator, route, wrt, every))


def _layer(library: str, of: LayerMap) -> Layer:
    """Map as a function of the arrays of a library; MissingExtra where that is not installed."""
    try:
        module = import_module(f"condyn_pin.layers.{library}_function")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != library:
            raise
        text = f'{library} is missing: python -m pip install "condyn_pin[{library}]"'
        raise MissingExtra(text) from error
    return cast(Layer, module.layer(of))
