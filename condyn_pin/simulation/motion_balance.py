"""MotionBalance: where a robot presses on the floor along a motion, and where it was about to fall.

The equations are those of `control.balancing`, at every sample:

    f = m (cddot - g),    n_O = Ldot + c x f,        ZMP = p + e x (n_O - p x f) / (f . e)
    CoP = sum (f_i . e) p_i / sum f_i . e,           DCM = c + cdot / omega,    omega = sqrt(g / h)

with p a point and e the normal of the plane of all that touches, upwards, h the height of the
centre of mass c above it, and f_i the force at p_i. The capture point is the foot of the DCM on the
plane. Forces and accelerations of a step with contacts are means over it: there ZMP and CoP agree
to the order of dt, and after an impact that is no force but an impulse not at all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms, data_of
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.control.balancing import Balance, balanced
from condyn_pin.control.support import Pressure, SupportPolygon, floor_pressure, margin_within
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.records import candidates_of
from condyn_pin.simulation.trajectory import Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class MotionBalance:
    """Centre of mass, centre of pressure and capture point along a motion, in world axes.

    A contact that may open counts while it sticks or slides, and so does one next to it that is
    on its plane without a force: which corners of a flat foot carry the load is not determined, and
    all are edges of the support. A contact on another body of the robot does not count. Quantities
    that are not defined at a sample are NaN: in flight, and if the contacts do not lie in one
    plane, all but the centre of mass; and the centre of pressure of a contact without load.

    Attributes
    ----------
    t : (k,) array
        Times of the samples [s].
    com, zmp, cop, dcm, capture_point : (k, 3) array
        Of each sample [m], as in `Balance`.
    zmp_margin, cop_margin, capture_margin : (k,) array
        How far each point is within the support polygon [m]; negative outside.
    polygons : tuple of SupportPolygon or None
        The support at each sample; None in flight and on what is not one plane.
    name : str
        Of the robot.
    """

    t: Array
    com: Array  # [m]
    zmp: Array  # [m]
    cop: Array  # [m]
    dcm: Array  # [m]
    capture_point: Array  # [m]
    zmp_margin: Array  # [m]
    cop_margin: Array  # [m]
    capture_margin: Array  # [m]
    polygons: tuple[SupportPolygon | None, ...]
    name: str

    def __repr__(self) -> str:
        held = sum(each is not None for each in self.polygons)
        return (
            f"MotionBalance({self.name}: {len(self.t)} samples, {held} on one plane; least margins "
            f"to the edge of the support: ZMP {_least(self.zmp_margin):.4g} m, CoP "
            f"{_least(self.cop_margin):.4g} m, capture point {_least(self.capture_margin):.4g} m)"
        )


def motion_balance(trajectory: Trajectory) -> MotionBalance:
    """Return centre of pressure, capture point and stability margins along a motion.

    Parameters
    ----------
    trajectory : Trajectory
        On contacts that are held, that open and slide, or both.

    Returns
    -------
    MotionBalance

    Raises
    ------
    InvalidArgument
        If it has nothing that could press on a floor, or a contact does not say its size.

    Notes
    -----
    Takes a millisecond a sample.
    """
    check_type("trajectory", trajectory, Trajectory, "one of simulate is needed")
    scenes = [phase.scene for phase in trajectory.phases]
    if not any(_on_ground(x) or any(c.support for c in x.constraints) for x in scenes):
        raise InvalidArgument("trajectory: its scene has no contact that presses on a floor")
    found = list(balances(trajectory, range(len(trajectory.t))))
    return MotionBalance(
        t=trajectory.t,
        com=np.array([each.com for each in found]),
        zmp=np.array([each.zmp for each in found]),
        cop=np.array([each.cop for each in found]),
        dcm=np.array([each.dcm for each in found]),
        capture_point=np.array([each.capture_point for each in found]),
        zmp_margin=np.array([each.zmp_margin for each in found]),
        cop_margin=np.array([margin_within(each.polygon, each.cop) for each in found]),
        capture_margin=np.array([each.capture_margin for each in found]),
        polygons=tuple(each.polygon for each in found),
        name=trajectory.scene.robot.name,
    )


def balances(trajectory: Trajectory, samples: Sequence[int]) -> Iterator[Balance]:
    """Yield the balance of some samples, in rising order."""
    modes = trajectory.modes
    for phase in trajectory.phases:
        scene, columns = phase.scene, list(phase.columns)
        candidates = candidates_of(scene)
        for k in samples:
            if not phase.samples.start <= k < phase.samples.stop:
                continue
            q, lam = trajectory.q[k], trajectory.lam[k, columns]
            touching = {name for name, mode in modes.items() if mode[k] != "open"}
            if touching:  # which corners of a flat foot carry it is not determined
                touching |= {name for name in modes if _on_plane(trajectory, name, k)}
            pressure = pressure_of(scene, candidates, q, lam, touching)
            yield balanced(scene, q, trajectory.v[k], trajectory.a[k], pressure)


def pressure_of(
    scene: Scene, candidates: Candidates, q: Array, lam: Array, touching: set[str]
) -> Pressure:
    """Forces lam of constraints and touching contacts on the ground, and their points."""
    held = floor_pressure(Sites(scene, q), lam[: scene.rows])
    if not touching:
        return held
    model = scene.robot.unedited
    data = data_of(model)
    algorithms(data).forwardKinematics(model, data, q)
    axes = candidates.axes(data, q)
    # on the plane itself: what penetrates a little, or is not quite down, is on one plane as well
    gaps = candidates.gaps(data, q)[: candidates.cones]
    points = candidates.points(data, q) - gaps[:, None] * axes[:, :, 2]
    forces = lam[scene.rows :][: 3 * candidates.cones].reshape(-1, 3)
    on_ground = _on_ground(scene) & touching
    places, exerted = [held.points], held.exerted.copy()
    cops, pressing = dict(held.cops), dict(held.forces)
    for i, name in enumerate(candidates.names[: candidates.cones]):
        if name not in on_ground:
            continue
        p, f = points[i], axes[i] @ forces[i]
        places.append(p[None])
        exerted += np.concatenate((f, np.cross(p, f)))
        cops[name] = p if forces[i, 2] > 0 else np.full(3, np.nan)
        if forces[i, 2] > 0:
            pressing[name] = f
    return Pressure(np.vstack(places), exerted, cops, pressing)


def _on_plane(trajectory: Trajectory, name: str, k: int) -> bool:
    gap = trajectory.gaps.get(name)  # dry friction has none
    return gap is not None and bool(gap[k] <= tolerances.TOUCHES)


def _on_ground(scene: Scene) -> set[str]:
    """Return the contacts whose other side is the world."""
    return {name for bound in scene.contact_bounds for name, ground in bound.cones if not ground}


def _least(margins: Array) -> float:
    return float(np.nanmin(margins)) if np.isfinite(margins).any() else float("nan")
