"""Robots: a `pinocchio.Model` with names, postures, motors, springs, and checks that it is sound.

Nouns: `Robot`, `Spring`, `SpringDamper`; `mechanisms/` has robots with parameters.

It knows no file, which is for `io`, and no scene.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
