"""Identification: parameters of a machine from what was measured on it.

    min over p of  sum rho(r_i(p)^2) / 2,    r_k = P_k S^-1 e_k(p),    lower <= p <= upper

e_k is what sample k of a log and the scene of p leave of each other, and P_k projects its unknowns
x_k out (`logs`). At the best x_k

    J_k = P_k S^-1 de_k/dp  at fixed x_k

gives the exact gradient of the sum, P_k r_k being r_k (Golub and Pereyra; Kaufman). Of de/dp
central differences are taken. They are exact up to rounding, 1e-11, where e is of degree two in
a parameter: in all but the places of ends of rods, which they get wrong by 1e-9.

    cov = s^2 (J^T J)^-1,    s^2 = |r|^2 / (equations - unknowns - rank J)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, nan
from statistics import NormalDist
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count, check_share, check_type, listed
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.show import Outcome
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.contacts.joint_friction import JointFriction
from condyn_pin.constraints.places import short_frames
from condyn_pin.dynamics.scene import Scene, check_not_driven, check_scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.gradients.logs import BoundLog, Log

Loss = Literal["linear", "soft_l1", "huber", "cauchy"]

# psi = r rho'(r^2) of each loss, and its derivative.
_LOSSES: Final[dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]]] = {
    "linear": (lambda r: r, np.ones_like),
    "soft_l1": (lambda r: r / np.sqrt(1.0 + r**2), lambda r: (1.0 + r**2) ** -1.5),
    "huber": (lambda r: np.clip(r, -1.0, 1.0), lambda r: (np.abs(r) <= 1.0).astype(float)),
    "cauchy": (lambda r: r / (1.0 + r**2), lambda r: (1.0 - r**2) / (1.0 + r**2) ** 2),
}

_ENDED: Final = 1e-12  # relative step, or fall of the sum, that ends a fit: 1e-6 standard errors
_ROUNDS: Final = 3  # fits, each of the parameters that the end of the last one determines
_NAMED: Final = 1e-6  # least part of a combination that is named, of its largest


class FitStatus(Outcome):
    """Outcome of a fit; the value says more."""

    CONVERGED = "no smaller sum of squares is near, and the log determines all parameters"
    NOT_IDENTIFIABLE = (
        "the log does not determine all parameters: `undetermined` names them; fit fewer, or "
        "measure more, or other motions"
    )
    OUT_OF_ITERATIONS = "the sum of squares was still falling; pass more iterations"


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Parameters of a scene that were identified, with their bounds of confidence.

    Attributes
    ----------
    names : tuple of str
        Parameters, ``owner/quantity``.
    estimate : (n,) array
        Their values, in SI units [kg, m, 1, N m s/rad, ...]. Of parameters that the log does not
        determine some stay at their start, and others follow from that.
    standard_error : (n,) array
        Square roots of the diagonal of `covariance`, in the units of `estimate` [kg, m, ...].
        Infinite where the log does not determine a parameter.
    covariance : (n, n) array
        s^2 (J^T J)^-1 [products of these units]; NaN beside parameters that are not determined.
    residuals : (k, m) array
        r of each sample over the noise that the log was given [1, or the unit of what was measured
        where its sigma is left at one]; the unknowns of each sample projected out.
    noise : float
        s, the size of the noise over the sigma of the log, from the residuals [1]; NaN where none
        are left, and no parameter is determined.
    dof : int
        Equations less unknowns and determined parameters: on how much `noise` rests.
    status : FitStatus
        Ok if CONVERGED.
    undetermined : tuple of str
        Parameters, and combinations of them, along which the log does not change.
    at_bounds : tuple of str
        Parameters that end at what is physical, such as a friction of zero: their standard errors
        are those of the parameter without its bound.
    scene : Scene
        The scene with these values.
    """

    names: tuple[str, ...]
    estimate: Array
    standard_error: Array
    covariance: Array
    residuals: Array
    noise: float
    dof: int
    status: FitStatus
    undetermined: tuple[str, ...]
    at_bounds: tuple[str, ...]
    scene: Scene

    def interval(self, level: float = 0.95) -> Array:
        """Return lower and upper ends of the interval of confidence of each parameter (n, 2).

        p +- z standard_error, with z of the normal distribution [the units of `estimate`].

        Parameters
        ----------
        level : float
            Share of logs whose interval has the true value in it [1].

        Raises
        ------
        InvalidArgument
            If the level is not between 0 and 1.
        """
        check_share("level", level)
        half = NormalDist().inv_cdf(0.5 + 0.5 * level) * self.standard_error
        return np.column_stack([self.estimate - half, self.estimate + half])

    def __repr__(self) -> str:
        return f"Fit({len(self.names)} parameters, {self.status.word})"

    def __str__(self) -> str:
        width = max(map(len, ("parameter", *self.names)))
        lines = [
            f"{self.status}, noise {self.noise:.3g}, {self.dof} degrees of freedom",
            f"{'parameter':<{width}} {'estimate':>13} {'standard error':>15} {'95 % from':>13} "
            f"{'to':>13}",
        ]
        lines += [
            f"{name:<{width}} {p:>13.6g} {error:>15.3g} {low:>13.6g} {high:>13.6g}"
            for name, p, error, (low, high) in zip(
                self.names, self.estimate, self.standard_error, self.interval(), strict=True
            )
        ]
        lines += [f"not determined: {each}" for each in self.undetermined]
        lines += [f"at its bound: {name}" for name in self.at_bounds]
        return "\n".join(lines)


