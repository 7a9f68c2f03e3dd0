"""The only place that knows which Pinocchio is installed, 3.9 or 4.x, with `_pin_contacts`.

| what                | 3.9                             | 4.x                                |
|---------------------|---------------------------------|------------------------------------|
| initialisation      | of the constraint models        | takes the constraint datas as well |
| Baumgarte gains     | `corrector.Kp/.Kd`, vectors     | `m_baumgarte_parameters`, scalars  |
| constraint Cholesky | `data.contact_chol`             | `data.constraint_chol`             |
| ... to compute it   | needs `crba`                    | needs each constraint's `calc` too |
| LCABA               | missing                         | `lcaba`, and an elimination order  |
| dry friction        | `model.friction`                | `model.upperDryFrictionLimit`      |
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin.errors import BrokenPinocchio, UnsupportedBackend

try:
    with warnings.catch_warnings():
        # Pinocchio 3.9 warns about a module that it imports itself
        warnings.filterwarnings("ignore", message=".*hppfcl.*", category=DeprecationWarning)
        import pinocchio as pin

    VERSION: tuple[int, ...] = tuple(int(part) for part in pin.__version__.split(".")[:2])
    pin.Model  # noqa: B018  another distribution shares the import name
except (ImportError, AttributeError) as error:
    from condyn_pin._core.doctor import advise  # it is for what does not work

    raise BrokenPinocchio(advise(error)) from error

if not (3, 9) <= VERSION < (5, 0):
    from condyn_pin._core.doctor import MEND_4

    raise BrokenPinocchio(
        f"Pinocchio {pin.__version__} is installed; 3.9 or 4.x is needed: {MEND_4}"
    )

VERSION_TEXT: str = pin.__version__

__all__ = ["VERSION", "VERSION_TEXT", "pin"]

_IS_4 = VERSION >= (4, 0)
LOCAL = pin.ReferenceFrame.LOCAL
HAS_LCABA = hasattr(pin, "lcaba")

# What a model knows of each joint, by its place in q and in v. 4.x has more, and the older names.
NUMBERS_OF_Q = tuple(
    name
    for name in ("lowerPositionLimit", "upperPositionLimit", "positionLimitMargin")
    if hasattr(pin.Model, name)
)
NUMBERS_OF_V = tuple(
    name
    for name in (
        "armature", "rotorInertia", "rotorGearRatio", "damping", "friction",
        "lowerDryFrictionLimit", "upperDryFrictionLimit", "effortLimit", "lowerEffortLimit",
        "upperEffortLimit", "velocityLimit", "lowerVelocityLimit", "upperVelocityLimit",
    )
    if hasattr(pin.Model, name)
)  # fmt: skip


def init_constraint_dynamics(model: Any, data: Any, models: Any, datas: Any) -> None:
    """Size the constraint part of `data` for exactly these constraints."""
    if _IS_4:
        pin.initConstraintDynamics(model, data, models, datas)
    else:
        pin.initConstraintDynamics(model, data, models)


def set_baumgarte(constraint_model: Any, Kp: float, Kd: float) -> None:
    """Set isotropic stabilisation gains Kp [1/s^2] and Kd [1/s] of one constraint."""
    if _IS_4:
        constraint_model.m_baumgarte_parameters.Kp = Kp
        constraint_model.m_baumgarte_parameters.Kd = Kd
    else:
        # by slice: assigning an array of another length resizes the gains silently
        constraint_model.corrector.Kp[:] = Kp
        constraint_model.corrector.Kd[:] = Kd


def dry_friction(model: Any) -> NDArray[np.float64]:
    """Return the dry friction of the description along each coordinate of v [N m, N]."""
    return np.array(model.upperDryFrictionLimit if _IS_4 else model.friction)


def set_dry_friction(model: Any, rows: slice, torque: float) -> None:
    """Give coordinates of v a dry friction [N m, N]."""
    ends = {"upperDryFrictionLimit": 1, "lowerDryFrictionLimit": -1} if _IS_4 else {"friction": 1}
    for key, sign in ends.items():
        values = getattr(model, key).copy()
        values[rows] = sign * torque
        setattr(model, key, values)


def constraint_cholesky(data: Any) -> Any:
    """Return Pinocchio's Cholesky factor of [[-mu I, J], [J^T, M]]."""
    return data.constraint_chol if _IS_4 else data.contact_chol


