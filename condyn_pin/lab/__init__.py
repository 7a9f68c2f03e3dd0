"""The laboratory: hard questions, benchmark problems, model hierarchies, drift.

`extremes/` tests what breaks methods, `problems/` has answers from the literature, `hierarchy.py`
scenes that become smaller one by one. Only `cli` and tests import this room.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
