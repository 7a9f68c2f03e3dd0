"""Effects: what of a robot acts in a simulation."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Effects:
    """Which of the effects that a robot's model describes are on.

    Parameters
    ----------
    gravity : bool
        Otherwise nothing has weight.
    springs, damping : bool
        Those of the joints and between frames. Pinocchio leaves them out of its dynamics; a
        simulation adds them.
    armature : bool
        The inertia of the rotors. Otherwise M is that of the links alone.
    """

    gravity: bool = True
    springs: bool = True
    damping: bool = True
    armature: bool = True

    def __post_init__(self) -> None:
        for field in fields(self):
            if not isinstance(getattr(self, field.name), bool):
                raise InvalidArgument(
                    f"{field.name} = {getattr(self, field.name)!r}: True or False is needed"
                )

    def applied_to(self, scene: Scene) -> Scene:
        """Return the scene whose model has no gravity or armature where these are off."""
        if self.gravity and self.armature:
            return scene
        model = pin.Model(scene.robot.model)
        if not self.gravity:
            model.gravity = pin.Motion.Zero()
        if not self.armature:
            model.armature[:] = 0.0
        return replace(scene, robot=replace(scene.robot, model=model))

    def text(self, robot: Robot) -> str:
        """Return in words what is on, what is off, and what the robot does not have."""
        model = robot.model
        between = robot.spring_dampers
        springs = sum(spring.stiffness != 0 for spring in robot.springs)
        springs += sum(spring.stiffness != 0 for spring in between)
        has = {
            "gravity": bool(model.gravity.linear.any()) or not self.gravity,
            "springs": springs > 0,
            "damping": bool(model.damping.any()) or any(each.damping for each in between),
            "armature": bool(model.armature.any()) or not self.armature,
        }
        on = [name for name in has if getattr(self, name) and has[name]]
        off = [name for name in has if not getattr(self, name)]
        none = [name for name in has if getattr(self, name) and not has[name]]
        parts = (("on: ", on), ("off: ", off), ("not in the model: ", none))
        return "; ".join(title + ", ".join(names) for title, names in parts if names)
