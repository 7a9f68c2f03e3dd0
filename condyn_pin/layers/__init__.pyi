# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .crocoddyl import Action as Action
from .crocoddyl import crocoddyl_action as crocoddyl_action
from .jax_layer import jax_simulate as jax_simulate
from .jax_layer import jax_solve as jax_solve
from .jax_layer import jax_step as jax_step
from .maps import Layer as Layer
from .maps import tangent_gradient as tangent_gradient
from .torch_layer import torch_simulate as torch_simulate
from .torch_layer import torch_solve as torch_solve
from .torch_layer import torch_step as torch_step
