"""Workspace, where a scene is solved again and again, and the verbs solve and derivatives."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from threading import get_ident
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import (
    FLOAT,
    HIGH,
    LOW,
    NOT_LOOSE,
    QUATERNION_TOLERANCE,
    Given,
    State,
    check_accuracy_of_a,
    check_type,
    short_repr,
    unpack_quaternion,
)
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import Engine, is_compiled
from condyn_pin._core.models import Forest, is_forest, whole_data
from condyn_pin._core.threads import (
    OneThread,
    ThreadCache,
    in_use,
    one_blas_thread,
    single_threaded,
)
from condyn_pin.constraints.drift import Baumgarte, stabilisation
from condyn_pin.constraints.forces import AppliedForce, Loads, applied_forces
from condyn_pin.constraints.rows.bound import BoundConstraint, Terms, finite_terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import ConstraintDatas, ConstraintModels, raw_constraints
from condyn_pin.dynamics.nominal import (
    NominalAnalysis,
    pinocchio_constraints_of,
    scene_without_time,
)
from condyn_pin.dynamics.proof import Verifier, consistent_where_open, failure, without_idle_rows
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_scene, check_time
from condyn_pin.dynamics.solution import Solution, Status
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.null_space import NullSpace
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver
from condyn_pin.errors import (
    InvalidArgument,
    MissingExtra,
    UnsupportedBackend,
    UnsupportedConstraint,
    unknown_name,
)

if TYPE_CHECKING:
    from condyn_pin.dynamics.compiled import CompiledCore
    from condyn_pin.dynamics.derivatives.kkt import Linearisation
    from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives

# Choice of a solver: which one takes which scene.


_USUAL = Proximal()


def default_solver(scene: Scene) -> Solver:
    """Return the default solver."""
    # `Proximal`; for kinds of constraints that it cannot take, `DenseKKT`, and `NullSpace` if there
    # are redundant rows besides.
    if not pinocchio_constraints_of(scene).unsupported:
        return _USUAL
    return NullSpace() if scene.nominal.dependent else DenseKKT()


def constraint_kinds_of(solver: type[Solver]) -> str:
    """Return in words which kinds of constraints a solver takes."""
    if solver.takes_every_kind:
        return "every kind"
    if not solver.takes_loops:
        return "points, welds, hinges and edges that hold bodies at the world"
    if solver.takes_approximated:
        return "points, welds, hinges, edges and the planar pins of linkages in a plane"
    return "points and welds"


def unsupported_constraints(scene: Scene, solver: Solver) -> tuple[str, ...]:
    """Return the names of the constraints that a solver cannot take."""
    found = pinocchio_constraints_of(scene)
    if solver.takes_every_kind:
        return ()
    names: tuple[str, ...] = ()
    if not solver.takes_approximated:
        names += found.approximated
    elif not solver.takes_world_first:
        names += found.world_first
    if not solver.takes_loops:
        names += found.loops
    return tuple(dict.fromkeys(names + found.unsupported))


def check_kinds(scene: Scene, solver: Solver) -> None:
    """Raise `UnsupportedConstraint` if a solver cannot take a constraint of the scene."""
    names = unsupported_constraints(scene, solver)
    if names:
        raise UnsupportedConstraint(_refusal(scene, solver, names))


def _refusal(scene: Scene, solver: Solver, names: Sequence[str]) -> str:
    """Return why a solver cannot take these constraints, and which ones can."""
    from condyn_pin.dynamics.solvers import SOLVERS  # imports them all

    found, able, why = pinocchio_constraints_of(scene), ["Proximal()"], []
    loops = [] if solver.takes_loops else [name for name in names if name in found.loops]
    others = [name for name in names if name not in loops]
    first = solver.takes_approximated and set(others) <= set(found.world_first)
    if loops:
        why.append(f"its recursion ends at the world, and {', '.join(loops)} joins moving bodies")
        able.append("LCABA()")
    if others and first:
        why.append(f"its recursion fails where the world comes first, as in {', '.join(others)}")
        able.append("exchange its frames")
    elif others:
        why.append(
            f"Pinocchio has constraints of 3 and of 6 rows, and {', '.join(others)} cannot be made "
            "of those"
        )
    if found.unsupported:
        able = [f"{k.__name__}()" for k in SOLVERS.values() if k.takes_every_kind and k.exact]
    taken = f"{type(solver).__name__} takes {constraint_kinds_of(type(solver))}"
    return f"{taken}: {', and '.join(why)}; use {' or '.join(able)}"


# Workspace: the one mutable thing, where a scene is solved again and again.


# No acceleration of a machine: larger ones are checked entry by entry.
LARGEST: Final = 1e100
SMALLEST: Final = -1e100

_OK = Status.OK

_LOW, _HIGH = NOT_LOOSE

# The default, known by its identity: what else is handed in may have no truth value.
_NO_FORCES: Final[tuple[AppliedForce, ...]] = ()


class Workspace(OneThread):
    """Memory for one scene and one solver; use one per thread.

    Parameters
    ----------
    scene : Scene
    solver : Solver, optional
        By default `Proximal()` where it takes all constraints, else as in `solve`.
    drift : Baumgarte, optional
        Baumgarte stabilisation: it gives a_ref, which is zero by default.
    engine : {"python", "auto", "core"}
        Who answers `solve` and `derivatives`: Python, in the memory of Pinocchio that the
        workspace shows, or the compiled core, with the same answers in less time. "auto" has
        Python answer what the core does not take, and everything where no core is installed;
        "core" refuses a scene or solver that the core does not take.
    native : bool, optional
        Name of `engine` in the last version: True is "core". It goes with the next.

    Attributes
    ----------
    scene, solver : Scene, Solver
    model, data, constraint_models, constraint_datas, proximal_settings
        Pinocchio's raw objects, for what this library does not offer. Between two solves you may
        call any function of Pinocchio on `model`, a private copy, and `data`, and read the lists
        and the settings of the last answer. You may not resize the lists (`StaleModel`), edit the
        model, initialise `data` for other constraints, or leave Baumgarte gains or
        `contact_acceleration_desired` behind: the next solve would read them. After `LCABA` the
        constraint datas must not go into `pin.constraintDynamics`, which reads what `lcaba` left.

    Raises
    ------
    InvalidArgument
        If an argument is none of these.
    UnsupportedConstraint
        If contacts of the scene may open, constraints are driven and the scene does not say at
        which time it is, or the solver does not take a kind.
    UnsupportedBackend
        If the engine is "core", which does not take the scene or the solver.
    MissingExtra
        If the engine is "core", and it is not installed.
    StaleModel
        If the robot's model was edited since it was loaded.

    Notes
    -----
    Building one takes as long as dozens of solves (`benchmarks/timings.py startup`); for large
    robots most of that is Pinocchio's `createData`. If the first posture of the scene leaves loops
    open it takes longer: they are closed once, because redundant rows can only be found where loops
    are closed.

    Pinocchio does not release the GIL: threads do not solve in parallel, processes do. A call that
    finds another thread at work raises `SharedWorkspace`.
    """

    _solved_by = 0  # the thread that has called `acceleration` last

    def __init__(
        self, scene: Scene, solver: Solver | None = None, *, drift: Baumgarte | None = None,
        engine: Engine = "python", native: bool | None = None,
    ) -> None:  # fmt: skip
        check_scene(scene)
        if native is not None:
            engine = "core" if native else "python"
            text = f"native = {native!r} is engine = {engine!r} now"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
        self.engine, self._by_core = engine, is_compiled(engine)
        if not isinstance(solver, Solver | None):
            raise InvalidArgument(
                f"solver = {solver!r}: a solver object is needed, such as Proximal() or LCABA()"
            )
        check_type("drift", drift, Baumgarte | None, "Baumgarte(alpha, beta) or None is needed")
        check_bilateral(scene)
        check_time(scene)
        scene.robot.check_unedited()
        self.model, self.drift = pin.Model(scene.robot.model), drift
        self._drift = drift  # of constraints that have none of their own
        self._arguments = scene.robot.arguments
        equations = self._analysed(scene)
        self.solver = default_solver(scene) if solver is None else solver
        self._quaternions, self._pairs = self._arguments.quaternions, self._arguments.pairs
        self.roots = self._arguments.roots
        self._start(scene, equations)

    @single_threaded
    def use(self, scene: Scene) -> None:
        """Switch to another scene of the same robot: other contacts, the same memory.

        Everything that depends on the constraints is rebuilt; nothing of the old ones is left.

        Raises
        ------
        InvalidArgument
            If the robot of the scene has another model.
        UnsupportedConstraint
            As for a new `Workspace`.
        """
        check_scene(scene)
        if scene.robot.model != self.model:
            raise InvalidArgument(
                f"scene: its robot {scene.robot.name!r} has another model; make a new Workspace"
            )
        check_bilateral(scene)
        check_time(scene)
        self._start(scene, self._analysed(scene))

    def _started(self) -> BoundSolver:
        """The solver at work; where nothing is constrained all of them do the same to a forest."""
        if self.scene.rows or not is_forest(self.model):
            return self.solver.start(self)
        forest = Forest(self.model)
        return BoundSolver(partial(forest.aba, self.model, forest), lambda: np.zeros(0), lambda: 0)

    def _start(self, scene: Scene, equations: Equations | None) -> None:
        check_kinds(scene, self.solver)
        self._hold(scene, equations)
        self.bound = self._started()  # also what a simulation calls in a step
        differs = scene.nominal.looks_independent or self.pinocchio_constraints.approximated
        if differs and not self.solver.takes_open:
            self.bound = consistent_where_open(self, self.bound)
        elif scene.nominal.idle.any():
            self.bound = without_idle_rows(self.bound, scene.nominal.idle)
        self._verifier = Verifier(self, self._exact)
        self.core = self._compiled_or_none() if self._by_core else None

    def _analysed(self, scene: Scene) -> Equations | None:
        """Analyse a scene, unless it was; return the equations made for that, to be used again."""
        if "nominal" in vars(scene) or scene_without_time(scene) is not scene:
            return None
        equations = Equations(self.model, scene.bounds)
        vars(scene)["nominal"] = NominalAnalysis(scene, equations)
        equations.stabilise(stabilisation(scene.bounds, self._drift))
        return equations

    def _hold(self, scene: Scene, equations: Equations | None) -> None:
        """Take another scene of the same model; nothing of the old one is left."""
        self.scene = scene
        self.check_unedited = scene.robot.check_unedited
        self.bounds: tuple[BoundConstraint, ...] = scene.bounds
        self.drift = stabilisation(scene.bounds, self._drift)
        self.pinocchio_constraints = pinocchio_constraints_of(scene)
        self.proximal_settings: Any = None
        for made_on_demand in ("_made", "equations", "linearisation", "loads", "compiled"):
            self.__dict__.pop(made_on_demand, None)
        if equations is not None:
            self.equations = self._with_redundancy(equations)

    @property
    def _exact(self) -> BoundSolver:
        """The method of `solve`."""
        return self.bound.exact or self.bound

    def _compiled_or_none(self) -> CompiledCore | None:
        """Return the workspace in compiled code, or None where Python answers in its place."""
        try:
            return self.compiled
        except (UnsupportedBackend, MissingExtra):
            if self.engine == "core":
                raise
            return None

    def __repr__(self) -> str:
        settings = self.proximal_settings
        found = f", mu {settings.mu:.3g} 1/kg" if settings else ""
        of = f"{self.scene.robot.name}, {self.scene.rows} rows"
        by = ", compiled core" if self.core else ""
        return f"Workspace({of}: {short_repr(self.solver)}{found}{by})"

    @cached_property
    def compiled(self) -> CompiledCore:
        """The workspace in compiled code; UnsupportedBackend if the core does not take it."""
        # imported here: most do without
        from condyn_pin.dynamics.compiled import CompiledCore

        return CompiledCore(self)

    def acceleration(
        self, q: Array, v: Array, tau: Array, *, forces: Sequence[AppliedForce] = _NO_FORCES
    ) -> Array:
        """Return a and nothing else: for hot loops.

        Sizes, finiteness and quaternions are checked; the errors of the answer are not. `solve`
        checks them too, which takes longer.

        Parameters
        ----------
        q, v, tau : (nq,), (nv,), (nv,) array
            Configuration, velocity [rad/s, m/s] and joint torques [N m, N], as in `solve`.
        forces : sequence of AppliedForce, optional
            Forces from outside; none by default.

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
        SharedWorkspace
            If another thread is at work in it.
        StaleModel
            If the robot's model was edited in place.

        Notes
        -----
        Of the answer only the joints at the root are checked: input that is not finite always shows
        there. Finite input beyond 1e100 may overflow elsewhere, and come back as inf.
        """
        self.check_unedited()
        if forces is not _NO_FORCES:
            return self._pushed_acceleration(q, v, tau, forces)
        me, user = get_ident(), self._user  # `single_threaded`, without its call
        if user and user != me:
            raise in_use()
        self._user = self._solved_by = me
        try:
            loose = bool(self._pairs)
            for offset in self._quaternions:
                x, y, z, w = unpack_quaternion(q, offset)
                square = x * x + y * y + z * z + w * w
                if not _LOW < square < _HIGH:
                    if not LOW < square < HIGH:
                        raise ValueError
                    loose = True
            if self._pairs:
                self._arguments.check_pairs(q)
            # Pinocchio ignores byte order: another dtype is another number. To ask whether it is
            # the very same object is quicker, and an array that was pickled has another one.
            same = q.dtype is v.dtype is tau.dtype is FLOAT
            if not (same or q.dtype == v.dtype == tau.dtype == FLOAT):
                raise ValueError
            if loose:
                q = self._tightened(q)
            a = self.bound.acceleration(q, v, tau)
            for i in self.roots:
                if not SMALLEST < a.item(i) < LARGEST:
                    raise ValueError
            return a
        except (ValueError, TypeError, AttributeError, struct.error, Singular):
            return self.careful_acceleration(q, v, tau)
        finally:
            self._user = user

    def _tightened(self, q: Array) -> Array:
        """A configuration whose quaternions and (cos, sin) have norm 1, or q if they do."""
        if pin.isNormalized(self.model, q, QUATERNION_TOLERANCE):
            return q
        return np.array(pin.normalize(self.model, q))

    @single_threaded
    def _pushed_acceleration(
        self, q: Array, v: Array, tau: Array, forces: Sequence[AppliedForce]
    ) -> Array:
        q, v, tau = self._arguments.check(q, v, tau)
        return self.acceleration(q, v, tau + self.loads.at(q, applied_forces(forces)).torque)

    def next_acceleration(self, q: Array, v: Array, tau: Array) -> Array:
        """Return `acceleration`, which it forwards to; it goes with the next version."""
        text = "Workspace.next_acceleration is Workspace.acceleration"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return self.acceleration(q, v, tau)

    def lam(self) -> Array:
        """Return the constraint forces (m,) of the last `acceleration` [N, N m], a copy."""
        if self._solved_by and self._solved_by != get_ident():
            raise in_use("the last `acceleration` of this Workspace was another thread's")
        return self.bound.lam()

    def careful_acceleration(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Return a (nv,) of arguments that need converting, or raise what is wrong with them."""
        q, v, tau = self._arguments.check(q, v, tau)
        solution = self.solve(q, v, tau, throw=False)
        if not np.isfinite(solution.a).all():
            raise failure(self, solution)
        return solution.a

    def solve(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        *,
        forces: Sequence[AppliedForce] = _NO_FORCES,
        accuracy: float | None = None,
        throw: bool = True,
    ) -> Solution:
        """Return a and lam, verified.

        `forces`, `accuracy` and `throw` are those of `condyn_pin.solve`, and so are the errors.

        Raises
        ------
        SharedWorkspace
            If another thread is at work in it.
        """
        self.check_unedited()
        accuracy = self.solver.accuracy if accuracy is None else check_accuracy_of_a(accuracy)
        if forces is not _NO_FORCES:
            forces = applied_forces(forces)
        if self.core:
            if not forces:
                if self._user:  # no other thread begins meanwhile: the core holds the GIL
                    self.check_alone()
                found = self.core.one(q, v, tau, accuracy)
                if found:
                    return found
            elif self.engine == "core":
                self.core.check(forces)
        return self._by_python((q, v, tau), forces, accuracy, throw)

    @single_threaded
    def _by_python(
        self, state: Given, forces: Sequence[AppliedForce], accuracy: float, throw: bool
    ) -> Solution:
        """Return `solve` without the core."""
        return self._answered(self._arguments.accept(*state), forces, accuracy, throw)

    def _answered(
        self, state: State, forces: Sequence[AppliedForce], accuracy: float, throw: bool
    ) -> Solution:
        """Return `solve` of accepted arguments; the caller has the workspace to itself."""
        q, v, tau = state
        if self._arguments.units:
            q = self._tightened(q)
            state = q, v, tau
        self._solved_by = get_ident()
        start = perf_counter()
        load = self.loads.at(q, forces) if forces else None
        try:
            a = self._exact.acceleration(q, v, tau + load.torque if load else tau)
        except Singular:
            solution = self._verifier.failed(state, perf_counter() - start, load)
        else:
            took, verify = perf_counter() - start, self._verifier.verify
            for i in self.roots:
                if not SMALLEST < a.item(i) < LARGEST:  # the status says it, so numpy need not
                    with np.errstate(all="ignore"):
                        solution = verify(state, a, accuracy, took, load)
                    break
            else:
                solution = verify(state, a, accuracy, took, load)
        if solution.status is not _OK:
            self._arguments.check(q, v, tau)  # what is not finite may be the input's fault
            if throw:
                enough = self._verifier.passing_accuracy(solution, state, load)
                raise failure(self, solution, enough)
        return solution

    def derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        *,
        forces: Sequence[AppliedForce] = _NO_FORCES,
        method: str = "kkt",
        check: bool = False,
        accuracy: float | None = None,
    ) -> Derivatives:
        """Return the derivatives of a and lam by q, v and tau.

        `forces`, `method`, `check` and `accuracy` are those of `condyn_pin.derivatives`, and so are
        the errors.
        """
        self.check_unedited()
        accuracy = self.solver.accuracy if accuracy is None else check_accuracy_of_a(accuracy)
        if forces is not _NO_FORCES:
            forces = applied_forces(forces)
        if self.core and method == "kkt" and not forces and not check:
            if self._user:  # as in `solve`
                self.check_alone()
            by_core = self.core.derivatives(q, v, tau, accuracy)
            if by_core:
                return by_core
        methods = _derivative_methods()
        if not isinstance(method, str) or method not in methods:
            raise unknown_name("method", str(method), methods)
        if self.core and self.engine == "core":
            self.core.check(forces, method)
        if not check:
            return self._differentiated((q, v, tau), forces, method, accuracy)
        found = self.derivatives(q, v, tau, forces=forces, method=method, accuracy=accuracy)
        self._compare_with_differences((q, v, tau), found)
        return found

    @single_threaded
    @one_blas_thread
    def _differentiated(
        self, given: Given, forces: Sequence[AppliedForce], method: str, accuracy: float
    ) -> Derivatives:
        """Return `derivatives` without the core."""
        state = self._arguments.accept(*given)
        equations, linearisation = self.equations, self.linearisation
        if method == "kkt" and linearisation.uses_given_model:
            equations.recursion = linearisation  # once for the proof and for the derivatives
        try:
            solution = self._answered(state, forces, accuracy, False)
        finally:
            equations.recursion = None
        if solution.status is not _OK:
            # far from closed loops a may belong to no state, but its derivatives belong to it
            off = max(solution.residuals.violation, solution.residuals.velocity) > tolerances.OPEN
            in_doubt = off and solution.error_bound <= accuracy
            if not np.isfinite(solution.a).all() or (self.solver.exact and not in_doubt):
                raise failure(self, solution)
        # much is formed when it is asked for first, and the caller may have gone on in these arrays
        method_of = _derivative_methods()[method]
        return method_of(self, solution, state[1].copy(), state[2].copy())

    @single_threaded
    @one_blas_thread
    def _compare_with_differences(self, given: Given, found: Derivatives) -> None:
        from condyn_pin.dynamics.derivatives import others  # few are checked

        _, v, tau = self._arguments.accept(*given)
        differences = others.DifferenceDerivatives(self, found.solution, v, tau)
        others.check_derivatives(found, differences)

    @single_threaded
    def terms(self, q: ArrayLike, v: ArrayLike) -> Terms:
        """Return M, h, J, gamma and a_ref at a state."""
        self.check_unedited()
        q_, v_, _ = self._arguments.check(q, v, np.zeros(self.model.nv))
        return finite_terms(self.equations, q_, v_)

    @single_threaded
    def jacobian(self, q: ArrayLike) -> Array:
        """Return the constraint Jacobian J (m, nv)."""
        return self.equations.jacobian(self._configuration(q))

    @single_threaded
    def violation(self, q: ArrayLike) -> Array:
        """Return c(q) (m,) [m, rad]."""
        return self.equations.violation(self._configuration(q))

    def _configuration(self, q: ArrayLike) -> Array:
        self.check_unedited()
        still = np.zeros(self.model.nv)
        return self._arguments.check(q, still, still)[0]

    # Pinocchio's memory, and what the scene makes on demand: dense methods do without the memory
    # of the constraints, and in long chains it takes all the memory there is.

    @property
    def data(self) -> Any:
        """Pinocchio's memory, sized for the constraints of the scene."""
        return self._raw[0]

    @property
    def constraint_models(self) -> ConstraintModels:
        """The constraints as Pinocchio takes them."""
        return self._raw[1]

    @property
    def constraint_datas(self) -> ConstraintDatas:
        """Pinocchio's memory of each constraint."""
        return self._raw[2]

    @property
    def _raw(self) -> tuple[Any, ConstraintModels, ConstraintDatas]:
        self.check_alone()
        return self._made

    @cached_property
    def _made(self) -> tuple[Any, ConstraintModels, ConstraintDatas]:
        models, datas = raw_constraints(
            self.model, self.pinocchio_constraints.constraints, self.drift
        )
        _pin.init_constraint_dynamics(self.model, self._data, models, datas)
        return self._data, models, datas

    @cached_property
    def _data(self) -> Any:
        return whole_data(self.model)

    def scene_forces(self, lam: Array) -> Array:
        """Return the scene's forces from those of Pinocchio's constraints."""
        to_scene = self.pinocchio_constraints.to_scene
        return lam if to_scene is None else to_scene.dot(lam)

    def pinocchio_velocity(self, s: Array) -> Array:
        """Return the velocities of Pinocchio's constraints for those of the scene's, s (m,)."""
        to_scene = self.pinocchio_constraints.to_scene  # lam goes the other way
        return s if to_scene is None else to_scene.T.dot(s)

    @cached_property
    def equations(self) -> Equations:
        """The equations of the scene, in memory of their own that no solver writes to."""
        return self._with_redundancy(Equations(self.model, self.bounds, self.drift))

    def _with_redundancy(self, equations: Equations) -> Equations:
        """Equations that know the redundancy of the scene's rows, if any look independent."""
        nominal = self.scene.nominal
        equations.redundancy = (lambda: nominal.redundancy) if nominal.looks_independent else None
        equations.digits = (lambda: nominal.rounded_file) if nominal.rounded_file else None
        return equations

    @cached_property
    def linearisation(self) -> Linearisation:
        """The linearised equations, in memory of their own but for the constraint forces."""
        # imported here: a solve needs none of it
        from condyn_pin.dynamics.derivatives.kkt import Linearisation

        return Linearisation(self.model, self.bounds, self.drift, self.equations)

    @cached_property
    def linearised_gaps(self) -> Linearisation:
        """J a + gamma + c, linearised: at rest, with a = 0, how the gaps change."""
        from condyn_pin.dynamics.derivatives.kkt import Linearisation

        plain = [replace(b, drift=None) for b in self.bounds]  # type: ignore[type-var]
        return Linearisation(self.model, plain, Baumgarte(0.0, 1.0))

    @cached_property
    def loads(self) -> Loads:
        """Forces on frames, evaluated in the memory of the equations."""
        return Loads(self.scene.robot, self.model, self.equations.data)

    def __reduce__(self) -> tuple[Any, ...]:
        # a copy has memory of its own: Pinocchio 4 crashes on a copied Data
        made = partial(Workspace, drift=self._drift, engine=self.engine)
        return made, (self.scene, self.solver)


