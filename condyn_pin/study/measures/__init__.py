"""Measures: the quantities whose error a study measures, one file each.

Every module of this folder is imported once, and each measure in it registers itself, so that to
add a measure is to add one file (`measure.py` says what it must contain).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.study.measures.measure import MEASURES, Measure

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["MEASURES", "Measure"]
