# Every public name of this room, and the file that has it; `__init__.py` reads this file.

from .crocoddyl import Action as Action
from .crocoddyl import crocoddyl_action as crocoddyl_action
from .maps import Layer as Layer
from .maps import tangent_gradient as tangent_gradient
from .torch_and_jax import jax_simulate as jax_simulate
from .torch_and_jax import jax_solve as jax_solve
from .torch_and_jax import jax_step as jax_step
from .torch_and_jax import torch_simulate as torch_simulate
from .torch_and_jax import torch_solve as torch_solve
from .torch_and_jax import torch_step as torch_step
