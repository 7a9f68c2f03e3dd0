"""Impact: the velocity after constraints are met at speed, loops and contacts together.

    M (v+ - v-) = J^T lam,      J v+ = -e J v-

with lam the impulses and e the restitution of each row. The kinetic energy changes by
-1/2 w^T (I + e) G^+ (I - e) w, w = J v- and G = J M^-1 J^T: it never grows for one e between 0 and
1, and can for different ones. At open loops rows that are redundant are left out, as in `solve`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, check_overflow, finite, rounded
from condyn_pin._core.jacobian import Block, Jacobian
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import largest_violation
from condyn_pin.constraints.rows.redundancy import RedundantRows
from condyn_pin.dynamics.at_state import at_state, equations_of, gaps, rounding, without_gravity
from condyn_pin.dynamics.derivatives.kkt import Linearisation, TurningRows, turning_null_space
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import ConstraintForce, Sites, pulling
from condyn_pin.errors import InvalidArgument, unknown_name

Restitution = float | Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Impact(Jacobian):
    """The velocity after an impact, and its impulses.

    M (v - v_before) = J^T lam,    J v = -e J v_before

    Attributes
    ----------
    v : (nv,) array
        Velocity after it [rad/s, m/s].
    lam : (m,) array
        Impulses, all rows, in the axes of each constraint [N s, N m s]; the smallest ones where
        rows are redundant.
    v_before : (nv,) array
        Velocity before it [rad/s, m/s].
    restitution : (m,) array
        e of each row.
    energy_before, energy_after : float
        Kinetic energy [J].
    violation : float
        max abs(c(q)) [m, rad]: an impact does not close what is open.
    scene : Scene
    q : (nq,) array
        Configuration [rad, m].
    """

    v: Array
    lam: Array
    v_before: Array
    restitution: Array
    energy_before: float  # [J]
    energy_after: float  # [J]
    violation: float  # [m, rad]
    scene: Scene
    q: Array

    outputs = "v", "lam"
    inputs = "q", "v"

    # where rows are redundant and loops closed, by q along motions that keep the constraints
    dv_dq = Block("Derivative of the velocity v after the impact by q (nv, nv), tangent columns.")
    dv_dv = Block("Derivative of v by the velocity before the impact (nv, nv).")
    dlam_dq = Block("Derivative of the impulses by q (m, nv).")
    dlam_dv = Block("Derivative of the impulses by the velocity before the impact (m, nv).")

    @property
    def energy_lost(self) -> float:
        """Kinetic energy that is gone [J]."""
        return self.energy_before - self.energy_after

    @property
    def impulses(self) -> dict[str, ConstraintForce]:
        """Impulse on the first-named body by constraint [N s, N m s], in its axes."""
        return self._sites.forces(self.lam)

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices, a sentence each."""
        said = pulling(self.impulses, self._sites, "N s")
        if self.violation > tolerances.CLOSED:
            name, gap = largest_violation(
                gaps(self.scene, equations_of(self.scene).violation(self.q))
            )
            return (f"{name} is open by {gap} at q", *said)
        return said

    def block(self, output: str, by: str) -> Array:
        """Return the derivative of v (nv, nv) or lam (m, nv) by q or v of before."""
        of_both = self._derivatives[self.outputs.index(output)]
        return np.hsplit(of_both, 2)[self.inputs.index(by)]

    @cached_property
    def _sites(self) -> Sites:
        return Sites(self.scene, self.q)

    @cached_property
    def _derivatives(self) -> tuple[Array, Array]:
        return _derivatives(self)

    def __repr__(self) -> str:
        before, lost = f"{self.energy_before:.4g} J", self.energy_lost
        what = f"{lost:.4g} of {before} lost" if lost >= 0 else f"{-lost:.4g} J more than {before}"
        return f"Impact({self.scene.robot.name}, {len(self.lam)} rows: {what})"

    def __str__(self) -> str:
        lines = [repr(self)]
        if self.scene.rows:
            lines.append("impulses on the first-named body, axes of each constraint [N s, N m s]:")
        for name, impulse in self.impulses.items():
            lines.append(f"{name:<28} {rounded(impulse.components)}")
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


