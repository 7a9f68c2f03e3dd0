"""Answers as layers of programs that learn and optimise.

Noun: `Action`, a step as optimal control has it. Verbs: `torch_solve`, `torch_step`, `jax_solve`,
`jax_step`, `crocoddyl_action`. A layer is a function of (q, v, tau) with leading axes for
batches, and its derivatives are those of the library. Gradients by q have an entry for each number
of q, quaternions included; `tangent_gradient` makes of them what ``pin.integrate`` steps along.

It must not know how motions are looked at, nor how they are compared.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
