"""Layers of torch: functions of tensors with gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.errors import MissingExtra
from condyn_pin.layers.solve_map import SolveMap
from condyn_pin.layers.state_map import StateMap
from condyn_pin.layers.step_map import StepMap
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.stewart_trinkle import StewartTrinkle
from condyn_pin.simulation.routes.active_set import ActiveSet
from condyn_pin.simulation.routes.base import Route

_STEWART_TRINKLE: Final = StewartTrinkle()
_ACTIVE_SET: Final = ActiveSet()

# Of q, v and tau, tensors of 64 bits; here without its type, for torch is imported when it is used.
TorchLayer = Callable[[Any, Any, Any], tuple[Any, Any]]


def torch_solve(
    scene: Scene, *, solver: Solver | None = None, drift: Baumgarte | None = None
) -> TorchLayer:
    """Return `solve` as a function of tensors, through which torch differentiates.

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
        Of q (..., nq), v (..., nv) and tau (..., nv), tensors of 64 bits on the CPU whose leading
        axes broadcast; returns a (..., nv) and lam (..., m). Where rows are redundant, lam is the
        smallest. Unit quaternions of q are normalised, and the gradient by q has an entry for each
        of its numbers; `tangent_gradient` takes it to the tangent.

    Raises
    ------
    InvalidArgument
        By the function: if a tensor is of another dtype (``.double()`` helps), on another device,
        or has a wrong size.
    MissingExtra
        If torch is not installed.
    SolveFailed
        By the function, as in `solve`.

    Notes
    -----
    A state at a time: a batch of k costs k solves, and backward k solves with their derivatives;
    nothing but the state is kept for it. Forward mode, `torch.func.vmap` and `torch.func.jacrev`
    work; second derivatives do not.

    References
    ----------
    Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
    """
    return torch_layer(SolveMap(scene, solver, drift))


def torch_step(
    scene: Scene,
    *,
    dt: float,
    integrator: ContactScheme = _STEWART_TRINKLE,
    route: Route = _ACTIVE_SET,
) -> TorchLayer:
    """Return a step with contacts as a function of tensors, through which torch differentiates.

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
        As that of `torch_solve`; returns q+ (..., nq) and v+ (..., nv), so that steps follow one
        another.

    Raises
    ------
    InvalidArgument
        If dt is not positive, or the integrator or the route cannot be used; by the function, as
        that of `torch_solve`.
    MissingExtra
        If torch is not installed.
    SolveFailed
        By the function, if the contacts have no answer.

    Notes
    -----
    Cost: a step for each state, and what `Route.cost` says for each of them backward. A motion of
    many steps keeps its states alone.
    """
    return torch_layer(StepMap(scene, dt, integrator, route))


def torch_layer(of: StateMap) -> TorchLayer:
    """Return a map as a function of tensors."""
    try:
        from condyn_pin.layers.torch_function import layer
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise MissingExtra('torch is missing: python -m pip install "condyn_pin[torch]"') from error
    return layer(of)
