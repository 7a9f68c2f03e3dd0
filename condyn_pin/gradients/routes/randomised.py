"""Randomised: the slope of a step from many steps beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf
from typing import ClassVar, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Grid
from condyn_pin._core.arrays import Array, Indices, finite
from condyn_pin._core.models import difference
from condyn_pin.contact.problem import MODES
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.linear_steps import LinearizedStep
from condyn_pin.gradients.routes.route import Route
from condyn_pin.gradients.routes.step_derivatives import (
    PARAMETERS,
    StepDerivatives,
    step_derivatives_of,
)
from condyn_pin.gradients.routes.varied_steps import VariedSteps
from condyn_pin.stepping.step_problem import AcceptedStep


@dataclass(frozen=True)
class Randomised(Route):
    """The derivative of a step smoothed by noise, from samples of its end: a zeroth-order method.

    D = E[y(x + sigma e) e^T] / sigma,    e normal,    y the end of the step

    The expectation is that of pairs x + sigma e and x - sigma e. Their differences are fitted by
    the plane that leaves the least, weighted by the covariance of the drawn e: where the step
    is linear the noise of the samples is none. q, v and tau are varied one after the other, and
    then the parameters that `wrt` names.

    Parameters
    ----------
    samples : int
        Pairs for each of q, v, tau and parameters; at least one for each of their directions.
    sigma : float
        Standard deviation of q [m, rad] and v [m/s, rad/s]; that of tau gives v as much in the
        step. Of friction and restitution too, and of `solref` and inertias as a share [1].
    seed : int
        Of the noise: the same one has the same bits.

    Raises
    ------
    InvalidArgument
        If `sigma` is not positive, or `samples` or `seed` is no count.

    Notes
    -----
    Kinks and jumps count in proportion to the samples that cross them: an impact earlier or later
    within the step has an effect, if sigma reaches that far. Variance falls with the
    number of samples, bias with sigma. Where loops constrain q, noise is along them.

    References
    ----------
    Suh, Pang, Tedrake. Bundled gradients through contact via randomized smoothing. IEEE Robotics
    and Automation Letters 7, 2022.
    """

    title: ClassVar[str] = "randomised"
    cost: ClassVar[str] = "6 steps for each sample, and 2 for each parameter that is asked for"
    use: ClassVar[str] = "as a reference that knows no modes; where the step jumps"
    on_request: ClassVar[tuple[str, ...]] = PARAMETERS

    sweeps: ClassVar[tuple[Grid, ...]] = ({"sigma": (1e-3, 1e-2)},)

    samples: int = 200
    sigma: float = 1e-3  # [m, rad, m/s, rad/s]
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("samples", 1), ("seed", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise InvalidArgument(
                    f"{name} = {value!r}: a whole number of at least {least} is needed"
                )
        sigma = float(finite("sigma", self.sigma, ()))
        if not sigma > 0:
            raise InvalidArgument(f"sigma = {self.sigma!r}: a number > 0 is needed")
        object.__setattr__(self, "sigma", sigma)

    def at(
        self, steps: LinearizedStep, t: float, q: Array, v: Array, taken: AcceptedStep | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, with its derivatives."""
        if steps.system.applied.constant is None:
            raise InvalidArgument(
                "route = Randomised(): it varies torques that are constant; for others take "
                "ActiveSet()"
            )
        centre = steps.step(t, q, v)
        modes, rng = steps.steps.modes(), np.random.default_rng(self.seed)
        n, columns, model = len(v), steps.columns, steps.system.model
        dq, dv = columns.empty(), columns.empty()
        for varied in self._varied(steps, t, q, v):
            directions = varied.basis.shape[1]
            if self.samples < directions:
                raise InvalidArgument(
                    f"samples = {self.samples}: a plane in {directions} directions needs as many "
                    "at least"
                )
            noise = rng.standard_normal((self.samples, directions))
            ends = []
            for e in noise:
                move = varied.basis @ e
                (q_up, v_up), (q_down, v_down) = varied.end(move), varied.end(-move)
                moved = difference(model, centre[0], q_up) - difference(model, centre[0], q_down)
                ends.append(np.concatenate((moved, v_up - v_down)) / 2)
            plane = np.linalg.lstsq(noise, np.array(ends), rcond=None)[0]  # (directions, 2 nv)
            slope = np.linalg.lstsq(varied.basis.T, plane, rcond=None)[0].T
            dq[:, varied.columns], dv[:, varied.columns] = slope[:n], slope[n:]
        names = steps.system.contacts.names
        named = dict(zip(names, (MODES[code] for code in modes), strict=True))
        return step_derivatives_of(self, steps, centre, (dq, dv), named, inf)

    def _varied(
        self, steps: LinearizedStep, t: float, q: Array, v: Array
    ) -> Iterator[_VariedQuantity]:
        """Varied quantities of a step: q, v, tau, and the parameters in `wrt`."""
        n, columns, system, step = len(v), steps.columns, steps.system, steps.step
        held = np.array(system.applied.constant)
        felt = self.sigma * np.diag(system.mass(q)) / steps.dt

        def pushed(move: Array) -> tuple[Array, Array]:
            system.applied.hold(held + move, ())
            try:
                return step(t, q, v)
            finally:
                system.applied.hold(held, ())

        def at(move: Array) -> tuple[Array, Array]:
            return step(t, pin.integrate(system.model, q, move), v)

        yield _VariedQuantity(columns.q, self.sigma * _free_directions(steps, q), at)
        yield _VariedQuantity(columns.v, self.sigma * np.eye(n), lambda move: step(t, q, v + move))
        yield _VariedQuantity(columns.tau, np.diag(felt), pushed)
        for name in steps.wrt:
            if name in PARAMETERS:
                of = VariedSteps(steps, name)

                def made_of(move: Array, of: VariedSteps = of) -> tuple[Array, Array]:
                    return of.at(move)(t, q, v)

                yield _VariedQuantity(columns.of(name), self.sigma * np.diag(of.sizes), made_of)


class _VariedQuantity(NamedTuple):
    """Quantity on which the end of a step depends."""

    columns: slice | Indices
    basis: Array  # (numbers, directions), sigma long
    end: Callable[[Array], tuple[Array, Array]]  # of a step, by a move (numbers,)


def _free_directions(steps: LinearizedStep, q: Array) -> Array:
    """Return an orthonormal basis (nv, free) of what constraints leave of q."""
    J = steps.system.equations.consistent_jacobian(q)
    if not len(J):
        return np.eye(J.shape[1])
    _, sizes, V = np.linalg.svd(J)
    return np.asarray(V[int((sizes > 1e-9 * sizes[0]).sum()) :].T)
