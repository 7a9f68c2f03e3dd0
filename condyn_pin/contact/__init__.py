"""Contacts that may let go: friction cones, and contact problems with their solvers.

Nouns: `FrictionCone`, `WrenchCone`, `Margin`, `ConeRows`; `ContactProblem`, `ContactSolution` and
its solvers. Verbs: `margins`, `cone_rows`, `solve_contact`.

It takes forces as arrays, and must not know how a motion was computed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
