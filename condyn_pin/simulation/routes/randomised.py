"""Randomised: the slope of a step from many steps beside it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.parameters import Grid
from condyn_pin.contact.modes import MODES
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.tried import Taken
from condyn_pin.simulation.routes.base import Route
from condyn_pin.simulation.routes.linear_steps import LinearSteps
from condyn_pin.simulation.routes.step_derivatives import StepDerivatives, made


@dataclass(frozen=True)
class Randomised(Route):
    """The slope of a step that is smoothed by noise, from its ends alone: of zeroth order.

    D = E[y(x + sigma e) e^T] / sigma,    e normal,    y the end of the step

    The expectation is that of pairs x + sigma e and x - sigma e. Their differences are fitted by
    the plane that leaves the least, as the covariance of the e that were drawn asks: where the step
    is linear the noise of the samples is none. q, v and tau are varied one after the other.

    Parameters
    ----------
    samples : int
        Pairs for each of q, v and tau; at least one for each of their directions.
    sigma : float
        Standard deviation of q [m, rad] and v [m/s, rad/s]; that of tau gives v as much in the
        step.
    seed : int
        Of the noise: the same one has the same bits.

    Notes
    -----
    Kinks and jumps count with the share of the samples that meets them: an impact that comes
    earlier or later within the step is seen, if sigma reaches so far. Variance falls with the
    number of samples, bias with sigma. Where loops constrain q, noise is along them.

    References
    ----------
    Suh, Pang, Tedrake. Bundled gradients through contact via randomized smoothing. IEEE Robotics
    and Automation Letters 7, 2022.
    """

    title: ClassVar[str] = "randomised"
    cost: ClassVar[str] = "6 steps for each sample"
    use: ClassVar[str] = "as a reference that knows no modes; where the step jumps"

    sweeps: ClassVar[tuple[Grid, ...]] = ({"sigma": (1e-3, 1e-2)},)

    samples: int = 200
    sigma: float = 1e-3  # [m, rad, m/s, rad/s]
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("samples", "seed"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < (name == "samples"):
                raise InvalidArgument(f"{name} = {value!r}: a whole number is needed")
        sigma = float(finite("sigma", self.sigma, ()))
        if not sigma > 0:
            raise InvalidArgument(f"sigma = {self.sigma!r}: a number > 0 is needed")
        object.__setattr__(self, "sigma", sigma)

    def parameters(self, scheme: ContactScheme) -> tuple[str, ...]:
        """Return nothing: states and torques are varied, the scene is not."""
        return ()

    def at(
        self, steps: LinearSteps, t: float, q: Array, v: Array, taken: Taken | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, and how it changes."""
        n, columns, rng = len(v), steps.columns, np.random.default_rng(self.seed)
        tau = steps.system.applied
        if tau.constant is None:
            raise InvalidArgument(
                "route = Randomised(): it varies torques that are constant; for others take "
                "ActiveSet()"
            )
        held, centre = np.array(tau.constant), steps.step(t, q, v)
        modes = steps.steps.modes()
        model, along = steps.system.model, _free(steps, q)
        if self.samples < n:
            raise InvalidArgument(
                f"samples = {self.samples}: a plane in {n} directions needs as many at least"
            )
        felt = self.sigma * np.diag(steps.system.mass(q)) / steps.dt
        dq, dv = columns.empty(), columns.empty()
        try:
            for part, basis in (
                (columns.q, self.sigma * along), (columns.v, self.sigma * np.eye(n)),
                (columns.tau, np.diag(felt)),
            ):  # fmt: skip
                noise = rng.standard_normal((self.samples, basis.shape[1]))
                ends = []
                for e in noise:
                    both = []
                    for move in (basis @ e, -basis @ e):
                        at, speed = q, v
                        if part == columns.q:
                            at = pin.integrate(model, q, move)
                        elif part == columns.v:
                            speed = v + move
                        else:
                            tau.hold(held + move, ())
                        both.append(steps.step(t, at, speed))
                    (q_up, v_up), (q_down, v_down) = both
                    moved = pin.difference(model, centre[0], q_up)
                    moved = moved - pin.difference(model, centre[0], q_down)
                    ends.append(np.concatenate((moved, v_up - v_down)) / 2)
                    tau.hold(held, ())
                plane = np.linalg.lstsq(noise, np.array(ends), rcond=None)[0]  # (free, 2 nv)
                slope = np.linalg.lstsq(basis.T, plane, rcond=None)[0].T
                dq[:, part], dv[:, part] = slope[:n], slope[n:]
        finally:
            tau.hold(held, ())
        names = steps.system.contacts.names
        named = dict(zip(names, (MODES[code] for code in modes), strict=True))
        return made(self, steps, centre, (dq, dv), named, inf)


def _free(steps: LinearSteps, q: Array) -> Array:
    """Return an orthonormal basis (nv, free) of what constraints leave of q."""
    J = steps.system.equations.jacobian(q)
    if not len(J):
        return np.eye(J.shape[1])
    _, sizes, V = np.linalg.svd(J)
    return np.asarray(V[int((sizes > 1e-9 * sizes[0]).sum()) :].T)
