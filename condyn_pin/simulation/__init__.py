"""A scene in motion.

Nouns: `Integrator`, a family a file in `integrators/`; the drift schemes in `drift/`; `Event`;
`Trajectory`, and many of them in `batch/`. Verbs: `simulate`, `switch`, and those for batches.

It must not know how its derivatives are taken, how motions are viewed, nor how they are compared.
"""

import lazy_loader

from condyn_pin._core import forward

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Rooms that have these since the last version.
_MOVED = {
    "stepping": (
        "Anitescu",
        "BatchStep",
        "EventDriven",
        "Moreau",
        "SoftStep",
        "StepSolution",
        "StewartTrinkle",
        "contact_problem",
        "step",
        "step_batch",
    ),
    "gradients": (
        "ActiveSet",
        "BatchStepDerivatives",
        "EventLocated",
        "Kappa",
        "ROUTES",
        "Randomised",
        "Route",
        "Softened",
        "StepDerivatives",
        "TrajectoryDerivatives",
        "step_derivatives_batch",
        "trajectory_derivatives",
    ),
}
__getattr__ = forward(
    __name__,
    _public,
    {name: f"{room}.{name}" for room, names in _MOVED.items() for name in names},
)
