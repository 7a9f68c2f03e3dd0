"""Stiff damping and springs: how fast they alone would move the machine, beside the step of a run.

    v' = -P D v,    q'' = -P K q,    P = M^-1 - M^-1 J^T (J M^-1 J^T)^+ J M^-1

P is the inverse inertia that the constraints leave. An explicit method is stable while dt times the
largest eigenvalue of P D is below its limit on the negative axis: 2 for Euler's, 2.785 for
Runge-Kutta 4; and while dt times the largest frequency, a root of an eigenvalue of P K, is below
its limit on the imaginary one: 2 for Störmer-Verlet and RATTLE, 2.83 for Runge-Kutta 4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.minimum_norm import factorise
from condyn_pin._core.linalg.pivots import first_of_largest
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.stability_limit import stability_limit

# Frequencies that steps follow are below this over dt; of what is above few steps follow any.
_FOLLOWED = 2.0

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.base import Integrator
    from condyn_pin.simulation.system import System


def stiff_damping(system: System, integrator: Integrator, dt: float, q: Array) -> str:
    """Return which joint's damping an integrator cannot follow at dt, and what would do.

    Parameters
    ----------
    system : System
    integrator : Integrator
    dt : float
        [s]
    q : (nq,) array
        Where the inertia is that of the machine.

    Returns
    -------
    str
        Empty if there is none.
    """
    between = system.passive.between
    damped = system.passive.d.any() or (between is not None and between.c.any())
    if integrator.takes_stiff_damping or not damped:
        return ""
    rate, i = _fastest(system, q)
    limit = 2 * stability_limit(integrator, beta_per_alpha=0.0)  # c'' + 2 alpha c' = 0
    if rate * dt < limit:
        return ""
    return (
        f"the damping {_damper(system, i)} has a rate of {rate:.3g} / s, and "
        f"{integrator.title} follows no more than {limit:.3g} / dt: use SemiImplicitEuler(), "
        f"LinearlyImplicitMidpoint(), or dt below {limit / rate:.2g} s"
    )


def _fastest(system: System, q: Array) -> tuple[float, int]:
    """Return the largest eigenvalue of P D [1/s], and which damper takes most part in it.

    Dampers are counted joint coordinate by joint coordinate, and then from one frame to another. Of
    several that take the same part, the first.
    """
    factors = factorise(
        system.mass(q),
        system.equations.jacobian(q),
        tolerances.RANK,
        why=singular_mass(system.model, q),
    )
    passive = system.passive
    root = np.diag(np.sqrt(passive.d))
    if passive.between:
        root = np.hstack([root, passive.between.damping_rows(q).T])
    # with D = R R^T, those of R^T P R, where P r is the a of M a - J^T lam = r, J a = 0
    P_root, _ = factors.solve(root, np.zeros((system.scene.rows, root.shape[1])))
    rates, modes = np.linalg.eigh(root.T @ P_root)
    # two legs have the same rate, and any mixture of their modes is one
    fastest = modes[:, rates >= (1.0 - tolerances.TIED) * rates[-1]]
    return float(rates[-1]), first_of_largest(np.linalg.norm(fastest, axis=1))


def stiff_springs(system: System, integrator: Integrator, dt: float, q: Array) -> str:
    """Return which spring an integrator cannot follow at dt, and what would do.

    Parameters, and what is returned, are those of `stiff_damping`.
    """
    passive = system.passive
    sprung = passive.k.any() or (passive.between is not None and passive.between.k.any())
    if integrator.takes_jacobian or integrator.is_adaptive or not sprung:
        return ""
    K = passive.stiffness_matrix(q)
    sizes, axes = np.linalg.eigh(K)
    root = axes * np.sqrt(np.maximum(sizes, 0.0))
    factors = factorise(
        system.mass(q),
        system.equations.jacobian(q),
        tolerances.RANK,
        why=singular_mass(system.model, q),
    )
    P_root, _ = factors.solve(root, np.zeros((system.scene.rows, root.shape[1])))
    squares, modes = np.linalg.eigh(root.T @ P_root)
    frequency = float(np.sqrt(max(squares[-1], 0.0)))
    if frequency * dt < _FOLLOWED:
        return ""
    moved = P_root @ modes[:, -1]
    return (
        f"the spring {_spring(system, q, moved)} has a frequency of {frequency:.3g} rad/s, and "
        f"{integrator.title} follows no more than about {_FOLLOWED:g} / dt: use "
        "LinearlyImplicitMidpoint(), GeneralisedAlpha(), RadauIIA(), or dt below "
        f"{_FOLLOWED / frequency:.2g} s"
    )


def _spring(system: System, q: Array, moved: Array) -> str:
    """Return which spring has most energy where the machine moves like this (nv,)."""
    passive, model = system.passive, system.model
    share = passive.stiffness * moved**2
    names = {joint.idx_v: k for k, joint in enumerate(model.joints) if joint.nv}
    if passive.between:
        at = passive.between.stretch(q)
        share = np.concatenate(
            [share, passive.between.k * np.einsum("sj,sjn,n->s", at.n, at.J, moved) ** 2]
        )
    i = first_of_largest(share)
    if i >= model.nv:
        assert passive.between is not None
        k = i - model.nv
        return f"between {passive.between.names[k]} ({passive.between.k[k]:.3g} N/m)"
    return f"of joint {model.names[names[i]]!r} ({passive.stiffness[i]:.3g} N m/rad or N/m)"


def _damper(system: System, i: int) -> str:
    """Return which damper is the one of this number."""
    model, passive = system.model, system.passive
    if i >= model.nv:
        assert passive.between is not None
        k = i - model.nv
        return f"between {passive.between.names[k]} ({passive.between.c[k]:.3g} N s/m)"
    joint = next(k for k, each in enumerate(model.joints) if 0 <= i - each.idx_v < each.nv)
    return f"of joint {model.names[joint]!r} ({passive.d[i]:.3g} N m s/rad or N s/m)"