@one_blas_thread
def fit(
    scene: Scene,
    log: Log,
    parameters: Sequence[str],
    *,
    loss: Loss = "linear",
    iterations: int = 100,
) -> Fit:
    """Identify parameters of a scene from a log, with bounds of confidence.

    min over p of  sum rho(r_i(p)^2) / 2,    lower <= p <= upper

    Parameters
    ----------
    scene : Scene
        The machine; its own values are the start. `TorqueLog` has contacts of the scene too.
    log : TorqueLog or PoseLog
        What was measured, with noise.
    parameters : sequence of str
        Names, ``owner/quantity``, of joints ``knee/mass``, ``knee/centre.x``, ``knee/place.x`` (on
        the parent), ``knee/damping``, of springs ``knee/stiffness`` and ``knee/reference``, of
        loops ``loop/frame_b.x`` (the end of the loop on its body), ``rod/length``, of contacts
        ``foot/friction`` and ``knee/friction/torque``. Masses, friction, damping, stiffness and
        lengths stay at zero or above. An inertia about the centre of mass grows with the mass.
    loss : {"linear", "soft_l1", "huber", "cauchy"}
        rho, that of `scipy.optimize.least_squares`: others than "linear" let outliers count less,
        those beyond the sigma of the log.
    iterations : int
        The most that may be taken.

    Returns
    -------
    Fit
        Ok if the log determines all parameters. If not, `undetermined` names what it leaves open.

    Raises
    ------
    InvalidArgument
        If the log does not fit the scene, or has no more equations than unknowns.
    UnknownName
        If there is no such parameter; the text lists the nearest names.

    Notes
    -----
    Cost: each iteration evaluates the log 2 n + 2 times, at 0.1 ms a sample on robots. The log
    determines a parameter if its column of J is larger than 1e-7 of what it does before projection,
    beside the columns of the others.

    References
    ----------
    Golub, Pereyra. The differentiation of pseudo-inverses and nonlinear least squares problems
    whose variables separate. SIAM Journal on Numerical Analysis, 1973.

    Khalil, Dombre. Modeling, Identification and Control of Robots. Hermes Penton, 2002.

    Huber. Robust Statistics. Wiley, 1981, chapter 7: the variance with a loss.
    """
    check_scene(scene)
    check_not_driven(scene, "fit")
    check_type("log", log, Log, "a TorqueLog or a PoseLog is needed")
    names = _names(parameters)
    if loss not in get_args(Loss):
        raise InvalidArgument(f"loss = {loss!r}: one of {', '.join(get_args(Loss))} is needed")
    check_count("iterations", iterations)
    problem = _Problem(SceneParameters(scene, names), log.bind(scene))
    p, taken = problem.family.start, 0
    at_bounds, ended = np.zeros(len(p), dtype=bool), True
    J, sizes = problem.jacobian(p)
    found = _determined(J, sizes)
    for _ in range(_ROUNDS):
        free = found.free
        if not len(free):
            break
        most = max(iterations - taken, 1)
        p, ends = problem.fitted(p, free, sizes[free], loss, most)
        taken, ended = taken + ends.nfev, ends.status > 0
        at_bounds[:] = False
        at_bounds[free] = ends.active_mask != 0
        J, sizes = problem.jacobian(p)
        found = _determined(J, sizes)
        if not ended or len(found.free) <= len(free):
            break
    return _result(problem, names, p, J, sizes, found, loss, at_bounds, ended=ended)


