"""The only place that knows which Pinocchio is installed: 3.9 or 4.x.

| what                | 3.9                             | 4.x                                |
|---------------------|---------------------------------|------------------------------------|
| initialisation      | of the constraint models        | takes the constraint datas as well |
| Baumgarte gains     | `corrector.Kp/.Kd`, vectors     | `m_baumgarte_parameters`, scalars  |
| constraint Cholesky | `data.contact_chol`             | `data.constraint_chol`             |
| ... to compute it   | needs `crba`                    | needs each constraint's `calc` too |
| LCABA               | missing                         | `lcaba`, and an elimination order  |
| dry friction        | `model.friction`                | `model.upperDryFrictionLimit`      |
| ADMM, PGS           | round cones, ncp                | intervals and ccp as well          |
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import doctor
from condyn_pin.errors import BrokenPinocchio, UnsupportedBackend

try:
    with warnings.catch_warnings():
        # Pinocchio 3.9 warns about a module that it imports itself
        warnings.filterwarnings("ignore", message=".*hppfcl.*", category=DeprecationWarning)
        import pinocchio as pin

    VERSION: tuple[int, ...] = tuple(int(part) for part in pin.__version__.split(".")[:2])
    pin.Model  # noqa: B018  another distribution shares the import name
except (ImportError, AttributeError) as error:
    raise BrokenPinocchio(doctor.advise(error)) from error

if not (3, 9) <= VERSION < (5, 0):
    raise BrokenPinocchio(
        f"Pinocchio {pin.__version__} is installed; 3.9 or 4.x is needed: {doctor.MEND_4}"
    )

VERSION_TEXT: str = pin.__version__

__all__ = ["VERSION", "VERSION_TEXT", "pin"]

_IS_4 = VERSION >= (4, 0)
LOCAL = pin.ReferenceFrame.LOCAL
HAS_LCABA = hasattr(pin, "lcaba")
HAS_ANDERSON = _IS_4  # acceleration of ADMM
_NO_RELATIVE = 1e-14  # tolerance of a contact solver, which adds it to the absolute one

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


def constraints_jacobian(
    model: Any, data: Any, models: Any, datas: Any
) -> Callable[[], NDArray[np.float64]]:
    """Return what evaluates J of all constraints, from the Jacobians of the joints in `data`."""
    jacobian = partial(pin.getConstraintsJacobian, model, data, models, datas)
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


def _lcaba_or_refuse() -> None:
    if not HAS_LCABA:
        raise UnsupportedBackend(
            f"LCABA needs Pinocchio 4, and {VERSION_TEXT} is installed: {doctor.MEND_4}"
        )


class Conic(NamedTuple):
    """What Pinocchio answers to a contact problem."""

    lam: NDArray[np.float64]
    iterations: int
    converged: bool  # by its own measure


def solves_contacts(ncp: bool, intervals: int) -> bool:
    """Return whether `admm` and `pgs` take the law, and rows with dry friction."""
    return _IS_4 or (ncp and not intervals)


def admm(
    G: NDArray[np.float64],
    g: NDArray[np.float64],
    friction: NDArray[np.float64],
    limits: NDArray[np.float64],
    *,
    ncp: bool,
    tolerance: float,
    max_iterations: int,
    anderson: int,
    guess: NDArray[np.float64] | None,
) -> Conic:
    """Return what Pinocchio's ADMM answers: rows of cones (t1, t2, n), then of intervals.

    Pinocchio 3 has no Anderson acceleration.
    """
    if not _IS_4:
        solver = pin.ADMMContactSolver(len(g))
        _set_precision(solver, tolerance, max_iterations)
        start = () if guess is None else (guess,)
        operator = pin.DelassusOperatorDense(G)
        ok = solver.solve(operator, g, _cones(friction), np.zeros(len(g)), *start)
        return Conic(np.ravel(solver.getPrimalSolution()), solver.getIterationCount(), ok)
    settings = _conic_settings(pin.ADMMSolverSettings(), tolerance, max_iterations)
    settings.solve_ncp, settings.anderson_capacity = ncp, anderson
    return _conic(
        pin.ADMMConstraintSolver, pin.ADMMSolverResult(), settings, G, g, friction, limits, guess
    )


def pgs(
    G: NDArray[np.float64],
    g: NDArray[np.float64],
    friction: NDArray[np.float64],
    limits: NDArray[np.float64],
    *,
    tolerance: float,
    max_iterations: int,
    over_relaxation: float,
    guess: NDArray[np.float64] | None,
) -> Conic:
    """Return what Pinocchio's projected Gauss-Seidel answers, rows as in `admm`; always an ncp."""
    if not _IS_4:
        solver = pin.PGSContactSolver(len(g))
        _set_precision(solver, tolerance, max_iterations)
        lam = np.zeros(len(g)) if guess is None else guess.copy()
        ok = solver.solve(G, g, _cones(friction), lam, over_relaxation)
        return Conic(lam, solver.getIterationCount(), ok)
    settings = _conic_settings(pin.PGSSolverSettings(), tolerance, max_iterations)
    settings.over_relaxation = over_relaxation
    return _conic(
        pin.PGSConstraintSolver, pin.PGSSolverResult(), settings, G, g, friction, limits, guess
    )


