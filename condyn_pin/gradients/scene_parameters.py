"""Parameters of a scene by name, ``owner/quantity``, and the scenes that differ in them.

    knee/mass  knee/centre.x  knee/place.x  knee/damping     the body of a joint, and the joint
    knee/stiffness  knee/reference                           its spring
    a - b/stiffness  a - b/damping  a - b/rest_length        a spring-damper between two frames
    loop/frame_a.x  loop/frame_b.x  rod/length               a loop, the place of its ends
    foot/friction  knee/friction/torque                      a contact, dry friction of a joint

The centre of mass stays while the mass changes, and the inertia about it grows with the mass.
Places are those of frames on the joints that carry them, and of joints on their parents.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.joint_friction import JointFriction
from condyn_pin.constraints.places import short_frames
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import unknown_name

_PLACES: Final = ("centre", "place", "frame_a", "frame_b")
_LENGTH_STEP: Final = 1e-5  # of differences by places [m]
_SHARE_STEP: Final = 1e-3  # of differences by all other parameters, of their size


class _Parameter(NamedTuple):
    """Where a number of a scene is."""

    part: str  # of `_Draft`
    i: int
    key: str
    axis: int = 0

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest physical value."""
        most = tolerances.MOST_FRICTION if self.key == "friction" else inf
        return (-inf if self.key in (*_PLACES, "reference") else 0.0), most


class _Draft:
    """A scene as parts that can be changed."""

    def __init__(self, scene: Scene) -> None:
        self.robot, self.changed = scene.robot, False  # the robot
        self.model = pin.Model(scene.robot.unedited)
        self.parts: dict[str, list[Any]] = {
            "springs": list(scene.robot.springs),
            "spring_dampers": list(scene.robot.spring_dampers),
            "constraints": list(scene.constraints),
            "contacts": [
                replace(c, torque=bound.dry[0].limit) if isinstance(c, JointFriction) else c
                for c, bound in zip(scene.contacts, scene.contact_bounds, strict=True)
            ],
        }

    def scene(self) -> Scene:
        """Scene of these parts."""
        springs, dampers, constraints, contacts = self.parts.values()
        robot = self.robot
        if self.changed:
            robot = replace(robot, model=self.model, springs=springs, spring_dampers=dampers)
        return Scene(robot, constraints, contacts)

    def names(self) -> Iterator[tuple[str, _Parameter]]:
        """Yield the parameters with their names."""
        for i, joint in enumerate(self.robot.joints, start=1):
            has_mass = self.model.inertias[i].mass > 0.0
            for key in ("mass", "centre") * has_mass + ("place", "damping"):
                yield from _along(joint, _Parameter("joints", i, key))
        keys = {
            "springs": ("stiffness", "reference"),
            "spring_dampers": ("stiffness", "damping", "rest_length"),
            "constraints": ("length", "frame_a", "frame_b"),
            "contacts": ("friction", "torque"),
        }
        owners = ((part, *each) for part in keys for each in enumerate(self.parts[part]))
        for at, i, owner in owners:
            for key in keys[at]:
                its = getattr(owner, key, None)
                if isinstance(its, str if key in _PLACES else int | float):
                    yield from _along(_name_of(owner), _Parameter(at, i, key))

    def value(self, at: _Parameter) -> float:
        """Return the value of a parameter."""
        part, i, key, axis = at
        if part != "joints":
            value = getattr(self.parts[part][i], key)
            return float(self.robot.frame(value)[1].translation[axis] if key in _PLACES else value)
        if key == "damping":
            return float(self.model.damping[self.model.idx_vs[i]])
        body = self.model.inertias[i]
        if key == "mass":
            return float(body.mass)
        place = body.lever if key == "centre" else self.model.jointPlacements[i].translation
        return float(place[axis])

    def put(self, at: _Parameter, x: float) -> None:
        """Change the value of a parameter."""
        part, i, key, axis = at
        self.changed |= part not in ("constraints", "contacts")
        if part != "joints":
            self._put_in_part(at, x)
        elif key == "damping":
            damping, first = np.array(self.model.damping), self.model.idx_vs[i]
            damping[first : first + self.model.nvs[i]] = x
            self.model.damping = damping
        elif key == "place":
            self.model.jointPlacements[i] = _moved(self.model.jointPlacements[i], axis, x)
        else:
            old = self.model.inertias[i]
            lever, mass = np.array(old.lever), old.mass
            if key == "mass":
                mass = x
            else:
                lever[axis] = x
            self.model.inertias[i] = pin.Inertia(mass, lever, old.inertia * (mass / old.mass))

    def _put_in_part(self, at: _Parameter, x: float) -> None:
        part, i, key, axis = at
        old, value = self.parts[part][i], x
        if key in _PLACES:
            joint, placement = self.robot.frame(getattr(old, key))
            value = joint, _moved(placement, axis, x)  # type: ignore[assignment]
        self.parts[part][i] = replace(old, **{key: value})


def _along(owner: str, at: _Parameter) -> Iterator[tuple[str, _Parameter]]:
    """Yield a parameter with its name, or of a place each coordinate."""
    if at.key not in _PLACES:
        yield f"{owner}/{at.key}", at
        return
    for axis, letter in enumerate("xyz"):
        yield f"{owner}/{at.key}.{letter}", at._replace(axis=axis)


def _name_of(owner: Any) -> str:
    """Name of a constraint or contact, the joint of a spring, the frames of a spring-damper."""
    if hasattr(owner, "rest_length"):
        return f"{short_frames(owner.frame_a)} - {short_frames(owner.frame_b)}"
    return str(owner.joint if hasattr(owner, "reference") else owner.name)


def _moved(placement: Any, axis: int, x: float) -> Any:
    """Placement with another coordinate."""
    p = placement.translation.copy()
    p[axis] = x
    return pin.SE3(placement.rotation, p)


class SceneParameters:
    """Scenes that differ in some parameters p.

    Attributes
    ----------
    start, lower, upper : (n,) array
        Values in the scene itself, and what is physical.
    """

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        draft = _Draft(scene)
        known = dict(draft.names())
        for name in names:
            if name not in known:
                raise unknown_name("parameter", name, known)
        self._scene, self._places = scene, [known[name] for name in names]
        self.start = np.array([draft.value(each) for each in self._places])
        self.lower, self.upper = np.array([each.bounds for each in self._places]).T

    def scene(self, p: Array) -> Scene:
        """Scene of parameters p."""
        draft = _Draft(self._scene)
        for at, x in zip(self._places, p.tolist(), strict=True):
            draft.put(at, x)
        return draft.scene()

    def beside(self, scene: Scene, i: int) -> tuple[Scene, Scene, float]:
        """Scenes on both sides of a scene along parameter i, and their distance.

        Beside a bound the scene is not in the middle: equations are linear there.
        """
        at, h = self._places[i], _LENGTH_STEP
        if at.key not in (*_PLACES, "length"):
            h = _SHARE_STEP * (self.start[i] if self.start[i] > 0.0 else 1.0)
        draft = _Draft(scene)
        down = draft.value(at) - h
        if self.lower[i] == 0.0:
            down = max(down, 0.1 * h)
        draft.put(at, down)
        one = draft.scene()
        draft = _Draft(scene)
        draft.put(at, down + 2.0 * h)
        return draft.scene(), one, 2.0 * h
