"""The laboratory: hard questions, benchmark problems, model hierarchies, drift.

It measures the library, and is no part of it: `extremes/` tests what breaks methods, `problems/`
has answers from the literature, `hierarchy.py` scenes that become smaller one by one, `drift.py`
what integrators do to gaps and energy. `python benchmarks/lab --help` has its commands; a script
with `benchmarks` on its path may ``import lab``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
