"""The capture point, drawn back by a pressure on the line that leads back.

An inverted pendulum of constant height h has c'' = omega^2 (c - p), and its capture point

    xi = c + c' / omega,    xi' = omega (xi - p),    omega = sqrt(g / h).

The pressure p = xi_r + (1 + k) (xi - xi_r) lets it decay with k omega. Where that is beyond the
edge of the support, it is moved towards xi_r,

    p = xi_r + s (1 + k) (xi - xi_r),    s <= 1,

so xi comes back along the line on which it is. The feasible pressure nearest to one far beyond the
edge is a corner as a rule: it unloads feet that the line needs, and springs throw these off.

The pressure of the feet ends at the edge; what p is beyond it, a moment n = m g (p - p_feet) about
the centre of mass has to give, as trunk and limbs turn. So p may be a little beyond, where these
have small weights: the feet press at their edge, and nothing that turns back takes from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_accuracy
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import whole_data
from condyn_pin.control.support import hull, level_floor, margin_of, touching_points
from condyn_pin.control.tasks.task import (
    BoundTask,
    CompiledTask,
    DefaultReference,
    RobotMotion,
    Task,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class CapturePoint(Task):
    """The capture point returns to a point, with the pressure on the line that leads back: 3 rows.

    cddot = omega^2 (c - p),    p = xi_r + s (1 + k) (xi - xi_r),    s <= 1

    s is 1, or what takes p to the edge of the support, or a little beyond. Where it is 1 this is
    `CenterOfMass` with kp = k omega^2 and kd = (k + 1) omega, which hold the height too. The
    support is that of the contacts in the first posture of the robot; `anchored` ones are where
    they belong.

    Parameters
    ----------
    reference : (3,) array_like, optional
        Where the centre of mass belongs, in the world [m]; above the support. By default where it
        is in the first posture of the robot.
    k : float
        Rate at which the capture point returns, over omega [1].
    beyond : float
        How far p may be beyond the edge of the support, as a share of the way there [1]: by turning
        trunk and limbs, where other tasks let them.

    Raises
    ------
    InvalidArgument
        If `k` or `beyond` is negative, or the reference is not three numbers.

    References
    ----------
    Englsberger, Ott, Albu-Schaeffer. Three-dimensional bipedal walking control based on divergent
    component of motion. IEEE Transactions on Robotics, 2015. Popovic, Goswami, Herr. Ground
    reference points in legged locomotion. International Journal of Robotics Research, 2005.
    """

    reference: Any = field(default=None, kw_only=True)
    k: float = field(default=4.0, kw_only=True)
    beyond: float = field(default=0.2, kw_only=True)

    def __post_init__(self) -> None:
        check_accuracy("k", self.k)
        check_accuracy("beyond", self.beyond)
        if self.reference is not None:
            place = tuple(finite("reference", self.reference, 3).tolist())
            object.__setattr__(self, "reference", place)
        super().__post_init__()

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; by default it belongs where it is at `home`."""
        q, model = home(), scene.robot.unedited
        at = Sites(scene, q)
        floor = level_floor(at)
        data = whole_data(model)
        start = pin.centerOfMass(model, data, q) if self.reference is None else self.reference
        place = floor.axes @ (np.array(start) - floor.origin)
        middle, height = place[:2], float(place[2])
        corners = hull(floor, touching_points(at)).corners
        if margin_of(corners, middle) <= 0 or height <= 0:
            raise InvalidArgument(
                f"{self.name}: reference = {np.array(start)} is not above the support of the "
                "contacts: nothing would stand there"
            )
        k, square = self.k, float(np.linalg.norm(model.gravity.linear)) / height
        omega, edges = np.sqrt(square), _edges(corners, middle) / (1 + self.beyond)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            now = motion.center_of_mass()
            c, v = floor.axes @ (now.x - floor.origin), floor.axes @ now.v
            ahead = (1 + k) * (c + v / omega - place)[:2]
            ahead /= max(1.0, float((edges @ ahead).max()))
            level = square * (c[:2] - middle - ahead)
            upwards = k * square * (height - c[2]) - (k + 1) * omega * v[2]
            return now.J, floor.axes.T @ np.append(level, upwards) - now.drift

        numbers = np.concatenate((place, edges.ravel(), np.zeros(6)))
        compiled = CompiledTask(
            "capture point", (3 + edges.size, 3), (k, float(omega)), lambda: lambda t: numbers,
            changes=False, placement=pin.SE3(floor.axes.T, floor.origin),
        )  # fmt: skip
        return BoundTask("accelerations", self._row_names("xyz"), "m/s^2", rows, compiled)


def _edges(corners: Array, middle: Array) -> Array:
    """Return E (k, 2) of a convex polygon: E d is 1 where middle + d is on an edge, less inside."""
    sides = np.roll(corners, -1, axis=0) - corners
    out = np.column_stack((sides[:, 1], -sides[:, 0]))
    return np.asarray(out / np.einsum("ij,ij->i", out, corners - middle)[:, None])
