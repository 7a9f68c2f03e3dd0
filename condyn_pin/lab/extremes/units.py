"""The same machine in other units of length, mass and time: every answer scales exactly.

With lengths times l, masses times m and times times t,

    angles   1      their v   1 / t      their a   1 / t^2      torques   m l^2 / t^2
    shifts   l      their v   l / t      their a   l / t^2      forces    m l / t^2

and gravity is an acceleration, inertia m l^2 at a turn, stiffness a torque over an angle, and
damping that times t.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.scene import Scene, check_bilateral
from condyn_pin.errors import InvalidArgument
from condyn_pin.lab.extremes.base import Case, Rng, by_reference, extreme, moving
from condyn_pin.model.robot import Robot

_SIZES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e1, 1e2, 1e3, 1e4, 1e6)


@extreme(*_SIZES)
def other_length(severity: float, rng: Rng, scene: Scene) -> Case:
    """How large the machine is, times its own size; gravity grows with it."""
    return _case(scene, rng, Units(length=severity))


@extreme(*_SIZES)
def other_mass(severity: float, rng: Rng, scene: Scene) -> Case:
    """How heavy the machine is, times its own mass."""
    return _case(scene, rng, Units(mass=severity))


@extreme(*(2.0**k for k in (0, -4, -10, -20, 4, 10, 20)))
def other_time(severity: float, rng: Rng, scene: Scene) -> Case:
    """How slow the machine is, times its own time; gravity falls with the square."""
    return _case(scene, rng, Units(time=severity))


def _case(scene: Scene, rng: Rng, units: Units) -> Case:
    model, state = scene.robot.model, moving(scene, rng)
    right = units.acceleration(model, by_reference(scene, *state))
    return Case(units.scene(scene), *units.state(model, *state), (right,))


@dataclass(frozen=True)
class Units:
    """What every length, mass and time is multiplied by.

    Attributes
    ----------
    length, mass, time : float
    """

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def state(self, model: Any, q: Array, v: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Return q, v and tau in these units."""
        along_q, along_v = self._along(model)
        return along_q * q, along_v / self.time * v, self._torque(along_v) * tau

    def acceleration(self, model: Any, a: Array) -> Array:
        """Return an acceleration in these units."""
        return np.asarray(self._along(model)[1] / self.time**2 * a)

    def scene(self, scene: Scene) -> Scene:
        """Return a scene in these units."""
        check_bilateral(scene)
        robot = scene.robot
        along_q, along_v = self._along(robot.model)
        torque = self._torque(along_v)
        model = self._bodies(robot.model)
        model.armature = torque / along_v * self.time**2 * model.armature
        model.damping = torque / along_v * self.time * model.damping
        for limit in ("lowerPositionLimit", "upperPositionLimit"):
            with np.errstate(over="ignore"):  # no limit at all stays none
                setattr(model, limit, along_q * getattr(model, limit))
        postures = {name: along_q * q for name, q in robot.postures.items()}
        springs = []
        for spring in robot.springs:
            i = model.joints[model.getJointId(spring.joint)].idx_v
            stiffness = float(torque[i] / along_v[i]) * spring.stiffness
            relaxed = float(along_v[i]) * spring.reference
            springs.append(replace(spring, stiffness=stiffness, reference=relaxed))
        name = f"{robot.name} in other units"
        in_units = Robot(
            name, model, postures, actuated=robot.actuated, springs=springs,
            precision=robot.precision,
        )  # fmt: skip
        return Scene(
            in_units,
            [self._constraint(constraint, robot.model) for constraint in scene.constraints],
        )

    def _constraint(self, constraint: Constraint, model: Any) -> Constraint:
        """Return a constraint with its lengths in these units."""
        along_q = self._along(model)[0]

        def of_joint(name: str) -> float:
            return float(along_q[model.joints[model.getJointId(name)].idx_q])

        return constraint.in_units(self.length, of_joint)

    def _along(self, model: Any) -> tuple[Array, Array]:
        """Return what each entry of q and of a shift or turn in v is multiplied by."""
        of_q, of_v = shifts(model)
        return np.where(of_q, self.length, 1.0), np.where(of_v, self.length, 1.0)

    def _torque(self, along_v: Array) -> Array:
        """Return what each entry of tau is multiplied by: energy over shift or turn."""
        return np.asarray(self.mass * (self.length / self.time) ** 2 / along_v)

    def _bodies(self, model: Any) -> Any:
        """Return a copy of a model with gravity, placements and inertias in these units."""
        model, length = pin.Model(model), self.length
        model.gravity.linear = length / self.time**2 * model.gravity.linear
        for i in range(model.njoints):
            model.jointPlacements[i].translation *= length
            body = model.inertias[i]
            model.inertias[i] = pin.Inertia(
                self.mass * body.mass, length * body.lever, self.mass * length**2 * body.inertia
            )
        for frame in model.frames:
            frame.placement.translation *= length
        return model


def shifts(model: Any) -> tuple[Array, Array]:
    """Return where q and v hold lengths: (nq,) and (nv,), one or zero."""
    of_q, of_v = np.zeros(model.nq), np.zeros(model.nv)
    for joint in model.joints:
        kind = joint.shortname().removeprefix("JointModel")
        if joint.idx_q < 0 or kind.startswith(("R", "Spherical")):
            continue
        if kind not in ("FreeFlyer", "Translation", "PX", "PY", "PZ", "PrismaticUnaligned"):
            raise InvalidArgument(f"a joint of the kind {kind} mixes angles and lengths")
        size = min(joint.nv, 3)
        of_q[joint.idx_q : joint.idx_q + size] = of_v[joint.idx_v : joint.idx_v + size] = 1.0
    return of_q, of_v
