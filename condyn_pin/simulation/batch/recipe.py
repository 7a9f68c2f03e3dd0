"""Recipe: what a worker makes its workspace from, once."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from threading import get_ident
from typing import Final

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.verbs import workspace_for
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument

# Workspaces that a process keeps: a study has dozens of scenes and solvers, each in turn.
_KEPT: Final = 32


@dataclass(frozen=True)
class Recipe:
    """A scene, its solver and its drift control."""

    scene: Scene
    solver: Solver | None = None
    drift: Baumgarte | None = None

    def workspace(self) -> Workspace:
        """Return this thread's workspace for them."""
        return workspace_for(self.scene, self.solver, self.drift)

    def pickled(self) -> PickledRecipe:
        """Return the recipe as it travels; InvalidArgument if it is of a class that cannot."""
        self.scene.robot.check_unedited()
        parts = self.scene, self.solver, self.drift
        try:
            pickled = pickle.dumps(parts, pickle.HIGHEST_PROTOCOL)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidArgument(
                f"solver = {self.solver!r}, drift = {self.drift!r}: workers need what pickles, "
                f"such as an object whose class is in a module ({error})"
            ) from error
        return PickledRecipe(blake2b(pickled, digest_size=16).digest(), pickled)


@dataclass(frozen=True)
class PickledRecipe:
    """A recipe that is equal to others with the same pickle: one of them need be unpickled."""

    token: bytes
    content: bytes = field(compare=False, repr=False)

    def workspace(self) -> Workspace:
        """Return the workspace of this thread, made when it is first asked for."""
        return _workspace(self, get_ident())


@lru_cache(_KEPT)
def _workspace(recipe: PickledRecipe, _thread: int) -> Workspace:
    scene, solver, drift = pickle.loads(recipe.content)
    return Workspace(scene, solver, drift=drift)
