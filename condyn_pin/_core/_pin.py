"""Calls that differ between Pinocchio 3.9 and 4.x.

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

import threading
import warnings
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.errors import BrokenPinocchio, UnsupportedBackend

__all__ = ["VERSION", "VERSION_TEXT", "pin"]


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


def without_infinity(model: Any) -> tuple[Any, dict[str, Array]]:
    """Return a model with finite limits, and its own where some are not: 3.9 unpickles no others.

    `set_numbers` gives them back.
    """
    own = {name: np.array(getattr(model, name)) for name in (*NUMBERS_OF_Q, *NUMBERS_OF_V)}
    infinite = {name: values for name, values in own.items() if np.isinf(values).any()}
    finite = pin.Model(model) if infinite else model
    set_numbers(finite, {name: np.zeros_like(values) for name, values in infinite.items()})
    return finite, infinite


def set_numbers(model: Any, numbers: Mapping[str, Array]) -> None:
    """Give the joints of a model limits, armatures and the like, by the name of the array."""
    for name, values in numbers.items():
        setattr(model, name, values)


def init_constraint_dynamics(model: Any, data: Any, models: Any, datas: Any) -> None:
    """Allocate the constraint part of `data` for exactly these constraints."""
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


def baumgarte_gains(constraint_model: Any) -> tuple[Array, Array]:
    """Return the stabilisation gains Kp [1/s^2] and Kd [1/s] of one constraint, by row or (1,)."""
    if _IS_4:
        both = constraint_model.m_baumgarte_parameters
        return np.array([both.Kp]), np.array([both.Kd])
    both = constraint_model.corrector
    return np.array(both.Kp), np.array(both.Kd)


def is_stale(model: Any, constraint_model: Any) -> bool:
    """True if a constraint has the columns of other joints than its own; 4.x finds them anew."""
    if _IS_4:
        return False
    c = constraint_model
    ends = c.joint1_id, c.joint1_placement, c.joint2_id, c.joint2_placement
    anew = pin.RigidConstraintModel(c.type, model, *ends, c.reference_frame)
    return not all(
        np.array_equal(getattr(c, columns), getattr(anew, columns))
        for columns in ("colwise_joint1_sparsity", "colwise_joint2_sparsity")
    )


def dry_friction(model: Any) -> NDArray[np.float64]:
    """Return the dry friction of the description along each coordinate of v [N m, N]."""
    return np.array(model.upperDryFrictionLimit if _IS_4 else model.friction)


def set_dry_friction(model: Any, friction: NDArray[np.float64]) -> None:
    """Give a model dry friction along each coordinate of v [N m, N], the same both ways."""
    model.friction = friction
    if _IS_4:
        model.lowerDryFrictionLimit = -friction


def constraint_cholesky(data: Any) -> Any:
    """Return Pinocchio's Cholesky factor of [[-mu I, J], [J^T, M]]."""
    return data.constraint_chol if _IS_4 else data.contact_chol


def factorise_constraints(
    model: Any, data: Any, models: Any, datas: Any, q: NDArray[np.float64], mu: float
) -> Any:
    """Return Pinocchio's Cholesky factor at q, after computing all that it reads from `data`."""
    pin.crba(model, data, q, pin.Convention.WORLD)
    if _IS_4:
        for constraint_model, constraint_data in zip(models, datas, strict=True):
            constraint_model.calc(model, data, constraint_data)
    cholesky = constraint_cholesky(data)
    cholesky.compute(model, data, models, datas, float(mu))
    return cholesky


def placement_view(placement: Any) -> NDArray[np.float64]:
    """Matrix [R p] (3, 4) of a pin.SE3, as a view into its memory."""
    # p lies behind R there, in every Pinocchio that is supported.
    R, p = placement.rotation, placement.translation
    if p.ctypes.data - R.ctypes.data != R.nbytes or R.strides != (8, 24):
        raise RuntimeError(f"Pinocchio {pin.__version__} has another SE3 in memory than [R p]")
    return np.lib.stride_tricks.as_strided(R, (3, 4), R.strides)


