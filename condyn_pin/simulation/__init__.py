"""A scene in motion.

Nouns: `Integrator`, a family a file in `integrators/`; the drift schemes in `drift/`; `Event`;
`Trajectory`, and many of them in `batch/`. Verbs: `simulate`, `switch`, and those for batches.

It must not know how motions are viewed, nor how they are compared.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
