"""Derivatives of steps with contacts, and of motions; parameters from logs.

    x' = step(x, tau, p),    dx' = A dx + B dtau + C dp

Nouns: `Route`, a way over kinks and jumps, a file each in `routes/`; `StepDerivatives`,
`BatchStepDerivatives`, `TrajectoryDerivatives`. Verbs: `step_derivatives_batch`,
`trajectory_derivatives`, and `fit`, which makes a `Fit` of a `PoseLog` or a `TorqueLog`.

It must not know which library differentiates through it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