def placements_view(placements: Any, first: int, count: int) -> NDArray[np.float64]:
    """Matrices ([R p], [R p], ...) (3, 4 count) of placements side by side, as a view."""
    view = placement_view(placements[first])
    last = placement_view(placements[first + count - 1])
    if last.ctypes.data - view.ctypes.data != (count - 1) * view.nbytes:
        raise RuntimeError(f"Pinocchio {pin.__version__} has more than SE3 in a list of them")
    return np.lib.stride_tricks.as_strided(view, (3, 4 * count), view.strides)


def constraints_jacobian(
    model: Any, data: Any, models: Any, datas: Any
) -> Callable[[], NDArray[np.float64]]:
    """Function that returns J of all constraints, from the joint Jacobians in `data`."""
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
    """Function that returns J of all constraints, right after `constraintDynamics`."""
    return partial(pin.getConstraintsJacobian, model, data, models, datas)


def proximal_settings(
    absolute_accuracy: float, relative_accuracy: float, mu: float, max_iterations: int
) -> Any:
    """Pinocchio's proximal settings; its bindings accept Python numbers, but not those of numpy."""
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
    """Reason why `lcaba` is unavailable; empty if it is available."""
    if HAS_LCABA:
        return ""
    from condyn_pin._core.doctor import MEND_4

    return f"LCABA needs Pinocchio 4, and {VERSION_TEXT} is installed: {MEND_4}"


def _lcaba_or_refuse() -> None:
    if missing := missing_lcaba():
        raise UnsupportedBackend(missing)


def pinocchio_features() -> dict[str, str]:
    """Version and optional features of the installed Pinocchio, for `condyn doctor`."""
    return {
        "pinocchio": f"imported from {Path(pin.__file__).parent}",
        "LCABA": "yes" if HAS_LCABA else "no: needs Pinocchio 4",
        "SDF": "read by condyn_pin itself; the wheels of Pinocchio are built without it",
    }


# Contact solvers of Pinocchio: with `_pin`, the only place that knows which one is installed.
#
# | what                 | 3.9                               | 4.x                                |
# |----------------------|-----------------------------------|------------------------------------|
# | solvers              | `ADMMContactSolver`, ...          | `ADMMConstraintSolver`, ...        |
# | sets                 | round cones, as a list            | of constraint models, also limits  |
# | laws of ADMM         | ncp                               | ncp and ccp                        |
# | Anderson             | missing                           | `anderson_capacity`                |
# | what a solver keeps  | the last answer, and begins there | nothing; ADMM damps the operator   |
# | no friction anywhere | PGS stops after one round         | as it should                       |


HAS_ANDERSON: Final = _IS_4
_NO_RELATIVE: Final = 1e-14  # tolerance, which solvers add to the absolute one


# Contact forces (m,) and iterations of a contact solver, converged or not.
Conic: TypeAlias = tuple[Array, int]


def solves_contacts(ncp: bool, intervals: int) -> bool:
    """True if `admm` and `pgs` support the contact law and the dry-friction `intervals`."""
    return _IS_4 or (ncp and not intervals)


def admm(
    G: Array,
    g: Array,
    friction: Array,
    limits: Array,
    *,
    ncp: bool,
    tolerance: float,
    max_iterations: int,
    anderson: int,
    guess: Array | None,
) -> Conic:
    """Contact forces by Pinocchio's ADMM: rows of cones (t1, t2, n), then of intervals."""
    # Pinocchio 3 has no Anderson acceleration.
    if not _IS_4:
        solver = pin.ADMMContactSolver(len(g))
        _set_precision(solver, tolerance, max_iterations)
        start = () if guess is None else (guess,)
        operator = pin.DelassusOperatorDense(G)
        solver.solve(operator, g, _cones(friction), np.zeros(len(g)), *start)
        return np.ravel(solver.getPrimalSolution()), solver.getIterationCount()
    settings = _admm_settings(ncp, tolerance, max_iterations, anderson)
    result = pin.ADMMSolverResult()
    return _conic(pin.ADMMConstraintSolver, result, settings, G, g, friction, limits, guess)


