"""Workspace: the one mutable thing, where a scene is solved again and again."""

from __future__ import annotations

from functools import cached_property
from math import inf, isfinite, nan
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import _pin, tolerances
from condyn_pin._pin import pin
from condyn_pin.binding import Bound
from condyn_pin.equations import Equations, Terms
from condyn_pin.errors import InvalidArgument, InvalidModel, SolveFailed
from condyn_pin.proof import Proof
from condyn_pin.raw import raw_constraints
from condyn_pin.robot import Vector
from condyn_pin.scene import Scene
from condyn_pin.solution import Solution, Status
from condyn_pin.solvers.base import Singular, Solver
from condyn_pin.solvers.proximal import Proximal


class Workspace:
    """Memory for one scene and one solver; use one per thread.

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional
        `Proximal()` by default.

    Attributes
    ----------
    scene, solver : Scene, Solver
    model, data, constraint_models, constraint_datas, proximal_settings
        Pinocchio's raw objects, for what this library does not offer. You may call any function
        of Pinocchio on `model` and `data` between two solves, and set Baumgarte gains or
        `contact_acceleration_desired` for your own calls. You may not append to or remove from
        the lists (`StaleModel`), edit the model, or call `initConstraintDynamics` with other
        lists; after `LCABA` the constraint datas must not go into `pin.constraintDynamics`.
        `model` is a private copy: an edit of ``robot.model`` does not reach a workspace.

    Notes
    -----
    Building one costs 0.3 to 0.8 ms, most of it Pinocchio's `createData`; a solve costs 10 to
    40 us. Pinocchio does not release the GIL, so threads do not solve in parallel; processes do.
    """

    def __init__(self, scene: Scene, solver: Solver | None = None) -> None:
        if not isinstance(scene, Scene):
            raise InvalidArgument(f"scene = {type(scene).__name__}: a Scene is needed")
        self.solver = Proximal() if solver is None else solver
        if not isinstance(self.solver, Solver):
            raise InvalidArgument(
                f"solver = {solver!r}: a solver object is needed, such as Proximal() or LCABA()"
            )
        scene.robot.check_unedited()
        self.model = pin.Model(scene.robot.model)
        self.data = self.model.createData()
        self._unit_parts = _unit_parts(self.model)
        self._quaternions = tuple(p for p in self._unit_parts if p.stop - p.start == 4)
        self._shapes = ((self.model.nq,), (self.model.nv,), (self.model.nv,))
        self._roots = tuple(
            int(joint.idx_v)
            for joint, parent in zip(self.model.joints, self.model.parents, strict=True)
            if parent == 0 and joint.idx_v >= 0
        )
        self.use(scene)

    def use(self, scene: Scene) -> None:
        """Switch to another scene of the same robot: other contacts, the same memory.

        Everything that depends on the constraints is made anew; nothing of the old ones is left.
        """
        if scene.robot.model != self.model:
            raise InvalidArgument(
                f"scene: its robot {scene.robot.name!r} has another model; make a new Workspace"
            )
        self.scene = scene
        self.bounds: tuple[Bound, ...] = scene.bounds
        self.constraint_models, self.constraint_datas = raw_constraints(self.model, self.bounds)
        _pin.init_constraint_dynamics(
            self.model, self.data, self.constraint_models, self.constraint_datas
        )
        self.proximal_settings: Any = None
        self._yardstick = scene.audit.yardstick
        self._flipped = any(bound.sign < 0 for bound in self.bounds)
        self.__dict__.pop("equations", None)
        self._method = self.solver.start(self)
        self._run = self._method.acceleration

    @cached_property
    def equations(self) -> Equations:
        """The equations of the scene, in memory of their own that no solver writes to."""
        return Equations(self.model, self.bounds)

    def acceleration(self, q: Vector, v: Vector, tau: Vector) -> Vector:
        """Return a, nothing else: the hot loop.

        Sizes, finiteness and quaternions are checked; the errors of the answer are not. `solve`
        does that, for about twice the time.

        Parameters
        ----------
        q, v, tau : (nq,), (nv,), (nv,) array

        Returns
        -------
        (nv,) array
            Owned by the caller.

        Raises
        ------
        InvalidArgument
            If an argument has a wrong size, is not finite, or has an unnormalised quaternion.
        SolveFailed
            If the answer is not finite, or the method's matrix is singular.
        """
        try:
            for part in self._quaternions:
                x, y, z, w = q[part].tolist()
                if not _LOW < x * x + y * y + z * z + w * w < _HIGH:
                    raise ValueError
            a = self._run(q, v, tau)
            # A joint's acceleration depends on everything above it in the tree, and its root's on
            # everything below: what is not finite anywhere is not finite at a root.
            for i in self._roots:
                if not -_HUGE < a.item(i) < _HUGE:
                    raise ValueError
            return a
        except (ValueError, TypeError, AttributeError, Singular):
            return self._careful_acceleration(q, v, tau)

    def _careful_acceleration(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Vector:
        """Accept what only needs converting; say what is wrong with anything else."""
        solution = self.solve(q, v, tau, throw=False)
        if not np.isfinite(solution.a).all():
            raise self._failure(solution)
        return solution.a

    def solve(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, *, throw: bool = True
    ) -> Solution:
        """Return a, lam and the proof of both.

        Parameters
        ----------
        q, v, tau : (nq,), (nv,), (nv,) array_like
        throw : bool
            Raise if the status is not ok. With False the same Solution comes back, whatever its
            status.

        Raises
        ------
        InvalidArgument
            As in `acceleration`.
        SolveFailed
            If the status is not ok; its `solution` has everything that was computed.
        """
        if not self._plain(q, v, tau):
            q, v, tau = self._checked(q, v, tau)
        start = perf_counter()
        try:
            a = self._run(q, v, tau)
        except Singular:
            solution = self._unproven(q, perf_counter() - start)
        else:
            solution = self._proven(q, v, tau, a, perf_counter() - start)
        if solution.status is not _OK:
            self._checked(q, v, tau)  # an input that is not finite is the input's fault
            if throw:
                raise self._failure(solution)
        return solution

    def _plain(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> bool:
        """Return whether the arguments are arrays of the right size, with unit quaternions."""
        try:
            for part in self._quaternions:
                x, y, z, w = q[part].tolist()  # type: ignore[call-overload, index, union-attr]
                if not _LOW < x * x + y * y + z * z + w * w < _HIGH:
                    return False
            return (
                self._shapes == (q.shape, v.shape, tau.shape)  # type: ignore[union-attr]
                and q.dtype is v.dtype is tau.dtype is _FLOAT  # type: ignore[union-attr]
                and len(self._unit_parts) == len(self._quaternions)
            )
        except (TypeError, ValueError, AttributeError):
            return False

    def _proven(self, q: Vector, v: Vector, tau: Vector, a: Vector, solve_time: float) -> Solution:
        lam = self._method.lam()
        if self._flipped:
            lam *= self.equations.sign
        errors = self.equations.errors(q, v, tau, a, lam)
        proof = self._yardstick.prove(errors, tau)
        if proof.bound <= tolerances.SOLVED:
            status = _OK
        elif isfinite(proof.bound):
            status = Status.INACCURATE
        else:
            status = Status.NOT_FINITE
        iterations = self._method.iterations()
        return Solution(a, lam, proof, status, iterations, solve_time, self.scene, q.copy())

    def _unproven(self, q: Vector, solve_time: float) -> Solution:
        """Return the solution of a method that met a singular matrix."""
        violation = float(np.abs(self.equations.violation(q)).max(initial=0.0))
        return Solution(
            np.full(self.model.nv, nan),
            np.full(self.scene.rows, nan),
            Proof(inf, inf, violation, nan, inf),
            Status.SINGULAR,
            self._method.iterations(),
            solve_time,
            self.scene,
            q.copy(),
        )

    def _failure(self, solution: Solution) -> SolveFailed:
        return SolveFailed(
            f"{self.solver!r} on {self.scene.robot.name}: {solution.status}", solution
        )

    def terms(self, q: ArrayLike, v: ArrayLike) -> Terms:
        """Return M, h, J, gamma and a_ref at a state."""
        q, v, _ = self._checked(q, v, np.zeros(self.model.nv))
        return self.equations.terms(q, v)

    def jacobian(self, q: ArrayLike) -> Vector:
        """Return the constraint Jacobian J (m, nv)."""
        q, _, _ = self._checked(q, np.zeros(self.model.nv), np.zeros(self.model.nv))
        return self.equations.jacobian(q)

    def violation(self, q: ArrayLike) -> Vector:
        """Return c(q) (m,) [m, rad]."""
        q, _, _ = self._checked(q, np.zeros(self.model.nv), np.zeros(self.model.nv))
        return self.equations.violation(q)

    def _checked(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> tuple[Vector, Vector, Vector]:
        """Return the arguments as arrays of the right size, or raise InvalidArgument."""
        model = self.model
        q = _array("q", q, model.nq)
        for part in self._unit_parts:
            x = q[part]
            if not _LOW < x.dot(x) < _HIGH:
                raise InvalidArgument(
                    f"q[{part.start}:{part.stop}] = {x} has norm {np.sqrt(x.dot(x)):.9g}: "
                    "a unit quaternion (x y z w) or (cos, sin) is needed; "
                    "pin.normalize(robot.model, q) makes one"
                )
        return q, _array("v", v, model.nv), _array("tau", tau, model.nv)


# of the squared norm of a unit part of q
_LOW, _HIGH = 1.0 - 2 * tolerances.QUATERNION, 1.0 + 2 * tolerances.QUATERNION

_FLOAT = np.dtype(np.float64)
_OK = Status.OK

# No acceleration of a machine: what is larger goes the slow way, where every entry is looked at.
_HUGE = 1e100

# Where the unit part of a joint's configuration begins, and its size.
_UNIT_PARTS = {
    "JointModelFreeFlyer": (3, 4),
    "JointModelSpherical": (0, 4),
    "JointModelPlanar": (2, 2),
    "JointModelRUBX": (0, 2),
    "JointModelRUBY": (0, 2),
    "JointModelRUBZ": (0, 2),
    "JointModelRevoluteUnboundedUnaligned": (0, 2),
}


def _unit_parts(model: Any) -> tuple[slice, ...]:
    """Return where q holds quaternions and (cos, sin) pairs, which have to be normalised."""
    parts = []
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.nq == joint.nv or joint.idx_q < 0:
            continue
        if joint.shortname() not in _UNIT_PARTS:
            raise InvalidModel(
                f"joint {name!r} is a {joint.shortname()} whose configuration cannot be checked; "
                "split it into joints that Pinocchio has by themselves"
            )
        start, size = _UNIT_PARTS[joint.shortname()]
        parts.append(slice(joint.idx_q + start, joint.idx_q + start + size))
    return tuple(parts)


def _array(name: str, value: ArrayLike, size: int) -> Vector:
    if type(value) is np.ndarray and value.dtype == np.float64:
        array = value
    else:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidArgument(f"{name}: {size} numbers are needed ({error})") from error
    if array.shape != (size,):
        raise InvalidArgument(f"{name} has shape {array.shape}: ({size},) is needed")
    if not isfinite(array.dot(array)) and not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array))
        raise InvalidArgument(f"{name}[{bad[0]}] = {array[bad[0]]}: finite numbers are needed")
    return array
