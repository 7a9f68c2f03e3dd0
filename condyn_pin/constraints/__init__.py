"""Constraints as users name them, their rows in a model, and the right side of those rows.

External forces, which act on the same frames, are here too.

Nouns: `Constraint` and its kinds, a file each, with its contract in `constraint`; `AppliedForce`;
`BoundConstraint`, one on joints and columns; `Equations`, which has their M, h, J and gamma;
`ConstraintPartials`, how these change; `Drift` and `Baumgarte`, which say what a_ref is.

    J(q) a + gamma(q, v) = a_ref

It takes a `pinocchio.Model`, and must not know robots, scenes or solvers.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