@cache
def _derivative_methods() -> dict[str, Callable[..., Derivatives]]:
    """Methods of derivatives by name, imported on first use: a solve needs none of them."""
    from condyn_pin.dynamics.derivatives import METHODS

    return METHODS


# A loop over `solve` with one scene, or with some in turn, builds a workspace for each.
_workspaces = ThreadCache[Workspace]()


def solve(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    forces: Sequence[AppliedForce] = (),
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    accuracy: float | None = None,
    throw: bool = True,
) -> Solution:
    """Return accelerations and constraint forces at one state, with their errors.

    M(q) a + h(q, v) = tau + J(q)^T lam + sum J_f(q)^T f,    J a + gamma = a_ref

    Parameters
    ----------
    scene : Scene
    q : (nq,) array_like
        Configuration [rad, m]; quaternions x y z w, normalised.
    v : (nv,) array_like
        Velocity [rad/s, m/s]; the free-flyer's in its body frame, linear first.
    tau : 0 or (nv,) array_like
        Joint torques [N, N m]; zero in the rows of a free-flyer.
    forces : sequence of AppliedForce, optional
        Forces from outside, at frames of the robot; none by default.
    solver : Solver, optional
        `Proximal()` by default; for kinds of constraints that it cannot take, `DenseKKT()`, and
        `NullSpace()` if there are redundant rows besides.
    drift : Baumgarte, optional
        Baumgarte stabilisation: it gives a_ref, which is zero by default.
    accuracy : float, optional
        Error of a that is good enough, relative to the larger of |a|_inf and gravity: what the
        status is judged by. That of the solver by default: 1e-8, or what `tune` was asked for. It
        changes no number of the answer.
    throw : bool
        Raise if the status is not ok. With False the same Solution comes back, whatever its
        status.

    Returns
    -------
    Solution

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size, is not finite, or has an unnormalised quaternion.
    SolveFailed
        If the status is not ok; its `solution` has everything that was computed.
    StaleModel
        If the robot's model was edited since it was loaded.
    UnknownName
        If a force is on a frame that does not exist.
    UnsupportedConstraint
        If the solver cannot take a kind of constraint of the scene.

    Notes
    -----
    The first call with a scene builds a `Workspace`, which takes as long as dozens of solves; calls
    after it with the same scene and solver, in the same thread, use it again. Cost: that of the
    solver, which `condyn solvers` lists, and that of the three errors: together two to three times
    that of `Workspace.acceleration`, which is for hot loops and computes no errors.

    References
    ----------
    Carpentier, Budhiraja, Mansard. Proximal and sparse resolution of constrained dynamic equations.
    RSS, 2021; each solver names its own.
    """
    workspace = workspace_for(scene, solver, drift)
    return workspace.solve(q, v, tau, forces=forces, accuracy=accuracy, throw=throw)