class _Problem:
    """Residuals and their derivatives by all parameters, each at the last p."""

    def __init__(self, family: SceneParameters, log: BoundLog) -> None:
        self.family, self.log = family, log
        self._p, self._count = b"", 0
        self._T: Array | None = None
        self.residuals = np.zeros((0, 0))

    def fitted(
        self, p: Array, free: NDArray[np.int_], unit: Array, loss: Loss, most: int
    ) -> tuple[Array, Any]:
        """Least squares over the `free` parameters, each in its unit; p at the end, and the end."""
        from scipy.optimize import least_squares

        def whole(y: Array) -> Array:
            moved = p.copy()
            moved[free] = y / unit
            return moved

        ends = least_squares(
            lambda y: self.residual(whole(y)),
            p[free] * unit,
            jac=lambda y: self.jacobian(whole(y))[0][:, free] / unit,
            bounds=(self.family.lower[free] * unit, self.family.upper[free] * unit),
            ftol=_ENDED, xtol=_ENDED, gtol=None, loss=loss, max_nfev=most,
        )  # fmt: skip
        return whole(ends.x), ends

    def residual(self, p: Array) -> Array:
        """Residuals (K m,); infinite where loops do not close, so that no step goes there."""
        self._set(p)
        return self.residuals.ravel() if self._T is not None else np.full(self._count, np.inf)

    def jacobian(self, p: Array) -> tuple[Array, Array]:
        """Derivatives of `residual` by p (K m, n), and their sizes before projection (n,)."""
        self._set(p)
        if self._T is None:
            raise InvalidArgument(
                "log: no closed configuration near log.start comes near what was measured; name "
                "another start, or a scene whose loops close"
            )
        found, sizes = np.empty((self.residuals.size, len(p))), np.empty(len(p))
        for i in range(len(p)):
            up, down, apart = self.family.beside(self.scene, i)
            change = (self.log.rows(up) - self.log.rows(down)) / apart
            found[:, i] = np.einsum("kij,kj->ki", self._T, change).ravel()
            sizes[i] = np.linalg.norm(change) or 1.0
        return found, sizes

    def _set(self, p: Array) -> None:
        if p.tobytes() == self._p:
            return
        self.scene = self.family.scene(p)
        self._p, self._T = p.tobytes(), self.log.solve(self.scene)
        if self._T is not None:
            self.residuals = np.einsum("kij,kj->ki", self._T, self.log.rows(self.scene))
            self._count = self.residuals.size


class _DeterminedParameters(NamedTuple):
    """Parameters that a log determines, those of the others held."""

    free: NDArray[np.int_]
    held: NDArray[np.int_]
    ways: Array  # (held, n), along which the log does not change: each with one of `held`


def _determined(J: Array, sizes: Array) -> _DeterminedParameters:
    """Rank of J by pivots, its columns relative to their sizes before projection."""
    from scipy.linalg import qr, solve_triangular

    R, order = qr(J / sizes, mode="r", pivoting=True)
    steps = np.abs(np.diagonal(R))
    r = int(np.count_nonzero(steps > tolerances.RANK * max(1.0, steps[0])))
    ways = np.zeros((len(order) - r, len(order)))
    ways[:, order[r:]] = np.eye(len(order) - r)
    if r:
        ways[:, order[:r]] = -solve_triangular(R[:r, :r], R[:r, r:]).T
    ways /= sizes
    largest = np.abs(ways * sizes).max(axis=1, initial=0.0)
    ways[np.abs(ways * sizes) < _NAMED * largest[:, None]] = 0.0
    return _DeterminedParameters(np.sort(order[:r]), order[r:], ways)


