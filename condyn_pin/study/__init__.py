"""Work-precision studies: time against error.

Nouns: `Study`, `Table`, `Row`, `Measure`; `bench` times the main job, `tune` chooses a solver, and
`mujoco/` compares a robot with the same robot in MuJoCo. No other room measures time.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
