"""The equations of a thread's last scene: their memory takes longer to make than to use."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from condyn_pin.constraints.rows.equations import Equations

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene

_last = threading.local()


def equations_of(scene: Scene) -> Equations:
    """Return this thread's equations of a scene: the last ones, or new ones.

    What they return is yours; what they refer to is overwritten by their next use.
    """
    scene.robot.check_unedited()
    equations: Equations | None = getattr(_last, "equations", None)
    if equations is None or _last.scene is not scene:
        equations = Equations(scene.robot.model, scene.bounds)
        _last.equations, _last.scene = equations, scene
    return equations
