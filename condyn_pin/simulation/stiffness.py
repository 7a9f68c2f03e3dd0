"""Stiff damping and springs: how fast they alone would move the machine, beside the step of a run.

    v' = -P D v,    q'' = -P K q,    P = M^-1 - M^-1 J^T (J M^-1 J^T)^+ J M^-1

P is the inverse inertia that the constraints leave. An explicit method is stable while dt times the
largest eigenvalue of P D is below its limit on the negative axis: 2 for Euler's, 2.785 for
Runge-Kutta 4; and while dt times the largest frequency, a root of an eigenvalue of P K, is below
its limit on the imaginary one: 2 for Störmer-Verlet and RATTLE, 2.83 for Runge-Kutta 4.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, first_of_largest
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.stability_limit import stability_limit
from condyn_pin.simulation.system import System

# Frequencies that steps follow are below this over dt; of what is above few steps follow any.
_FOLLOWED = 2.0


def stiff_damping(system: System, integrator: Integrator, dt: float, q: Array) -> str:
    """Return which joint's damping an integrator cannot follow at dt [s], and what would do.

    Nothing if there is none; q is where the inertia is that of the machine.
    """
    between = system.passive.between
    damped = system.passive.d.any() or (between is not None and between.c.any())
    if integrator.takes_stiff_damping or not damped:
        return ""
    rate, i = _fastest(system, q)
    limit = 2 * stability_limit(integrator, beta_per_alpha=0.0)  # c'' + 2 alpha c' = 0
    if rate * dt < limit:
        return ""
    sizes = system.passive.d, between.c if between else None
    damper = _named(system, i, sizes, ("N m s/rad or N s/m", "N s/m"))
    return (
        f"the damping {damper} has a rate of {rate:.3g} / s, and "
        f"{integrator.title} follows no more than {limit:.3g} / dt: use RadauIIA(3), "
        f"LinearlyImplicitMidpoint(), or dt below {limit / rate:.2g} s"
    )


def stiff_springs(system: System, integrator: Integrator, dt: float, q: Array) -> str:
    """Return which spring an integrator cannot follow at dt; as `stiff_damping`."""
    passive, between = system.passive, system.passive.between
    sprung = passive.k.any() or (between is not None and between.k.any())
    if integrator.takes_jacobian or integrator.is_adaptive or not sprung:
        return ""
    stiffnesses, axes = np.linalg.eigh(passive.stiffness_matrix(q))
    squares, modes, P_root = _spectrum(system, q, axes * np.sqrt(np.maximum(stiffnesses, 0.0)))
    frequency = float(np.sqrt(max(squares[-1], 0.0)))
    if frequency * dt < _FOLLOWED:
        return ""
    moved = P_root @ modes[:, -1]
    share = passive.stiffness * moved**2  # of the energy
    if between:
        at = between.stretch(q)
        along = np.einsum("sj,sjn,n->s", at.n, at.J, moved)
        share = np.concatenate([share, between.k * along**2])
    sizes = passive.stiffness, between.k if between else None
    spring = _named(system, first_of_largest(share), sizes, ("N m/rad or N/m", "N/m"))
    return (
        f"the spring {spring} has a frequency of {frequency:.3g} rad/s, and "
        f"{integrator.title} follows no more than about {_FOLLOWED:g} / dt: use "
        "RadauIIA(3), LinearlyImplicitMidpoint(), GeneralisedAlpha(), or dt below "
        f"{_FOLLOWED / frequency:.2g} s"
    )


def _fastest(system: System, q: Array) -> tuple[float, int]:
    """Return the largest eigenvalue of P D [1/s], and which damper takes most part in it.

    Dampers are counted joint coordinate by joint coordinate, and then from one frame to another. Of
    several that take the same part, the first.
    """
    passive = system.passive
    root = np.diag(np.sqrt(passive.d))
    if passive.between:
        root = np.hstack([root, passive.between.damping_rows(q).T])
    rates, modes, _ = _spectrum(system, q, root)
    # two legs have the same rate, and any mixture of their modes is one
    fastest = modes[:, rates >= (1.0 - tolerances.TIED) * rates[-1]]
    return float(rates[-1]), first_of_largest(np.linalg.norm(fastest, axis=1))


def _spectrum(system: System, q: Array, root: Array) -> tuple[Array, Array, Array]:
    """Return eigenvalues and modes of R^T P R, those of P R R^T, and P R."""
    M, J = system.mass(q), system.equations.consistent_jacobian(q)
    factors = factorise(M, J, tolerances.RANK, why=singular_mass(system.model, q))
    # P r is the a of M a - J^T lam = r, J a = 0
    P_root, _ = factors.solve(root, np.zeros((system.scene.rows, root.shape[1])))
    values, modes = np.linalg.eigh(root.T @ P_root)
    return values, modes, P_root


def _named(
    system: System, i: int, sizes: tuple[Array, Array | None], units: tuple[str, str]
) -> str:
    """Return which spring or damper it is, of those of the joints and then those between frames."""
    model, between = system.model, system.passive.between
    if i < model.nv:
        joint = next(k for k, each in enumerate(model.joints) if 0 <= i - each.idx_v < each.nv)
        return f"of joint {model.names[joint]!r} ({sizes[0][i]:.3g} {units[0]})"
    assert between is not None
    assert sizes[1] is not None
    k = i - model.nv
    return f"between {between.names[k]} ({sizes[1][k]:.3g} {units[1]})"
