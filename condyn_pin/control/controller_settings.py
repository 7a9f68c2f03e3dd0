"""Settings: what stays of a controller when its contacts and tasks are switched."""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin._core.arguments import check_accuracy
from condyn_pin._core.compiled import Native, check_native
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.control_limits import ControlLimits
from condyn_pin.control.qp.base import QPSolver
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class Settings:
    """What a `Controller` is made with, but for scene and tasks; each is as its docstring says."""

    cones: Cones
    qp: QPSolver | None
    limits: ControlLimits
    actuation: Actuation | None
    drift: Baumgarte | None
    regularisation: float
    rigid: tuple[str, ...]
    native: Native

    def __post_init__(self) -> None:
        check_accuracy("regularisation", self.regularisation)
        if self.regularisation == 0:
            raise InvalidArgument("regularisation = 0: the program may then have many solutions")
        object.__setattr__(self, "regularisation", float(self.regularisation))
        if self.qp is not None and not isinstance(self.qp, QPSolver):
            raise InvalidArgument(f"qp = {self.qp!r}: a solver such as ProxQP() is needed")
        if not isinstance(self.limits, ControlLimits):
            raise InvalidArgument(f"limits = {self.limits!r}: ControlLimits(...) is needed")
        if not isinstance(self.drift, Baumgarte | None):
            raise InvalidArgument(
                f"drift = {self.drift!r}: Baumgarte(alpha, beta) or None is needed"
            )
        check_native(self.native)
