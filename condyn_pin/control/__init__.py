"""Control: which joints have motors, inverse dynamics and transmission, and whole-body control.

Nouns: `Actuation`, `InverseDynamics`, `OperationalSpace`, `Transmission`; `Controller`, `Task`,
`Hierarchy`, `ControlAnswer`, `QPSolver`; `ForceDistribution`; `Balance`, `SupportPolygon`.

    B u + J^T lam = M a + h - passive

It must not know simulations.
"""

import lazy_loader

from condyn_pin._core import forward

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = forward(__name__, _public, {"Give": "control.Relaxation"})
