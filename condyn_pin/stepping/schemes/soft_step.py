"""SoftStep: MuJoCo's compliant contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import Law
from condyn_pin.dynamics.solvers.soft import (
    DEFAULT_SOLIMP,
    DEFAULT_SOLREF,
    SolImp,
    SolRef,
    check_softness,
    impedance,
    impedance_slope,
    reference,
    reference_by,
)
from condyn_pin.simulation.integrators.contact_scheme import (
    ActiveContacts,
    BiasPartials,
    ContactScheme,
)
from condyn_pin.simulation.integrators.integrator import Stepper
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import contact_stepper


@dataclass(frozen=True)
class SoftStep(ContactScheme):
    """A convex step with springs and dampers in the contacts, like MuJoCo's.

    K* contains sigma = (G + R) lam + dt (J a_free - a_ref),    R = (1 - d) / d G_nn,
    a_ref = -b J v - k gap  along the normal,    -b J v  across it

    Resting bodies sink in a little, sticking ones creep, and sliding ones lift off: a compliant
    version of `Anitescu`. MuJoCo takes for G_nn what the centre of mass of the body feels at
    the first posture, w = `body_invweight0`; here it is that of the contact in the step. Of a box
    it is 5.6 w, which rests 0.46 mm deep here and 0.11 mm there; with the impedances
    d / (d + (1 - d) w / G_nn) in `solimp` both are as deep. J' v is left out, which MuJoCo does not
    use in contacts.

    Parameters
    ----------
    contact : ContactSolver
        What answers the contact problem of each step.
    solref : (timeconst, dampratio), or (-stiffness, -damping)
        As in `condyn_pin.dynamics.Soft` [s, 1; 1/s^2, 1/s]. A timeconst below 2 dt counts as 2 dt,
        as in MuJoCo: a spring that is stiffer throws off what rests.
    solimp : (d_0, d_width, width, midpoint, power)
        As in `condyn_pin.dynamics.Soft`, `width` in [m, rad].

    Raises
    ------
    InvalidArgument
        If the numbers of `solref` differ in sign, or one of `solimp` is out of its range.

    References
    ----------
    Todorov. Convex and analytically-invertible dynamics with contacts and constraints: theory and
    implementation in MuJoCo. ICRA, 2014.
    """

    title: ClassVar[str] = "soft step"
    use: ClassVar[str] = "to see what MuJoCo sees"
    law: ClassVar[Law] = "ccp"
    penetrates_at_rest: ClassVar[bool] = True

    solref: SolRef = DEFAULT_SOLREF  # [s, 1], or [1/s^2, 1/s]
    solimp: SolImp = DEFAULT_SOLIMP

    def __post_init__(self) -> None:
        super().__post_init__()
        solref, solimp = check_softness(self.solref, self.solimp)
        object.__setattr__(self, "solref", solref)
        object.__setattr__(self, "solimp", solimp)

    def near(self, gaps: Array, v: Array, dt: float) -> NDArray[np.bool_]:
        """Flags of touching contacts."""
        return np.asarray(gaps <= 0)

    def bias(self, near: ActiveContacts) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] and R (m,) [1/kg] of contacts that are `near`."""
        c, d, solref = self._given(near)
        a_ref = reference(c, near.before, d, solref, self.solimp)
        R = (1 - d) / d * near.stiffness
        return near.free - near.before - near.dt * a_ref, R

    def bias_partials(self, near: ActiveContacts) -> BiasPartials:
        """Partial derivatives of `bias` by `near`."""
        c, d, solref = self._given(near)
        d_gap = np.sign(near.depth) * impedance_slope(np.abs(near.depth), self.solimp)
        b, k, k_d, by_solref = reference_by(c, near.before, d, solref, self.solimp)
        if solref[0] != self.solref[0]:  # 2 dt in its place
            by_solref[:, 0] = 0.0
        return BiasPartials(
            gaps=(near.dt * (k + k_d * d_gap * c))[near.normals],
            before=np.full_like(c, near.dt * b - 1.0),
            solref=-near.dt * by_solref, R_gaps=-d_gap / d**2 * near.stiffness,
            R_stiffness=(1 - d) / d,
        )  # fmt: skip

    def _given(self, near: ActiveContacts) -> tuple[Array, Array, SolRef]:
        """Return gaps (m,), zero across the normal, impedances (m,), and solref as it counts."""
        c = np.zeros_like(near.free)
        c[near.normals] = near.gaps
        one, two = self.solref
        solref = (max(one, 2 * near.dt) if one > 0 else one, two)
        return c, impedance(np.abs(near.depth), self.solimp), solref

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return contact_stepper(self, system, dt)
