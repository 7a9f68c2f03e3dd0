"""Control: which joints have motors, what these can do, and what they feel.

Nouns: `Actuation`, `InverseDynamics`, `OperationalSpace`, `Transmission`.

    B u + J^T lam = M a + h - passive

It must not know motions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
