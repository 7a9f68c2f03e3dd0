"""Logs: what was measured on a machine, beside what its scene says.

    S^-1 e_k(p, x_k)        sample k, with noise of size S and unknowns x_k

`TorqueLog` has e in the balance of forces, and unknown forces of constraints; `PoseLog` in
geometry, and unknown configurations. P_k is what projects these out: at the best x_k, P_k S^-1 e_k
is S^-1 e_k.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array, finite, read_only, text_of
from condyn_pin._core.linalg import rank_of
from condyn_pin._core.models import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.forces import ALIGNED, frame_jacobian
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name

_STEPS: Final = 40  # that find a configuration
_POSED: Final = 1e-11  # step that ends that [rad, m]
_LONGEST: Final = 0.4  # of these [rad, m]
_UNIT: Final = 1e-3  # | |quaternion| - 1 | of a measured pose, which is normalised


class Log(ABC):
    """Samples of a machine with noise: `TorqueLog` of its forces, `PoseLog` of its geometry."""

    @abstractmethod
    def bind(self, scene: Scene) -> BoundLog:
        """Return the log beside the scene that it is of, or raise InvalidArgument."""


class BoundLog(ABC):
    """A log beside a scene."""

    dof: int  # equations that are left when the unknowns of each sample are eliminated

    @abstractmethod
    def solve(self, scene: Scene) -> Array | None:
        """Set the unknowns x_k to their best; return P_k (K, m, rows), None if there are none."""

    @abstractmethod
    def rows(self, scene: Scene) -> Array:
        """Return S^-1 e_k at these x_k, and gaps of loops behind it (K, rows)."""


@dataclass(frozen=True, eq=False)
class TorqueLog(Log):
    """A motion with its joint torques, which have noise.

    M a + h - passive - friction - tau = J^T lam + noise,    noise ~ s sigma

    Forces lam of constraints are unknown, and eliminated. So are those of contacts that stick, and
    the normal forces of those that slide; friction opposes the slip. A joint with `JointFriction`
    that is slower than `slow` has an unknown friction.

    Parameters
    ----------
    q : (k, nq) array_like
        Configurations [rad, m]; quaternions x y z w.
    v, a : (k, nv) array_like
        Velocities [rad/s, m/s] and accelerations [rad/s^2, m/s^2], of little noise beside that of
        torques: errors in them count as errors of torques, and where these are not small the
        estimates are biased.
    tau : (k, nv) array_like
        Torques applied, without springs, damping and friction [N m, N]; zero where no motor is.
    sigma : float or (nv,) array_like
        Noise of tau in each coordinate [N m, N], up to a common factor, which the residuals give;
        with another loss than "linear" as it is.
    slow : float
        Slip below which contacts and joints stick [m/s, rad/s].
    touching : float
        Gap below which a contact touches [m, rad].

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or sigma is not positive.
    """

    q: ArrayLike
    v: ArrayLike
    a: ArrayLike
    tau: ArrayLike
    sigma: ArrayLike = 1.0  # [N m, N]
    slow: float = 1e-3  # [m/s, rad/s]
    touching: float = 1e-4  # [m, rad]

    def __post_init__(self) -> None:
        for key in ("q", "v", "a", "tau"):
            object.__setattr__(self, key, _samples(f"log.{key}", getattr(self, key), 2))
        for key in ("v", "a", "tau"):
            if len(getattr(self, key)) != len(self.q):  # type: ignore[arg-type]
                raise InvalidArgument(
                    f"log.{key} has {len(getattr(self, key))} rows and log.q has "
                    f"{len(self.q)}: one for each sample"  # type: ignore[arg-type]
                )
        object.__setattr__(self, "sigma", _positive("log.sigma", self.sigma))
        for key in ("slow", "touching"):
            object.__setattr__(self, key, float(_positive(f"log.{key}", getattr(self, key))))

    def bind(self, scene: Scene) -> BoundLog:
        """Return the log beside a scene."""
        return _BoundTorques(self, scene)


class _BoundTorques(BoundLog):
    """A `TorqueLog` beside its scene: which contacts touch and slide is that of the first scene."""

    def __init__(self, log: TorqueLog, scene: Scene) -> None:
        n, model = scene.robot.nv, scene.robot.unedited
        count = len(np.asarray(log.q))
        self._v, self._a, self._tau = (
            finite(f"log.{key}", getattr(log, key), (count, n)) for key in ("v", "a", "tau")
        )
        self._q = [
            scene.robot.arguments.configuration(f"log.q[{k}]", q)
            for k, q in enumerate(finite("log.q", log.q, (count, model.nq)))
        ]
        sigma = np.asarray(log.sigma)
        self._sigma = np.full(n, sigma) if sigma.ndim == 0 else finite("log.sigma", sigma, n)
        candidates, data = _with_data(scene)
        self._touch, self._slide = [], []
        for k, q in enumerate(self._q):
            algorithms(data).computeJointJacobians(model, data, q)
            gaps, J = candidates.evaluate(data, q)
            slip = (J[: 3 * candidates.cones] @ self._v[k]).reshape(-1, 3)[:, :2]
            speed = np.concatenate((
                np.linalg.norm(slip, axis=1), np.zeros(candidates.half_lines),
                np.abs(J[len(J) - candidates.intervals :] @ self._v[k]),
            ))  # fmt: skip
            near = np.concatenate((gaps < log.touching, np.ones(candidates.intervals, bool)))
            self._touch.append(near)
            self._slide.append(speed > log.slow)
        self._x: list[tuple[Array, Array]] = []

    def solve(self, scene: Scene) -> Array:
        """Set the forces of constraints and contacts to their best."""
        self._x, found, self.dof = [], [], 0
        equations = equations_of(scene.bilateral)
        for q, e, J, A in self._each(scene):
            left = equations.left_out(J, equations.violation(q)) if len(J) else None
            B = np.hstack([(left.kept(J) if left else J).T, A]) / self._sigma[:, None]
            U, S, Vt = np.linalg.svd(B, full_matrices=False)
            r = rank_of(S)
            x = Vt[:r].T @ ((U[:, :r].T @ (e / self._sigma)) / S[:r])
            lam = x[: len(J)]
            self._x.append((left.kept(lam) if left else lam, x[len(J) :]))
            found.append(np.eye(len(e)) - U[:, :r] @ U[:, :r].T)
            self.dof += len(e) - r
        return np.array(found)

    def rows(self, scene: Scene) -> Array:
        """Return M a + h - passive - friction - tau - J^T lam over sigma (K, nv)."""
        of = zip(self._each(scene), self._x, strict=True)
        return np.array([(e - J.T @ lam - A @ x) / self._sigma for (_, e, J, A), (lam, x) in of])

    def _each(self, scene: Scene) -> Iterator[tuple[Array, Array, Array, Array]]:
        """Yield q, what is left of the torques, J, and columns of the unknown contact forces."""
        robot, equations = scene.robot, equations_of(scene.bilateral)
        candidates, data = _with_data(scene)
        for k, (q, v) in enumerate(zip(self._q, self._v, strict=True)):
            terms = equations.terms(q, v)
            e = terms.M @ self._a[k] + terms.h - robot.passive_torque(q, v) - self._tau[k]
            columns = np.zeros((len(v), 0))
            if candidates.rows:
                algorithms(data).computeJointJacobians(robot.unedited, data, q)
                _, rows = candidates.evaluate(data, q)
                known, columns = self._contact_forces(candidates, rows, k)
                e = e - known
            yield q, e, terms.J, columns

    def _contact_forces(self, candidates: Candidates, J: Array, k: int) -> tuple[Array, Array]:
        """Torques of the dry friction of joints that turn, and columns of unknown forces."""
        v, touch, slide = self._v[k], self._touch[k], self._slide[k]
        known, found = np.zeros(len(v)), []
        lines = candidates.cones + candidates.half_lines
        for i in np.flatnonzero(touch).tolist():
            rows = J[candidates.blocks == i]
            if not slide[i]:
                found.extend(rows)
            elif i < candidates.cones:
                slip = rows[:2] @ v
                along = slip / np.linalg.norm(slip)
                found.append(rows[2] - candidates.friction[i] * along @ rows[:2])
            else:
                known -= candidates.limits[i - lines] * np.sign(rows[0] @ v) * rows[0]
        return known, np.array(found).reshape(-1, len(v)).T


def _with_data(scene: Scene) -> tuple[Candidates, Any]:
    """Contacts of a scene, and the memory of its equations to evaluate them in."""
    data = equations_of(scene.bilateral).data
    return Candidates(scene.robot.unedited, scene.contact_bounds), data


@dataclass(frozen=True, eq=False)
class PoseLog(Log):
    """Measured joints and frames of a machine at rest, with noise: kinematic calibration.

    y_k = g(q_k) + noise,    c(q_k, p) = 0,    noise ~ s sigma

    The configurations q_k are unknown, and eliminated: each is the closed one that is nearest to
    what was measured.

    Parameters
    ----------
    joints : mapping of str to (k,) array_like
        Values of hinges and sliders by name [rad, m], such as lengths of legs.
    frames : mapping of str to (k, 3) or (k, 7) array_like
        Positions of frames in the world [m], or with their quaternions x y z w.
    sigma : mapping of str to float or pair of float, optional
        Noise of each by name, up to a common factor [rad, m]; of poses a pair, of position and
        rotation. One by default, metres beside radians.
    start : (nq,) array_like, optional
        Configuration near all samples, on their branch [rad, m]; the first posture by default.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or sigma is not positive.
    """

    joints: Mapping[str, ArrayLike] = field(default_factory=dict)
    frames: Mapping[str, ArrayLike] = field(default_factory=dict)
    sigma: Mapping[str, ArrayLike] = field(default_factory=dict)  # [rad, m]
    start: ArrayLike | None = None

    def __post_init__(self) -> None:
        for key in ("joints", "frames", "sigma"):
            check_type(f"log.{key}", getattr(self, key), Mapping, "a mapping of names is needed")
        made = {
            key: {name: _samples(f"log.{key}[{name!r}]", y, axes) for name, y in given.items()}
            for key, given, axes in (("joints", self.joints, 1), ("frames", self.frames, 2))
        }
        counts = {name: len(y) for each in made.values() for name, y in each.items()}
        if not counts:
            raise InvalidArgument("log: it has no joints and no frames; name what was measured")
        if len(set(counts.values())) > 1:
            raise InvalidArgument(f"log: samples of each are {counts}: as many of one as of all")
        for name, y in made["frames"].items():
            if y.shape[1] not in (3, 7):
                raise InvalidArgument(
                    f"log.frames[{name!r}] has shape {y.shape}: (k, 3) or (k, 7) is needed"
                )
            if y.shape[1] == 7 and np.abs(np.linalg.norm(y[:, 3:], axis=1) - 1.0).max() > _UNIT:
                raise InvalidArgument(
                    f"log.frames[{name!r}]: x y z and a unit quaternion x y z w are needed"
                )
        sigma = {name: _positive(f"log.sigma[{name!r}]", s) for name, s in self.sigma.items()}
        for name, s in sigma.items():
            if name not in counts:
                raise unknown_name("measured joint or frame", name, counts)
            if s.ndim and (s.shape != (2,) or made["frames"].get(name, s).shape[-1] != 7):
                raise InvalidArgument(
                    f"log.sigma[{name!r}] has shape {s.shape}: one number is needed, and of a pose "
                    "(position, rotation)"
                )
        for key, value in {**made, "sigma": sigma}.items():
            object.__setattr__(self, key, MappingProxyType(value))

    def bind(self, scene: Scene) -> BoundLog:
        """Return the log beside a scene."""
        return _BoundPoses(self, scene)


class _BoundPoses(BoundLog):
    """A `PoseLog` beside its scene, with the configuration of each sample."""

    def __init__(self, log: PoseLog, scene: Scene) -> None:
        robot = scene.robot
        self._joints = [
            (robot.index_q(j), robot.index_v(j), np.asarray(y)) for j, y in log.joints.items()
        ]
        self._frames = [(*robot.frame(f), np.asarray(y)) for f, y in log.frames.items()]
        self._sigma = np.concatenate(
            [np.full(1, log.sigma.get(j, 1.0)) for j in log.joints]
            + [
                np.repeat(np.broadcast_to(log.sigma.get(f, 1.0), np.shape(y)[1] // 3), 3)
                for f, y in log.frames.items()
            ]
        )
        count = len(next(iter([*log.joints.values(), *log.frames.values()])))  # type: ignore[arg-type]
        start = scene.closed_posture() if log.start is None else log.start
        q = robot.arguments.configuration("log.start", finite("log.start", start, robot.nq))
        self._q = [q] * count

    def solve(self, scene: Scene) -> Array | None:
        """Set the configurations to the closed ones that are nearest to what was measured."""
        equations, model = equations_of(scene), scene.robot.unedited
        found, closed, dof = [], [], 0
        for k, q in enumerate(self._q):
            for _ in range(_STEPS):
                e, H = self._measured(scene, k, q)
                c, J = equations.position_level(q)
                left = equations.left_out(J, c) if len(c) else None
                if left:
                    c, J = left.kept(c), left.kept(J)
                U, S, Vt = np.linalg.svd(J)
                r = rank_of(S)
                back, free = Vt[:r].T @ (U[:, :r].T / S[:r, None]), Vt[r:].T
                V, T, Wt = np.linalg.svd(H @ free, full_matrices=False)
                seen = rank_of(T)
                dq = -back @ c
                y = (V[:, :seen].T @ (e + H @ dq)) / T[:seen]
                dq = dq - free @ (Wt[:seen].T @ y)
                size = float(np.abs(dq).max(initial=0.0))
                if not np.isfinite(size) or size < _POSED:
                    break
                q = pin.integrate(model, q, dq * min(1.0, _LONGEST / size))
            if not size < _POSED or np.abs(c).max(initial=0.0) > tolerances.CLOSED:
                return None
            P = np.eye(len(e)) - V[:, :seen] @ V[:, :seen].T
            of_c = left.kept(back.T).T if left else back
            found.append(P @ np.hstack([np.eye(len(e)), -H @ of_c]))
            closed.append(q)
            dof += len(e) - seen
        self._q, self.dof = closed, dof
        return np.array(found)

    def rows(self, scene: Scene) -> Array:
        """Return g(q) - y over sigma, and c(q) (K, m + rows)."""
        equations = equations_of(scene)
        return np.array([
            np.concatenate((self._measured(scene, k, q)[0], equations.violation(q)))
            for k, q in enumerate(self._q)
        ])  # fmt: skip

    def _measured(self, scene: Scene, k: int, q: Array) -> tuple[Array, Array]:
        """Return g(q) - y of sample k over sigma, and its derivative by q."""
        model, data = scene.robot.unedited, equations_of(scene).data
        algorithms(data).computeJointJacobians(model, data, q)
        e = [np.array([q[iq] - y[k]]) for iq, _, y in self._joints]
        H = [np.eye(model.nv)[iv : iv + 1] for _, iv, _ in self._joints]
        for joint, placement, y in self._frames:
            at = data.oMi[joint] * placement
            e.append(at.translation - y[k, :3])
            H.append(frame_jacobian(model, data, joint, placement, ALIGNED)[:3])
            if y.shape[1] == 7:
                x, y_, z, w = y[k, 3:] / np.linalg.norm(y[k, 3:])
                R = pin.Quaternion(w, x, y_, z).toRotationMatrix().T @ at.rotation
                e.append(pin.log3(R))
                turn = frame_jacobian(model, data, joint, placement, LOCAL)[3:]
                H.append(pin.Jlog3(R) @ turn)
        return np.concatenate(e) / self._sigma, np.vstack(H) / self._sigma[:, None]


def _samples(name: str, value: ArrayLike, axes: int) -> Array:
    """Read-only numbers of samples, one or more rows of them."""
    shape = np.shape(value)
    if len(shape) != axes or not shape[0]:
        row = "(k,)" if axes == 1 else "(k, n)"
        raise InvalidArgument(f"{name} has shape {shape}: {row} is needed, a row for each sample")
    return read_only(np.array(finite(name, value, shape)))


def _positive(name: str, value: ArrayLike) -> Array:
    """Positive numbers of any shape."""
    found = finite(name, value, np.shape(value))
    if not (found > 0.0).all():
        raise InvalidArgument(f"{name} = {text_of(value)}: positive numbers are needed")
    return read_only(np.array(found))
