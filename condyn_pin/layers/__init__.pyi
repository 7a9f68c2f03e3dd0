# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .configurations import tangent_gradient as tangent_gradient
from .jax_layer import jax_solve as jax_solve
from .torch_layer import torch_solve as torch_solve