def derivatives(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    forces: Sequence[AppliedForce] = (),
    solver: Solver | None = None,
    drift: Baumgarte | None = None,
    method: str = "kkt",
    check: bool = False,
    accuracy: float | None = None,
) -> Derivatives:
    """Return the derivatives of accelerations and constraint forces by state and torques.

    M da - J^T dlam = dtau - r_q dq - r_v dv,    J da = -s_q dq - s_v dv

    Parameters
    ----------
    scene : Scene
    q, v, tau : (nq,), (nv,), (nv,) array_like
        Configuration, velocity [rad/s, m/s] and joint torques [N m, N] or 0, as in `solve`.
    forces : sequence of AppliedForce, optional
        As in `solve`. Their components are constant; r_q has the change of J_f^T f with q.
    solver : Solver, optional
        As in `solve`, for the answer that is differentiated. With `Soft` the derivatives are those
        of its own equations, whatever its status.
    drift : Baumgarte, optional
        As in `solve`.
    method : {"kkt", "pinocchio", "differences"}
        ``kkt`` is exact for every kind of constraint, on the constraints and off them, and gives
        the derivative of the smallest lam where rows are redundant. ``pinocchio`` is Pinocchio's
        own, repaired, for `Proximal` and constraints of 3 and 6 rows; it refuses states off the
        constraints where rows are redundant. ``differences`` is slow, and where rows are redundant
        and loops closed its columns by q are those along the constraints: zero across.
    check : bool
        Compare with central differences, and raise if they disagree.
    accuracy : float, optional
        As in `solve`.

    Returns
    -------
    Derivatives
        `da_dq`, `da_dv`, `da_dtau`, `dlam_dq`, `dlam_dv`, `dlam_dtau`, with tangent columns, formed
        when they are asked for; `jvp` and `vjp` do without them.

    Raises
    ------
    DerivativesDisagree
        If `check` finds an entry that differs by more than 1e-6 of the largest of its matrix.
    SolveFailed, InvalidArgument
        As in `solve`.
    UnsupportedConstraint
        If ``pinocchio`` cannot be right for a constraint or a joint.

    Notes
    -----
    Cost O(n^3 + m^2 n) after a solve; `benchmarks/timings.py derivatives` measures it.

    Off the constraints they are those of the answer that `solve` gives, at its rank: of rows that
    are left out as redundant, N, what turns with them has its part,

        P J da = -P (s_q dq + s_v dv + dP s),    N^T dlam = N^T dP lam,    P = 1 - N N^T,

    with s = J a + gamma - a_ref, what no acceleration satisfies. On closed loops with J v = 0 that
    is 0, and along redundant rows dlam_dq holds for motions that keep the loops closed.

    References
    ----------
    Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
    """
    workspace = workspace_for(scene, solver, drift)
    return workspace.derivatives(
        q, v, tau, forces=forces, method=method, check=check, accuracy=accuracy
    )


def workspace_for(scene: Scene, solver: Solver | None, drift: Baumgarte | None) -> Workspace:
    """Return this thread's workspace for a scene: one of the last ones, or a new one."""
    workspace = _workspaces.of(  # a new one checks the scene
        scene, (solver, drift), lambda: Workspace(scene, solver, drift=drift, engine="auto")
    )
    workspace.check_unedited()
    return workspace
