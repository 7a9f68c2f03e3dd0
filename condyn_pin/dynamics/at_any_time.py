"""What is the same for a scene at all times: J, and what is measured with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene

_OF = "_at_any_time"


def at_any_time(scene: Scene) -> Scene:
    """Return the scene that a scene is at a time, if that closes; or else the scene itself."""
    of: Scene = vars(scene).get(_OF, scene)
    return of if of is scene or of.nominal.closed else scene


def placed_in_time(scene: Scene, of: Scene) -> Scene:
    """Return a scene, which is another one at a time."""
    vars(scene)[_OF] = vars(of).get(_OF, of)
    return scene
