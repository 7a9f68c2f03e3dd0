"""Mechanism: closed states, rank and mobility, branches, and smaller scenes.

Verbs: assemble, sample, project, complete, check, rank, summarise; `reduction` has what may be
left out of a scene. Nouns: `Assembly`, `Rank`, `Summary`, `CompleteState`, `ReducedScene`.

It takes the equations from `dynamics`, and must not know motions.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
