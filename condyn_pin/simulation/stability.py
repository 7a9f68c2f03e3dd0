"""Stability of explicit steps: the largest dt, and stiff parts.

The stability limit of Baumgarte's method: gains that are too large for a step.

With a_ref a gap obeys c'' + 2 alpha c' + beta^2 c = 0. An integrator makes of that a linear map of
(c, c') in each step, and a gap shrinks only while the eigenvalues of this map are inside the unit
circle. For alpha = beta that is

    explicit Euler        alpha dt < 2
    semi-implicit Euler   alpha dt < 2 sqrt(2) - 2 = 0.828
    Runge-Kutta 4         alpha dt < 2.785

and for any other integrator and gains the map is measured, by letting it step. At the limit itself
no gap shrinks, so that gains have to be below it by more than rounding.

References
----------
Ascher, Chin, Petzold, Reich. Stabilization of constrained mechanical systems with DAEs and
invariant manifolds. Mechanics of Structures and Machines 23, 1995.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, cast

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, first_of_largest
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.errors import InvalidArgument, StepFailed
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.system import Step, System

# A gap that grows by less a step is one that does not move: alpha = 0 or beta = 0.
_GROWS = 1e-9

# How far a step has to be below the limit, as a share of it: dt is a quotient, and gains are typed.
_MARGIN = 1e-6

# Steps that a map of two states is told from, and the share of |A|^2 up to which a second step is
# that of an integrator that remembers nothing.
_STEPS = 4
_SAME = 1e-10


def _slider() -> Any:
    """Return the model of one slider."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "gap")
    return model


