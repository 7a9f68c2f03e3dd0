"""Tasks: what a controller is to do, one kind a file.

Every module of this folder is imported once, and each task in it registers itself, so that to add
a task is to add one file (`task.py` says what it must contain).
"""

from importlib import import_module
from pkgutil import iter_modules

from condyn_pin.control.tasks.task import TASKS, Task

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")

__all__ = ["TASKS", "Task"]
