"""Routes to the derivatives of a step with contacts: one file a route.

Nouns: `Route`, a way over kinks and jumps; `StepDerivatives`, what it finds, and
`BatchStepDerivatives`, at many states. Verbs: `step_derivatives_batch`; `trajectory_derivatives`,
through all steps of a motion.
"""

from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.event_located import EventLocated
from condyn_pin.gradients.routes.kappa import Kappa
from condyn_pin.gradients.routes.randomised import Randomised
from condyn_pin.gradients.routes.route import ROUTES, Route
from condyn_pin.gradients.routes.softened import Softened

__all__ = [
    "ROUTES", "ActiveSet", "EventLocated", "Kappa", "Randomised", "Route", "Softened",
]  # fmt: skip
