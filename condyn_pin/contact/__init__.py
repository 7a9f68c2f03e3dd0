"""Contacts that open and slide: friction cones, and contact problems with their solvers.

Nouns: `FrictionCone`, `WrenchCone`, `Margin`, `ConeRows`; `ContactProblem`, `ContactSolution` and
its solvers. Verbs: `margins`, `cone_rows`, `solve_contact`.

It takes forces as arrays, and must not know how a motion was computed.
"""

import lazy_loader

from condyn_pin._core import forward

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = forward(__name__, _public, {"Attempt": "contact.SolverResult"})