def _result(
    problem: _Problem, names: tuple[str, ...], p: Array, J: Array, sizes: Array,
    found: _DeterminedParameters, loss: str, at_bounds: NDArray[np.bool_], *, ended: bool,
) -> Fit:  # fmt: skip
    """Fit at parameters p."""
    free, dof = found.free, problem.log.dof - len(found.free)
    if dof <= 0 and len(free):
        raise InvalidArgument(
            f"log: {problem.log.dof} equations are left for {len(free)} parameters, and none to "
            "measure the noise by; log more samples, or fit fewer parameters"
        )
    r = problem.residuals
    psi, slope = (each(r) for each in _LOSSES[loss])
    s = float(np.sqrt((psi**2).sum() / dof) / slope.mean()) if dof else nan
    covariance = np.full((len(p), len(p)), np.nan)
    R = np.linalg.qr(J[:, free] / sizes[free], mode="r")
    root = np.linalg.solve(R, np.eye(len(free))) * s / sizes[free][:, None]
    covariance[np.ix_(free, free)] = root @ root.T
    unknown = found.ways.any(axis=0)
    covariance[unknown], covariance[:, unknown] = np.nan, np.nan
    covariance[unknown, unknown] = np.inf
    status = FitStatus.CONVERGED if ended else FitStatus.OUT_OF_ITERATIONS
    if len(found.held):
        status = FitStatus.NOT_IDENTIFIABLE
    return Fit(
        names, read_only(p.copy()), read_only(np.sqrt(np.diagonal(covariance))),
        read_only(covariance), read_only(r.copy()), s, dof, status,
        tuple(_combination(names, way, j) for way, j in zip(found.ways, found.held, strict=True)),
        tuple(np.array(names)[at_bounds].tolist()), problem.scene,
    )  # fmt: skip


def _combination(names: tuple[str, ...], way: Array, j: int) -> str:
    """Text of a direction of p along which the log does not change."""
    parts = [
        f"{'-' if way[i] < 0.0 else '+'} {abs(way[i] / way[j]):.4g} {names[i]}"
        for i in np.flatnonzero(way)
        if i != j
    ]
    return " ".join([names[j], *parts])


def _names(parameters: object) -> tuple[str, ...]:
    """Names of parameters, or InvalidArgument."""
    if isinstance(parameters, str) or not isinstance(parameters, Sequence) or not parameters:
        raise InvalidArgument(
            f"parameters = {parameters!r}: a list of names is needed, such as ['knee/mass']"
        )
    for name in parameters:
        check_type("parameters", name, str, "a list of names is needed, such as ['knee/mass']")
    if twice := sorted({name for name in parameters if list(parameters).count(name) > 1}):
        raise InvalidArgument(f"parameters: {listed(twice)} twice; each name once")
    return tuple(parameters)


_PLACES: Final = ("centre", "place", "frame_a", "frame_b")
_LENGTH_STEP: Final = 1e-5  # of differences by places [m]
_SHARE_STEP: Final = 1e-3  # of differences by all other parameters, of their size


class _Parameter(NamedTuple):
    """Where a number of a scene is."""

    part: str  # of `_SceneDraft`
    i: int
    key: str
    axis: int = 0

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest physical value."""
        most = tolerances.MOST_FRICTION if self.key == "friction" else inf
        return (-inf if self.key in (*_PLACES, "reference") else 0.0), most


class _SceneDraft:
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
        draft = _SceneDraft(scene)
        known = dict(draft.names())
        for name in names:
            if name not in known:
                raise unknown_name("parameter", name, known)
        self._scene, self._places = scene, [known[name] for name in names]
        self.start = np.array([draft.value(each) for each in self._places])
        self.lower, self.upper = np.array([each.bounds for each in self._places]).T

    def scene(self, p: Array) -> Scene:
        """Scene of parameters p."""
        draft = _SceneDraft(self._scene)
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
        draft = _SceneDraft(scene)
        down = draft.value(at) - h
        if self.lower[i] == 0.0:
            down = max(down, 0.1 * h)
        draft.put(at, down)
        one = draft.scene()
        draft = _SceneDraft(scene)
        draft.put(at, down + 2.0 * h)
        return draft.scene(), one, 2.0 * h