def factorise_constraints(
    model: Any, data: Any, models: Any, datas: Any, q: NDArray[np.float64], mu: float
) -> Any:
    """Return Pinocchio's Cholesky factor at q: what it reads from `data` is computed first."""
    pin.crba(model, data, q, pin.Convention.WORLD)
    if _IS_4:
        for constraint_model, constraint_data in zip(models, datas, strict=True):
            constraint_model.calc(model, data, constraint_data)
    cholesky = constraint_cholesky(data)
    cholesky.compute(model, data, models, datas, float(mu))
    return cholesky


def placement_view(placement: Any) -> NDArray[np.float64]:
    """Return [R p] (3, 4) of a pin.SE3, a view into its memory: who reads several copies once.

    p lies behind R there, in every Pinocchio that is supported.
    """
    R, p = placement.rotation, placement.translation
    if p.ctypes.data - R.ctypes.data != R.nbytes or R.strides != (8, 24):
        raise RuntimeError(f"Pinocchio {pin.__version__} has another SE3 in memory than [R p]")
    return np.lib.stride_tricks.as_strided(R, (3, 4), R.strides)


def placements_view(placements: Any, first: int, count: int) -> NDArray[np.float64]:
    """Return ([R p], [R p], ...) (3, 4 count) of placements side by side, as they are in memory."""
    view = placement_view(placements[first])
    last = placement_view(placements[first + count - 1])
    if last.ctypes.data - view.ctypes.data != (count - 1) * view.nbytes:
        raise RuntimeError(f"Pinocchio {pin.__version__} has more than SE3 in a list of them")
    return np.lib.stride_tricks.as_strided(view, (3, 4 * count), view.strides)


def constraints_jacobian(
    model: Any, data: Any, models: Any, datas: Any
) -> Callable[[], NDArray[np.float64]]:
    """Return what evaluates J of all constraints, from the Jacobians of the joints in `data`."""
    jacobian = placed_jacobian(model, data, models, datas)
    if not _IS_4:
        return jacobian
    pairs = zip(models, datas, strict=True)
    # without them Pinocchio 4 takes the placements of an earlier call
    placing = [partial(one.calc, model, data, its_data) for one, its_data in pairs]

    def placed() -> NDArray[np.float64]:
        for place in placing:
            place()
        J: NDArray[np.float64] = jacobian()
        return J

    return placed


def placed_jacobian(
    model: Any, data: Any, models: Any, datas: Any
) -> Callable[[], NDArray[np.float64]]:
    """What evaluates J of all constraints where `constraintDynamics` has just placed them."""
    return partial(pin.getConstraintsJacobian, model, data, models, datas)


def proximal_settings(
    absolute_accuracy: float, relative_accuracy: float, mu: float, max_iterations: int
) -> Any:
    """Return Pinocchio's settings; it takes Python's numbers, and not those of numpy."""
    return pin.ProximalSettings(
        float(absolute_accuracy), float(relative_accuracy), float(mu), int(max_iterations)
    )


def order_joints_for_lcaba(model: Any, data: Any, models: Any) -> None:
    """Compute the elimination order that `lcaba` reads from `data`."""
    _lcaba_or_refuse()
    pin.computeJointMinimalOrdering(model, data, models)


def lcaba() -> Callable[..., NDArray[np.float64]]:
    """Return Pinocchio's `lcaba`."""
    _lcaba_or_refuse()
    return pin.lcaba  # type: ignore[no-any-return]


def missing_lcaba() -> str:
    """Return what `lcaba` needs that is not there; nothing where it is."""
    if HAS_LCABA:
        return ""
    from condyn_pin._core.doctor import MEND_4

    return f"LCABA needs Pinocchio 4, and {VERSION_TEXT} is installed: {MEND_4}"


def _lcaba_or_refuse() -> None:
    if missing := missing_lcaba():
        raise UnsupportedBackend(missing)


def features() -> dict[str, str]:
    """Return what the installed Pinocchio can do, for `condyn doctor`."""
    return {
        "pinocchio": f"{pin.__version__} from {Path(pin.__file__).parent}",
        "LCABA": "yes" if HAS_LCABA else "no: needs Pinocchio 4",
        "SDF": "read by condyn_pin itself; the wheels of Pinocchio are built without it",
    }