class _Gap:
    """Test system of one gap: q = c, v = c', with the step as the unit of time.

    It is a system without springs, damping, torques or curved coordinates.
    """

    manifold = Manifold(_slider())

    def __init__(self, drift: Baumgarte, dt: float) -> None:
        self._Kp, self._Kd = drift.Kp * dt * dt, drift.Kd * dt

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return c''."""
        return -self._Kd * v - self._Kp * q

    def integrate(self, q: Array, dq: Array) -> Array:
        """Return q moved by dq."""
        return q + dq

    def slope(self, t: float, q0: Array, y: Array, V: Array) -> tuple[Array, Array]:
        """Return y' and V'."""
        return V, self.acceleration(t, q0 + y, V)

    def implicit(self, dt: float) -> _Gap:
        """The system itself: no spring or damper acts."""
        return self

    def iterated(self, dt: float, last: Callable[[], Array]) -> _Gap:
        """The system itself: no spring or damper acts."""
        return self

    def retried(self, step: Step) -> Step:
        """The step itself: no torque of a function acts."""
        return step

    def difference_if_stiff(self, t: float, q: Array, v: Array) -> None:
        """Do nothing."""

    def size(self, q: Array) -> float:
        """Scale of the coordinate: 1."""
        return 1.0


def growth(integrator: Integrator, drift: Baumgarte, dt: float) -> float:
    """Return the factor by which a gap grows in a step: the spectral radius of its map."""
    # One step is linear in (c, c') at its start, and where the integrator remembers its last step,
    # in those of the last two.
    gap = cast("System", _Gap(drift, dt))
    try:
        with np.errstate(all="ignore"):  # what overflows has grown
            A = _map(integrator, gap)
    except StepFailed:  # an iteration that does not converge, here or in a run
        return inf
    return float(np.abs(np.linalg.eigvals(A)).max()) if np.isfinite(A).all() else inf


def _map(integrator: Integrator, gap: System) -> Array:
    """Return the map of one state to the next (2, 2), or of two states to the next two (4, 4)."""
    runs = _runs(integrator, gap, 2)
    A = runs[:, 1].T
    remembers = np.abs(runs[:, 2] - runs[:, 1] @ A.T).max() > _SAME * np.abs(A).max() ** 2
    if remembers and np.isfinite(runs := _runs(integrator, gap, _STEPS)).all():
        return _map_of_two(runs)
    return np.asarray(A)


def _map_of_two(runs: Array) -> Array:
    """Return the map (4, 4) of the states before and after a step to those of the next."""
    pairs = np.concatenate([runs[:, :-1], runs[:, 1:]], axis=2)
    before, after = (pairs[:, part].reshape(-1, 4) for part in (np.s_[:-1], np.s_[1:]))
    scale = np.abs(before).max(axis=1, keepdims=True)
    used = scale[:, 0] > 0
    return np.asarray(np.linalg.lstsq((before / scale)[used], (after / scale)[used], _SAME)[0])


def _runs(integrator: Integrator, gap: System, steps: int) -> Array:
    """Return (c, c') at the start and after each of some steps, from (1, 0) and from (0, 1)."""
    runs = []
    for start in np.eye(2):
        step, states = integrator.start(gap, 1.0).step, [start]
        for k in range(steps):
            q, v, _ = step(float(k), states[-1][:1], states[-1][1:])
            states.append(np.concatenate([q, v]))
        runs.append(states)
    return np.array(runs)


def stability_limit(integrator: Integrator, *, beta_per_alpha: float = 1.0) -> float:
    """Return the product alpha dt below which gaps shrink, to 1e-4; infinity if there is no end."""
    # The integrator holds constraints by accelerations; `beta_per_alpha` is 1 for critical damping.
    if integrator.is_adaptive:
        return inf
    stable = 0.0
    for alpha in np.arange(1, 400) * 0.05:
        if is_beyond(integrator, Baumgarte(alpha, beta_per_alpha * alpha), 1.0):
            break
        stable = float(alpha)
    else:
        return inf
    unstable = stable + 0.05
    while unstable - stable > 1e-4:
        middle = (stable + unstable) / 2
        beyond = is_beyond(integrator, Baumgarte(middle, beta_per_alpha * middle), 1.0)
        stable, unstable = (stable, middle) if beyond else (middle, unstable)
    return stable


def is_beyond(integrator: Integrator, drift: Baumgarte, dt: float) -> bool:
    """True if gains are at the stability limit of an integrator, or beyond it."""
    return growth(integrator, drift, dt * (1 + _MARGIN)) > 1 + _GROWS


def check_stability_limit(integrator: Integrator, drift: Baumgarte, dt: float) -> None:
    """Refuse gains that are not below the stability limit of an integrator at dt."""
    if integrator.is_adaptive or not is_beyond(integrator, drift, dt):
        return
    grows, limit = growth(integrator, drift, dt), stability_limit(integrator, beta_per_alpha=1.0)
    what = f"every gap grows {grows:.3g} times a step" if grows > 1.001 else "no gap shrinks"
    raise InvalidArgument(
        f"drift = {drift!r}: with {integrator.title} and dt = {dt:g} s {what}; "
        f"alpha = beta is stable below {limit / dt:.4g} / s "
        f"(alpha dt < {limit:.4g}), and good at a tenth of that"
    )


# Stiff damping and springs: how fast they alone would move the machine, beside the step of a run.
#
#     v' = -P D v,    q'' = -P K q,    P = M^-1 - M^-1 J^T (J M^-1 J^T)^+ J M^-1
#
# P is the inverse inertia that the constraints leave. An explicit method is stable while dt times
# the largest eigenvalue of P D is below its limit on the negative axis: 2 for Euler's, 2.785 for
# Runge-Kutta 4; and while dt times the largest frequency, a root of an eigenvalue of P K, is below
# its limit on the imaginary one: 2 for Störmer-Verlet and RATTLE, 2.83 for Runge-Kutta 4.


# Frequencies that steps follow are below this over dt; of what is above few steps follow any.
_FOLLOWED = 2.0


def stiff_damping(system: System, integrator: Integrator, dt: float, q: Array) -> str:
    """Message on joint damping too stiff for an integrator at dt [s], with advice."""
    # Empty if there is none; q is where the inertia is that of the machine.
    between = system.passive.between
    damped = system.passive.d.any() or (between is not None and between.c.any())
    if integrator.damps_implicitly or not damped:
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
    """Message on a spring too stiff for an integrator at dt; as `stiff_damping`."""
    passive, between = system.passive, system.passive.between
    sprung = passive.k.any() or (between is not None and between.k.any())
    if integrator.uses_torque_jacobian or integrator.is_adaptive or not sprung:
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
    """Largest eigenvalue of P D [1/s], and the damper with the largest part in its mode."""
    # Dampers are counted joint coordinate by joint coordinate, and then from one frame to another.
    # Of several with the same part, the first.
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
    """Name of a spring or damper, counted over the joints and then between frames."""
    model, between = system.model, system.passive.between
    if i < model.nv:
        joint = next(k for k, each in enumerate(model.joints) if 0 <= i - each.idx_v < each.nv)
        return f"of joint {model.names[joint]!r} ({sizes[0][i]:.3g} {units[0]})"
    assert between is not None
    assert sizes[1] is not None
    k = i - model.nv
    return f"between {between.names[k]} ({sizes[1][k]:.3g} {units[1]})"
