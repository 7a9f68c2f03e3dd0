"""The commands of `condyn`, one file each.

1. The file is named as the command, and so is its function; typer reads its signature.
2. ``PANEL`` says under which heading ``condyn --help`` lists it: one of `PANELS`.
3. The library is imported in the function: ``condyn doctor`` must run where Pinocchio does not
   import, and ``condyn --help`` at once.
4. `arguments` has the arguments that commands share, `words` what they mean, `output` the console,
   what Ctrl-C keeps, and the checks of files that are to be written. What only fails at the end of
   a run is refused before it.
5. Exit code 0 is an answer, 1 an answer that is not ok, 2 a question that cannot be answered, 3 a
   defect of ours, 130 an interrupt. What is raised becomes one line; ``--debug`` shows where.
6. What prints an answer takes ``--json`` (`arguments.AsJson`, `output.print_json`): then there is
   json on stdout and nothing else. What loads a robot takes ``--variant`` (`arguments.Variant`).
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from types import ModuleType

PANELS = ("Look", "Solve", "Simulate", "Measure")


def commands(package: str = __name__) -> dict[str, ModuleType]:
    """Return the module of every command in a package by its name, panel after panel."""
    folder = import_module(package).__path__
    modules = {m.name: import_module(f"{package}.{m.name}") for m in pkgutil.iter_modules(folder)}
    return dict(sorted(modules.items(), key=lambda item: PANELS.index(item[1].PANEL)))
