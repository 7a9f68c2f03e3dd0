"""Hard questions of contact: families of contact problems from tame to absurd, one file each.

Every module of this folder is imported once, and each function marked with `contact_extreme` enters
`CONTACT_EXTREMES` under its name, so that to add a family is to add one file (`base.py` says what
it must return).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.lab.contact_extremes.base import CONTACT_EXTREMES

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["CONTACT_EXTREMES"]