def _set_precision(solver: Any, tolerance: float, max_iterations: int) -> None:
    solver.setAbsolutePrecision(tolerance)
    solver.setRelativePrecision(_NO_RELATIVE)
    solver.setMaxIterations(max_iterations)


def _cones(friction: NDArray[np.float64]) -> Any:
    cones = pin.StdVec_CoulombFrictionCone()
    for mu in friction.tolist():
        cones.append(pin.CoulombFrictionCone(mu))
    return cones


def _conic_settings(settings: Any, tolerance: float, max_iterations: int) -> Any:
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = _NO_RELATIVE
    settings.max_iterations = max_iterations
    return settings


def _conic(
    kind: Any, result: Any, settings: Any,
    G: NDArray[np.float64], g: NDArray[np.float64],
    friction: NDArray[np.float64], limits: NDArray[np.float64],
    guess: NDArray[np.float64] | None,
) -> Conic:  # fmt: skip
    """Return what a solver of Pinocchio 4 answers; all of it is made anew but for the sets."""
    models, datas = _sets(friction, limits)
    if guess is not None:
        result.setConstraintImpulseGuess(guess)
    # a new operator: ADMM leaves its damping in it, which PGS takes for a part of G
    operator = pin.DelassusOperatorDense(G)
    ok = kind(len(g)).solve(operator, g, models, datas, settings, result)
    return Conic(result.retrieveConstraintImpulses(), result.iterations, ok)


_made = threading.local()


def _sets(friction: NDArray[np.float64], limits: NDArray[np.float64]) -> tuple[Any, Any]:
    """Return models and datas of a mechanism that does not matter, for the sizes and sets in them.

    Kept by thread where there are cones only, and the next problem often has the same.
    """
    key = friction.tobytes() + limits.tobytes(), len(limits)
    if getattr(_made, "key", None) == key:
        return _made.sets  # type: ignore[no-any-return]
    model, here = pin.Model(), pin.SE3.Identity()
    for i in range(max(len(limits), 1)):
        model.addJoint(i, pin.JointModelRZ(), here, f"joint {i}")
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for mu in friction.tolist():
        point = pin.PointContactConstraintModel(model, 0, here, 1, here)
        point.setFriction(mu)
        models.append(pin.ConstraintModel(point))
    if len(limits):
        dry = pin.JointFrictionConstraintModel(model)
        dry.setFrictionLowerLimit(-limits)
        dry.setFrictionUpperLimit(limits)
        dry.setTimeStep(1.0)  # limits are impulses already
        models.append(pin.ConstraintModel(dry))
    for each in models:
        datas.append(each.createData())
    _made.key, _made.sets = key, (models, datas)
    return models, datas


def features() -> dict[str, str]:
    """Return what the installed Pinocchio can do, for `condyn doctor`."""
    return {
        "pinocchio": f"{pin.__version__} from {Path(pin.__file__).parent}",
        "LCABA": "yes" if HAS_LCABA else "no: needs Pinocchio 4",
        "SDF": "read by condyn_pin itself; the wheels of Pinocchio are built without it",
    }
