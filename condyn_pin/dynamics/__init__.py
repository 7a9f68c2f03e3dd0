"""One state: the two equations, their solution, its verification, and its derivatives.

    M(q) a + h(q, v) = tau + J(q)^T lam,    J(q) a + gamma(q, v) = a_ref

Nouns: `Scene`, a robot and exactly its constraints; `Workspace`, which alone changes; `Solver`, one
file each in `solvers/`; `Solution` with its `Residuals`; `Derivatives`; `Impact`.

To solve is not to analyse: it must not know `mechanism`, nor time.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
