"""Kappa: contacts seen from within their cones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core.arrays import Array, finite
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.routes.barrier import Barrier
from condyn_pin.simulation.routes.base import LawRoute
from condyn_pin.simulation.routes.law import Law


@dataclass(frozen=True)
class Kappa(LawRoute):
    """The derivatives of a step whose contacts obey a smooth law, near to Coulomb's by kappa.

    lam_n sigma_n = k,    mu lam_n eta + lam_t . sigma_t = k,    mu lam_n sigma_t + eta lam_t = 0
    k = kappa (m g dt) (g dt)

    with eta > 0 and lam within its cone: where interior point methods for Coulomb's law pass on
    their way to k = 0. Contacts push a little before they touch, and creep before they slip; where
    the step has kinks, the slopes go over from one side to the other.

    Parameters
    ----------
    kappa : float
        Smoothness, relative to the weight of the robot and the velocity that gravity gives in the
        step [1]. 1e-2 rounds a kink over a tenth of the weight, 1e-6 over a thousandth.

    Notes
    -----
    The step that is differentiated has other impulses than the one that was taken: `q` and `v` of
    the result are its own end. No mode is needed, and there is a slope everywhere.

    References
    ----------
    Howell, Le Cleac'h, Bruedigam, Kolter, Schwager, Manchester. Dojo: a differentiable physics
    engine for robotics. arXiv:2203.00806, 2022.
    """

    title: ClassVar[str] = "kappa"
    cost: ClassVar[str] = "as ActiveSet, and 10 to 40 steps of Newton's method"
    use: ClassVar[str] = "in optimisers that begin far away: smooth, and with a slope in stick"

    kappa: float = 1e-4

    def __post_init__(self) -> None:
        kappa = float(finite("kappa", self.kappa, ()))
        if not 1e-12 <= kappa <= 1e3:
            raise InvalidArgument(
                f"kappa = {self.kappa!r}: a number from 1e-12 to 1e3; ActiveSet() has none"
            )
        object.__setattr__(self, "kappa", kappa)

    def law(self, problem: ContactProblem, lam: Array, size: float) -> Law:
        """Return the impulses of the smooth law, and the law linearised at them."""
        barrier = Barrier(problem, self.kappa, size)
        return barrier.law(barrier.solve())
