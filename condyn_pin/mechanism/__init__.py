"""Mechanism: closed states, rank and mobility, branches, and smaller scenes.

Verbs: assemble, sample, project, complete, check, rank, summarise; `reduction` has what may be
left out of a scene. Nouns: `Assembly`, `Rank`, `Summary`, `CompleteState`, `ReducedScene`.

It takes the equations from `dynamics`, and must not know motions.
"""

import lazy_loader

from condyn_pin._core import forward

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = forward(__name__, _public, {"put_down": "mechanism.place_on_ground"})
