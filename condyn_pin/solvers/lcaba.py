"""LCABA: Pinocchio 4's loop-constrained articulated body algorithm, with its state cured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from condyn_pin import _pin, tolerances
from condyn_pin.arrays import Array
from condyn_pin.errors import UnsupportedConstraint
from condyn_pin.knobs import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_knobs,
)
from condyn_pin.solvers.base import Method, Solver

if TYPE_CHECKING:
    from condyn_pin.audit import Audit
    from condyn_pin.workspace import Workspace

Acceleration = Callable[[Array, Array, Array], Array]

# What `mu` is chosen from, times the largest eigenvalue of G.
_WEIGHT_SHARES = (1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)

# Error of a, relative, at the nominal states: a wide margin for all other states.
_ACCURATE = tolerances.SOLVED / 1000


@dataclass(frozen=True)
class LCABA(Solver):
    """Articulated body recursion with the constraints carried up the tree.

    The proximal iteration of `Proximal`, without forming G: the constraints enter the articulated
    inertias with weight 1/mu. Linear in the number of joints for constraints to the world.

    Parameters
    ----------
    mu : float, optional
        Proximal weight [1/kg]. Rounding of inertias scaled by 1/mu ends up in a, and a too small
        mu is silently wrong: on Cassie's closed loops 1e-8 is off by a per cent. J a stays at
        1e-13 all the while; only M a + h - tau - J^T lam shows it. The right value depends on the
        scene, so by default the first workspace of a scene measures seven of them against
        `Reference` at the scene's nominal states, and takes the fastest that is accurate.
    max_iterations : int
        Upper limit on the sweeps over the tree; Talos on two feet takes 5, Cassie up to 40.
    absolute_accuracy : float, optional
        Iterate until |J a + gamma - a_ref|_inf is below this [m/s^2]. By default a tenth of what
        a status of ok allows on the scene: 1e-10 on Talos, 1e-11 on Cassie with her light rods.

    Notes
    -----
    Needs Pinocchio 4. The fastest for feet on the ground (`condyn bench`). What is cured: `lcaba`
    reads `data.oa` of the constrained joints before it writes it, so that every second call with
    6 rows is wrong; it segfaults with the world first, or with an elimination order made for other
    constraints; it overwrites what `constraintDynamics` reads in the constraint datas, so that
    these must never be shared; its force is minus lam.

    References
    ----------
    Sathya, Carpentier. Constrained articulated body dynamics algorithms. IEEE Transactions on
    Robotics, 2025.
    """

    title: ClassVar[str] = "LCABA"
    cost: ClassVar[str] = "O(n + m) for contacts with the world; loops add cross terms"
    use: ClassVar[str] = "the fastest for contacts with the world; needs Pinocchio 4"
    takes_redundant: ClassVar[bool] = True
    takes_every_kind: ClassVar[bool] = False
    takes_world_first: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS, "max_iterations": (1, 20)},
        {"max_iterations": ITERATIONS},
        {"absolute_accuracy": ACCURACIES},
    )

    mu: float | None = None  # [1/kg]
    max_iterations: int = 200
    absolute_accuracy: float | None = None  # [m/s^2]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_knobs(self.mu, self.max_iterations, smallest_mu=1e-300)
        if self.absolute_accuracy is not None:
            check_accuracy("absolute_accuracy", self.absolute_accuracy)

    def start(self, workspace: Workspace) -> Method:
        """Return the cured `pin.lcaba` bound to the memory of `workspace`."""
        if workspace.drift:
            raise UnsupportedConstraint(
                "LCABA: Pinocchio's lcaba ignores drift control on constraints of 3 rows; "
                "use Proximal() with drift"
            )
        solve = _pin.lcaba()
        model, data, bounds = workspace.model, workspace.data, workspace.natives.constraints
        models, datas = workspace.constraint_models, workspace.constraint_datas
        _pin.order_joints_for_lcaba(model, data, models)
        # only 6 rows read `oa` before it is written
        joints = sorted({j for b in bounds if b.size == 6 for j in (b.joint1, b.joint2) if j})
        clear = tuple(data.oa[joint].setZero for joint in joints)

        def bind(settings: Any) -> Acceleration:
            def acceleration(q: Array, v: Array, tau: Array) -> Array:
                for zero in clear:
                    zero()
                return solve(model, data, q, v, tau, models, datas, settings)

            return acceleration

        # views into the memory of the datas: to fetch an entry of the list costs a microsecond
        held = [datas[k].contact_force for k in range(len(bounds))]
        views = [f.vector[: b.size] for f, b in zip(held, bounds, strict=True)] or [np.zeros(0)]
        scene_forces = workspace.scene_forces

        def lam() -> Array:
            forces = np.concatenate(views)
            return scene_forces(np.negative(forces, out=forces))

        audit, mu = workspace.scene.audit, self.mu
        if mu is None and (mu := audit.measured.get(self)) is None:
            mu = audit.measured[self] = self._best_mu(audit, bind)
        settings = workspace.proximal_settings = self._settings(audit, mu)
        return Method(bind(settings), lam, lambda: int(settings.iter))

    def _settings(self, audit: Audit, mu: float) -> Any:
        accuracy = self.absolute_accuracy
        if accuracy is None:
            accuracy = audit.yardstick.enough / 10
        return _pin.proximal_settings(accuracy, 0.0, mu, self.max_iterations)

    def _best_mu(self, audit: Audit, bind: Callable[[Any], Acceleration]) -> float:
        """Return the fastest weight that is accurate at the nominal states.

        If none is, the one with the best product of error and iterations. A weight that needs more
        than a quarter of the iterations there is left out: it would not converge elsewhere.
        """

        def measure(mu: float) -> tuple[int, float]:
            settings = self._settings(audit, mu)
            acceleration = bind(settings)
            worst, iterations = 0.0, 0
            for s in audit.states:
                scale = max(np.abs(s.a).max(), audit.yardstick.gravity) or 1.0
                error = float(np.abs(acceleration(s.q, s.v, s.tau) - s.a).max() / scale)
                worst = max(worst, error if np.isfinite(error) else np.inf)
                iterations = max(iterations, settings.iter)
            if iterations > max(1, self.max_iterations // 4):
                return 2, worst
            return (0, iterations) if worst < _ACCURATE else (1, worst * iterations)

        return min((share * audit.delassus_norm for share in _WEIGHT_SHARES), key=measure)
