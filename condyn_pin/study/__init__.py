"""What accuracy costs: time against error.

Nouns: `Study`, `Table`, `Row`, `Measure`; `bench` times the main job, `tune` chooses a solver, and
`mujoco/` has a robot beside the same in MuJoCo. It alone looks at a clock.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
