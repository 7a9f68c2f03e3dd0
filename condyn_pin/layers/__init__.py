"""Answers as differentiable layers, for learning and optimisation.

Nouns: `Layer`, a function of arrays that another library differentiates through, and `Action`, a
step as optimal control has it. Verbs: `torch_solve`, `torch_step`, `torch_simulate`, the same of
jax, and `crocoddyl_action`. `Layer` says what all layers have in common; `tangent_gradient` makes
of a gradient by the numbers of q what ``pin.integrate`` steps along.

It must not know how motions are viewed, nor how they are compared.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
