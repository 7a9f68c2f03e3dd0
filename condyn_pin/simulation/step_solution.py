"""StepSolution: a step with contacts that carries its own proof."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.contact.solution import ContactSolution, ContactStatus
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.contact_columns import forces_of
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.integrators.tried import Taken
from condyn_pin.simulation.step_start import StepStart

if TYPE_CHECKING:
    from condyn_pin.simulation.routes.base import Route
    from condyn_pin.simulation.routes.step_derivatives import StepDerivatives


@dataclass(frozen=True, eq=False, repr=False)
class StepSolution:
    """The state after one step, its impulses, and their residual in each law.

    M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,
    J_b v+ = -dt gamma / 2,    sigma = G lam + g

    Attributes
    ----------
    q, v : (nq,), (nv,) array
        Configuration [rad, m] and velocity [rad/s, m/s] at the end of the step.
    lam : (m,) array
        Impulses of the step, of constraints and then of all contacts, zero of those that take no
        part [N s, N m s].
    gaps : dict of str to float
        Distance of each contact and stop at the end [m, rad].
    modes : dict of str to str
        Of each contact: open, stick or slide.
    contact : ContactSolution
        The contact problem of the step, its answer, and seven residuals.
    dynamics_error : float
        The largest entry of M (v+ - v) - dt (tau - h) - J_b^T l_b - J_c^T lam, by Newton-Euler and
        wrenches on the bodies, with neither M nor J [N s, N m s].
    dynamics_limit : float
        The largest `dynamics_error` of a step that is ok: 1e-7 of |M| |v+ - v| + dt (|h| + |tau|)
        of the joint where that is largest, and the rounding of M v [N s, N m s].
    constraint_error : float
        max abs(J_b v+ + dt gamma / 2), of driven rows less s' + dt s'' / 2, by forward kinematics
        [m/s, rad/s].
    violation : float
        max abs(c(q+)) of the constraints [m, rad].
    penetration : float
        The deepest of the contacts at the end [m, rad].
    energy_error : float
        The change of kinetic and potential energy and that of springs, from one state to the other,
        that no work explains [J].
    energy_limit : float
        The largest `energy_error` of a step that is ok: a tenth of the energies in it, and what a
        step of order 1 leaves of forces that begin to act [J].
    energy_lost : float
        What the contacts took, friction and impacts; not negative, springs of a `SoftStep` apart
        [J].
    correction_work : float
        Work of pushing penetrations out, and of moving q back onto the loops [J].
    algorithmic_work : float
        Energy that contacts added although friction and impacts only take it, because a step has J
        at one place only [J].
    driven_work : float
        Work of constraints that follow a path of time [J].
    dt : float
        Time step [s].
    scene : Scene
    integrator : ContactScheme
        The scheme that took the step.
    start : StepStart
        Where the step began, and what acts on it.
    """

    q: Array
    v: Array
    lam: Array  # [N s, N m s]
    gaps: dict[str, float]  # [m, rad]
    modes: dict[str, str]
    contact: ContactSolution
    dynamics_error: float  # [N s, N m s]
    dynamics_limit: float  # [N s, N m s]
    constraint_error: float  # [m/s, rad/s]
    violation: float  # [m, rad]
    penetration: float  # [m, rad]
    energy_error: float  # [J]
    energy_limit: float  # [J]
    energy_lost: float  # [J]
    correction_work: float  # [J]
    algorithmic_work: float  # [J]
    driven_work: float  # [J]
    dt: float  # [s]
    scene: Scene
    integrator: ContactScheme
    start: StepStart
    _taken: Taken  # the step as it was posed and answered, for its derivatives
    _turns: str  # which body turns further than a step follows, if one does

    @one_blas_thread
    def derivatives(
        self, *, route: Route | None = None, wrt: Sequence[str] = ()
    ) -> StepDerivatives:
        """Return how q+ and v+ change with q, v, tau and what the contacts are made of.

        Parameters
        ----------
        route : Route, optional
            What is made of kinks and jumps: `ActiveSet()` by default, the derivatives within the
            modes of the step.
        wrt : sequence of {"friction", "restitution", "solref", "inertias"}
            What has to be in them beside q, v and tau. Inertias, ten columns a joint, are left out
            unless they are named; the others are there wherever the step depends on them.

        Returns
        -------
        StepDerivatives

        Raises
        ------
        InvalidArgument
            If the route cannot differentiate a step of this scheme, or by a parameter.
        SolveFailed
            If the contact problem has no answer that modes can be read off.
        StepFailed
            If a body turns further than a step follows it.

        Notes
        -----
        A route that takes other steps, such as `Softened`, takes this one again. Cost:
        `Route.cost`.
        """
        from condyn_pin.simulation.routes import ActiveSet, Route  # they are made of steps

        chosen = ActiveSet() if route is None else route
        if not isinstance(chosen, Route):
            raise InvalidArgument(f"route = {route!r}: a Route is needed, such as ActiveSet()")
        return chosen.differentiate(
            self.scene, self.integrator, self.dt, self.start, wrt, taken=self._taken
        )

    @property
    def status(self) -> ContactStatus:
        """OK if contacts are answered, energy kept, loops closed, and turns followed."""
        status, kept = self.contact.status, self._is_balanced and self._keeps_energy
        if status.ok and not (kept and self._is_closed and not self._turns):
            return ContactStatus.INACCURATE
        return status

    @property
    def notices(self) -> tuple[str, ...]:
        """What deserves attention, a sentence each."""
        said = []
        if not self._is_balanced:
            said.append(
                f"M (v+ - v) is off by {self.dynamics_error:.1e} N s or N m s, and at most "
                f"{self.dynamics_limit:.1e} is right: rounding is as large as what impulses do; "
                "look at contacts that the constraints hold but for a short lever, and at masses "
                "that are far apart"
            )
        if not self._is_closed:
            said.append(
                f"loops are open by {self.violation:.2g} m or rad where the step ends, and cannot "
                f"be closed from there: take a shorter step than {1e3 * self.dt:.4g} ms, from a "
                "state with closed loops"
            )
        said += [note.text for note in self._taken.notes]
        if not self._keeps_energy:
            said.append(
                f"the energy of the two states differs by {self.energy_error:.3g} J that no work "
                f"explains, and at most {self.energy_limit:.2g} J is right: bodies turn or move "
                f"too far in it, take a shorter one than {1e3 * self.dt:.4g} ms"
            )
        if self._turns:
            said.append(self._turns)
        return (*said, *self.contact.notices)

    @property
    def _keeps_energy(self) -> bool:
        """Whether the energies of both states differ by the work of the step, but for its order."""
        return not np.isfinite(self.energy_limit) or self.energy_error <= self.energy_limit

    @property
    def _is_balanced(self) -> bool:
        """Whether the step does what Newton and Euler ask for, to the accuracy of forces."""
        return self.dynamics_error <= self.dynamics_limit

    @property
    def _is_closed(self) -> bool:
        """Whether its loops end closed, but for drift."""
        return self.violation <= tolerances.OUT_OF_REACH

    @property
    def impulses(self) -> dict[str, Array]:
        """Impulses by constraint and by contact [N s, N m s], as `forces`."""
        return forces_of(self.scene, self.lam)

    @property
    def forces(self) -> dict[str, Array]:
        """Mean forces of the step by constraint, and by contact (t1, t2, n) [N, N m]."""
        return forces_of(self.scene, self.lam / self.dt)

    def __repr__(self) -> str:
        counted = [f"{n} {mode}" for mode, n in self._counts.items() if n]
        return (
            f"StepSolution({self.scene.robot.name}: {', '.join(counted) or 'no contacts'}; "
            f"{self.status.name.lower()})"
        )

    @property
    def _counts(self) -> dict[str, int]:
        modes = list(self.modes.values())
        return {mode: modes.count(mode) for mode in ("open", "stick", "slide")}

    def __str__(self) -> str:
        lines = [
            f"{self.scene.robot.name}, a step of {1e3 * self.dt:.4g} ms: {self.status}",
            f"natural residual {self.contact.natural:.1e}; "
            f"{self.contact.iterations} iterations of {', '.join(self.contact.path)}"
            if self.contact.path
            else "no contact takes part",
            f"dynamics    {self.dynamics_error:.1e} N s",
            f"constraints {self.constraint_error:.1e} m/s, {self.violation:.1e} m",
            f"penetration {self.penetration:.1e} m",
            f"contacts took {self.energy_lost:.4g} J, corrections brought "
            f"{self.correction_work:.2g} J, the step itself {self.algorithmic_work:.2g} J"
            + (f", drives {self.driven_work:.4g} J" if self.scene.is_driven else ""),
        ]
        for name, mode in self.modes.items():
            force = np.array2string(self.forces[name], precision=4, suppress_small=True)
            gap = f", gap {1e3 * self.gaps[name]:.4g} mm" if name in self.gaps else ""
            lines.append(f"{name:<28} {mode:<6} {force} N{gap}")
        if not self.status.ok:
            lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)
