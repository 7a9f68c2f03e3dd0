"""A scene in motion.

Nouns: `Integrator`, a family a file in `integrators/`; the drift schemes in `drift/`; `Event`;
`Trajectory`, and many of them in `batch/`. Verbs: `simulate`, `switch`, and those for batches.

It must not know how its derivatives are taken, how motions are viewed, nor how they are compared.
"""

from importlib import import_module
from typing import Any
from warnings import warn

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Names of the last version that other rooms have now; they go with the next.
_MOVED: dict[str, str] = {
    "ActiveSet": "gradients",
    "Anitescu": "stepping",
    "BatchStep": "stepping",
    "BatchStepDerivatives": "gradients",
    "EventDriven": "stepping",
    "EventLocated": "gradients",
    "Kappa": "gradients",
    "Moreau": "stepping",
    "ROUTES": "gradients",
    "Randomised": "gradients",
    "Route": "gradients",
    "SoftStep": "stepping",
    "Softened": "gradients",
    "StepDerivatives": "gradients",
    "StepSolution": "stepping",
    "StewartTrinkle": "stepping",
    "TrajectoryDerivatives": "gradients",
    "contact_problem": "stepping",
    "step": "stepping",
    "step_batch": "stepping",
    "step_derivatives_batch": "gradients",
    "trajectory_derivatives": "gradients",
}


def __getattr__(name: str) -> Any:
    if room := _MOVED.get(name):
        now = f"condyn_pin.{room}.{name}"
        warn(f"{__name__}.{name} is {now} now", DeprecationWarning, stacklevel=2)
        return getattr(import_module(f"condyn_pin.{room}"), name)
    return _public(name)