def pgs(
    G: Array,
    g: Array,
    friction: Array,
    limits: Array,
    *,
    tolerance: float,
    max_iterations: int,
    over_relaxation: float,
    guess: Array | None,
) -> Conic:
    """Contact forces of the NCP by Pinocchio's projected Gauss-Seidel, rows as in `admm`."""
    if not _IS_4:
        solver = pin.PGSContactSolver(len(g))
        _set_precision(solver, tolerance, max_iterations)
        lam = np.zeros(len(g)) if guess is None else guess.copy()
        solver.solve(G, g, _cones(friction), lam, over_relaxation)
        return lam, solver.getIterationCount()
    settings = _conic_settings(pin.PGSSolverSettings(), tolerance, max_iterations)
    settings.over_relaxation = over_relaxation
    return _conic(
        pin.PGSConstraintSolver, pin.PGSSolverResult(), settings, G, g, friction, limits, guess
    )


def _set_precision(solver: Any, tolerance: float, max_iterations: int) -> None:
    solver.setAbsolutePrecision(tolerance)
    solver.setRelativePrecision(_NO_RELATIVE)
    solver.setMaxIterations(max_iterations)


def _cones(friction: Array) -> Any:
    cones = pin.StdVec_CoulombFrictionCone()
    for mu in friction.tolist():
        cones.append(pin.CoulombFrictionCone(mu))
    return cones


@lru_cache(maxsize=64)  # to fill one takes as long as three iterations; solvers only read it
def _admm_settings(ncp: bool, tolerance: float, max_iterations: int, anderson: int) -> Any:
    settings = _conic_settings(pin.ADMMSolverSettings(), tolerance, max_iterations)
    settings.solve_ncp, settings.anderson_capacity = ncp, anderson
    return settings


def _conic_settings(settings: Any, tolerance: float, max_iterations: int) -> Any:
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = _NO_RELATIVE
    settings.max_iterations = max_iterations
    return settings


def _conic(
    kind: Any, result: Any, settings: Any,
    G: Array, g: Array,
    friction: Array, limits: Array,
    guess: Array | None,
) -> Conic:  # fmt: skip
    """Contact forces by a solver of Pinocchio 4, in reused memory, without its last solution."""
    models, datas = _sets(friction, limits)
    if guess is not None:
        result.setConstraintImpulseGuess(guess)
    # a new operator: ADMM leaves its damping in it, which PGS takes for a part of G
    operator = pin.DelassusOperatorDense(G)
    _solver(kind, len(g)).solve(operator, g, models, datas, settings, result)
    return result.retrieveConstraintImpulses(), result.iterations


class _Memory(threading.local):
    """Solvers and constraint sets that one thread reuses, by kind and size or by content."""

    def __init__(self) -> None:
        self._kept: dict[Any, Any] = {}

    def of(self, key: Any, make: Callable[[], Any]) -> Any:
        """Stored object of a key, made by `make` if there is none."""
        made = self._kept.get(key)
        if made is None:
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            made = self._kept[key] = make()
        return made


_MOST_KEPT: Final = 64
_memory = _Memory()


def _solver(kind: Any, size: int) -> Any:
    """Pinocchio 4 solver for problems of a size; only its memory is reused, not its last solution.

    To make one takes as long as three iterations.
    """
    return _memory.of((kind, size), lambda: kind(size))


def _sets(friction: Array, limits: Array) -> tuple[Any, Any]:
    """Models and datas of a placeholder mechanism with the sizes and sets of the contact problem.

    Solvers read nothing else of them, and write nothing: the next problem often has the same sets.
    """
    key = friction.tobytes(), limits.tobytes()
    return _memory.of(key, lambda: _new_sets(friction, limits))  # type: ignore[no-any-return]


def _new_sets(friction: Array, limits: Array) -> tuple[Any, Any]:
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
    return models, datas
