"""Nonholonomic machines: steering in chained form, reduced and vakonomic motion.

Nouns: `ChainedForm`, `SteeringPlan`, `ChaplyginReduction`, `VakonomicMotion`.

    A(q) v = 0,    which restricts v, and none of the places

What kind of rows a scene has, how far brackets lead and curvatures are of `mechanism`, and motions
of machines of `simulation`. It must not know controllers.
"""

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = _public
