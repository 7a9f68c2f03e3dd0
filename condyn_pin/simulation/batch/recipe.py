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
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument

# Workspaces that a process keeps: a study has dozens of scenes and solvers, each in turn.
_KEPT: Final = 32


@dataclass(frozen=True)
class Recipe:
    """A scene, its solver and its drift control, as they travel.

    Two recipes are equal if their pickles are: whoever has made a workspace from one need not
    unpickle the other.
    """

    token: bytes
    pickled: bytes = field(compare=False, repr=False)

    @classmethod
    def of(cls, scene: Scene, solver: Solver | None, drift: Baumgarte | None) -> Recipe:
        """Return the recipe of a workspace.

        Raises
        ------
        InvalidArgument
            If the solver or the drift control is of a class that cannot travel.
        """
        scene.robot.check_unedited()
        try:
            pickled = pickle.dumps((scene, solver, drift), pickle.HIGHEST_PROTOCOL)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidArgument(
                f"solver = {solver!r}, drift = {drift!r}: workers need what pickles, such as an "
                f"object whose class is in a module ({error})"
            ) from error
        return cls(blake2b(pickled, digest_size=16).digest(), pickled)

    def workspace(self) -> Workspace:
        """Return the workspace of this thread, made when it is first asked for."""
        return _workspace(self, get_ident())


@lru_cache(_KEPT)
def _workspace(recipe: Recipe, _thread: int) -> Workspace:
    scene, solver, drift = pickle.loads(recipe.pickled)
    return Workspace(scene, solver, drift=drift)
