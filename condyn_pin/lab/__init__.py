"""The laboratory: hard questions, benchmark problems, model hierarchies, drift.

`extremes/` asks what breaks methods, `problems/` has answers from the literature, `ladders/` scenes
that become smaller one by one. Asked for by name; only `cli` and tests import it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