@one_blas_thread
def impact(scene: Scene, q: ArrayLike, v: ArrayLike, *, restitution: Restitution = 0.0) -> Impact:
    """Return velocity and impulses when the constraints of a scene close at a velocity.

    M (v+ - v-) = J^T lam,    J v+ = -e J v-

    A driven constraint engages at its speed: J v+ - s' = -e (J v- - s').

    Parameters
    ----------
    scene : Scene
        Every constraint transmits the impact: loops stay closed while a foot touches down.
    q, v : (nq,), (nv,) array_like
        The configuration, and the velocity before.
    restitution : float or mapping of str to float
        e between 0 (all rows stop) and 1, for all constraints or by name; 0 for those that are
        not named. It holds for every row of a constraint, tangential ones too: a contact whose
        normal alone rebounds is a `PlanarContact`.

    Returns
    -------
    Impact

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size or is not finite, a restitution is not between 0 and 1,
        different restitutions or driven rows contradict each other, or energy would be added.
    UnknownName
        If a name is that of no constraint.

    Notes
    -----
    Cost O(n^3 + m^2 n). Bilateral: `notices` names any contact that pulls. The derivatives are
    computed on demand.

    References
    ----------
    Featherstone. Rigid Body Dynamics Algorithms. Springer, 2008, section 11.7.
    """
    state = at_state(scene, q, v)
    M, J = state.terms.M, equations_of(scene).jacobian(state.q) if state.left else state.terms.J
    by_name, e = restitutions(scene, restitution), np.zeros(scene.rows)
    for bound in scene.bounds:
        e[bound.rows] = by_name.get(bound.name, 0.0)
    rates = equations_of(scene).wanted[1]  # of rows that are driven
    wanted = rates - e * (J @ state.v - rates)
    after, lam = state.factors.solve(M @ state.v, wanted)
    with np.errstate(over="ignore"):  # it is refused
        before, left = (float(v @ M @ v) / 2 for v in (state.v, after))
    check_overflow("v", state.v, np.array((before, left)))
    found = Impact(
        v=after,
        lam=lam,
        v_before=state.v,
        restitution=e,
        energy_before=before,
        energy_after=left,
        violation=float(np.abs(equations_of(scene).violation(state.q)).max(initial=0.0)),
        scene=scene,
        q=state.q,
    )
    _check(found, J, wanted, state.left)
    return found


def restitutions(scene: Scene, restitution: Restitution) -> Mapping[str, float]:
    """Return the restitution of each constraint that has one, by name; errors as in `impact`."""
    if not isinstance(restitution, Mapping):
        restitution = dict.fromkeys(scene.names, restitution) or {"": restitution}
    elif unknown := [name for name in restitution if name not in scene.names]:
        raise unknown_name("constraint", str(unknown[0]), scene.names)
    for name, value in restitution.items():
        what = f"restitution of {name!r}" if name else "restitution"
        if not 0.0 <= float(finite(what, value, ())) <= 1.0:
            raise InvalidArgument(f"{what} = {value!r}: a number between 0 and 1 is needed")
    return restitution


def _check(found: Impact, J: Array, wanted: Array, left: RedundantRows | None) -> None:
    """Refuse rows that contradict each other, and restitutions that would add energy."""
    several = len(set(found.restitution.tolist())) > 1
    if not (several or found.scene.is_driven):
        return
    speed = float(max(np.abs(J @ found.v_before).max(), np.abs(wanted).max()))
    nothing = max(rounding(found.scene, found.q, found.v_before).values())
    missed = J @ found.v - wanted
    off = float(np.abs(left.kept(missed) if left else missed).max())
    if off > tolerances.SOLVED * speed + nothing:
        what = (
            "restitution: redundant rows rebound differently" if several else "driven rows differ"
        )
        raise InvalidArgument(
            f"{what}, {off:.3g} m/s or rad/s apart; give the constraints that share them one value"
        )
    adds = found.energy_lost < -tolerances.SOLVED * found.energy_before
    if adds and not found.scene.is_driven:
        raise InvalidArgument(
            f"restitution: these values together would add {-found.energy_lost:.3g} J; give the "
            "constraints that are met at the same time one value"
        )


@one_blas_thread
def _derivatives(found: Impact) -> tuple[Array, Array]:
    """Return the derivatives of v+ (nv, 2 nv) and lam (m, 2 nv) by q and v-."""
    # M dv+ - J^T dlam = M dv- - d(M (v+ - v-) - J^T lam),    J dv+ = -e J dv- - d(J v+ + e J v-)
    # where d is that by q with all else fixed: at rest and without gravity, J a + gamma = J a and
    # M a + h = M a for any a, also one that is a velocity.
    scene, q, e, n = found.scene, found.q, found.restitution[:, None], found.scene.robot.nv
    linearisation = Linearisation(without_gravity(scene.robot.model), scene.bounds)
    still, no_force = np.zeros(n), np.zeros_like(found.lam)
    r_q = linearisation.at(q, still, found.v - found.v_before, found.lam).r_q
    s_q = linearisation.at(q, still, found.v, no_force).s_q
    s_q = s_q + e * linearisation.at(q, still, found.v_before, no_force).s_q
    state = at_state(scene, q)
    M, J, factors, turned = state.terms.M, state.terms.J, state.factors, None
    if state.left and state.left.rank < len(J):
        J, rates = equations_of(scene).jacobian(q), equations_of(scene).wanted[1]
        missed = J @ found.v - rates + found.restitution * (J @ found.v_before - rates)
        rest = state.left.rest(missed)
        kept = TurningRows(scene.nominal.redundancy, J, state.left.rank, rest)
        turning, pulling = partial(linearisation.turning, q), partial(linearisation.pulling, q)
        of_rest, turned = kept.turned(found.lam, turning, pulling)
        r_q, s_q = r_q - J.T @ turned, s_q + of_rest
    dv, dlam = factors.solve(np.hstack([-r_q, M]), np.hstack([-s_q, -e * J]))
    if turned is None:
        moved, _ = factors.solve(still, found.lam)
        turned = turning_null_space(linearisation, q, moved, factors.U[:, factors.rank :])
    dlam[:, :n] += turned
    return dv, dlam
