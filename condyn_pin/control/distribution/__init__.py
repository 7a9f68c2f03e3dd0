"""Force distributions: which of many contact forces and torques to take, one criterion a file.

Every module of this folder is imported once, and each criterion in it registers itself, so that to
add one is to add one file (`force_distribution.py` says what it must contain).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.control.distribution.force_distribution import DISTRIBUTIONS, ForceDistribution

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["DISTRIBUTIONS", "ForceDistribution"]
