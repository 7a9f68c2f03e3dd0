"""Controller: whole-body control by one quadratic program a tick, or one for each level."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from math import floor, isfinite
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import Arguments, check_called, check_type, checked_names
from condyn_pin._core.arrays import Array, check_overflow, finite
from condyn_pin._core.compiled import Engine, is_compiled
from condyn_pin._core.threads import OneThread, one_blas_thread, single_threaded
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.drift import Baumgarte, stabilisation
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation, motors_of
from condyn_pin.control.answer import ControlAnswer, verdict
from condyn_pin.control.cones import ContactCones
from condyn_pin.control.hierarchy import Cascade, Hierarchy, Level, check_tasks, weighted
from condyn_pin.control.limits import ControllerSettings, ControlLimits
from condyn_pin.control.program import Program
from condyn_pin.control.qp.chain import ChainAnswer
from condyn_pin.control.qp.qp_solver import Constraints, PolishedAnswer, QPSolver, QuadraticProgram
from condyn_pin.control.qp.solvers import DAQP, ProxQP
from condyn_pin.control.second_order import SecondOrder
from condyn_pin.control.tasks.task import Task
from condyn_pin.dynamics.scene import Scene, check_at_all_times, check_bilateral, check_scene
from condyn_pin.errors import InvalidArgument, MissingExtra, SolveFailed, UnsupportedBackend

if TYPE_CHECKING:
    from condyn_pin.control.compiled import CompiledTick


_KEPT = 16  # programs of contacts and tasks that a controller switches between


class Controller(OneThread):
    """Joint torques that achieve tasks as well as motors and floor allow.

    min sum w |J a - b|^2  with  M a + h = B u + passive + J^T lam,  J a + gamma = a_ref

    Parameters
    ----------
    scene : Scene
        Contacts and loops. Contacts with a cone do not slip and do not pull; all other constraints
        are held, and eliminated. What is `Driven` accelerates as its path does at the t of each
        tick, whatever force that takes.
    tasks : sequence of Task, or Hierarchy
        What it is to do, by weight or strictly in order.
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    qp : QPSolver, optional
        ``ProxQP()`` by default, and ``DAQP()`` for a hierarchy.
    limits : ControlLimits
        Of motors, and of joints if it says how far to look ahead.
    actuation : Actuation, optional
        The motors; those of the robot by default.
    drift : Baumgarte, optional
        Baumgarte stabilisation of the constraints; none by default.
    regularisation : float
        Weight of the squares of all accelerations, and of all contact forces over the mass of the
        robot [1]: decides what the tasks leave open. Forces that it alone decides are rounded by
        1e-16 of the largest weight times its acceleration, over this: 1e-6 m/s^2 for 1e5.
    rigid : sequence of str
        Joints without a motor that are treated as rigid, such as stiff springs: they do not
        accelerate, whatever torque that takes, and their oscillation is removed from v, as if they
        were locked at that instant, which keeps the momentum. Tasks that tried to damp it would
        excite it.
    engine : {"auto", "core", "python"}
        Who does a tick, terms, program, answer and proof: the compiled core or Python. The answers
        are the same, those of the core in less time. "auto" has Python do tasks, constraints and
        limits that the core does not have, the levels of a `Hierarchy`, and everything where no
        core is installed; "core" refuses these. Python also does any tick whose rows contradict
        each other.

    Raises
    ------
    InvalidArgument
        If a cone does not fit its contact or a task the scene, or two tasks share a name.
    UnsupportedConstraint
        If contacts of the scene may open: `scene.closed()` has those that it is to count on.
    UnknownName
        If a name does not exist.
    UnsupportedBackend
        If the engine is "core", which has no rows for some tasks or constraints.
    MissingExtra
        If the package of the solver is not installed, or the core where the engine is "core".

    Notes
    -----
    A controller has memory and belongs to one thread at a time. Each call starts from the active
    set of the last one, which changes only the last digits of an answer. A tick costs 0.3 ms on
    Talos and 0.6 ms on Cassie, whose loops are eliminated; 0.06 ms more while joints in `rigid`
    swing; an infeasible one some tens of milliseconds.

    References
    ----------
    Wensing, Posa, Hu, Escande, Mansard, Del Prete. Optimization-based control for dynamic legged
    robots. IEEE Transactions on Robotics, 2024.
    """

    def __init__(
        self,
        scene: Scene,
        tasks: Sequence[Task] | Hierarchy,
        *,
        cones: Cones | None = None,
        qp: QPSolver | None = None,
        limits: ControlLimits | None = None,
        actuation: Actuation | None = None,
        drift: Baumgarte | None = None,
        regularisation: float = 1e-5,
        rigid: Sequence[str] = (),
        engine: Engine = "auto",
    ) -> None:
        check_scene(scene)
        if cones is None:
            raise InvalidArgument(
                "cones is missing: it has no default; FrictionCone(0.6) is usual for feet that are "
                "points, WrenchCone(0.6) for soles, a dict has one by contact, and {} none"
            )
        limits = ControlLimits() if limits is None else limits
        stiff = checked_names("rigid", rigid, scene.robot.joints, "joint")
        self._settings = ControllerSettings(
            cones=cones,
            qp=qp,
            limits=limits,
            actuation=actuation,
            drift=drift,
            regularisation=regularisation,
            rigid=stiff,
            engine=engine,
        )
        self._siblings: dict[tuple[Scene, object], Controller] = {}
        self._set_up(scene, tasks, cones)

    def _set_up(self, scene: Scene, tasks: Sequence[Task] | Hierarchy, cones: Cones) -> None:
        settings = self._settings
        check_bilateral(scene)
        check_at_all_times(scene, "a controller takes paths at the t of each tick")
        self.actuation = motors_of(scene, settings.actuation)
        self.scene = scene
        self.tasks = tasks if isinstance(tasks, Hierarchy) else check_tasks(tasks)
        levels = self.tasks.levels if isinstance(self.tasks, Hierarchy) else (self.tasks,)
        names = [task.name for level in levels for task in level]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InvalidArgument(f"tasks: two are named {twice[0]!r}; give one of them a name=")
        default = DAQP() if isinstance(tasks, Hierarchy) else ProxQP()
        drift = stabilisation(scene.bounds, settings.drift)
        equations = Equations(scene.robot.unedited, scene.bounds, drift)
        self._arguments = Arguments(equations.model)
        self._still = np.zeros(scene.robot.nv)
        home = lru_cache(maxsize=1)(lambda: scene.state()[0])
        bound = ContactCones(scene, cones)
        self._program = Program(
            scene=scene, levels=levels, cones=bound, limits=settings.limits,
            actuation=self.actuation, equations=equations, home=home, rigid=settings.rigid,
            regularisation=settings.regularisation,
        )  # fmt: skip
        cascade: Cascade | SecondOrder
        if bound.rounds:
            if len(levels) > 1:
                raise InvalidArgument(
                    "cones: the levels of a Hierarchy are quadratic programs, without round cones; "
                    "weigh the tasks, or take FrictionCone(mu, sides=16)"
                )
            cascade = SecondOrder(settings.qp or default, bound)
        else:
            cascade = Cascade(settings.qp or default, len(levels), settings.regularisation)
        self._python = PythonTick(
            self._program, scene, cones, self.actuation, cascade, self._arguments
        )
        self._tick = self._compiled(cones) if is_compiled(settings.engine) else None

    def _compiled(self, cones: Cones) -> CompiledTick | None:
        """Return the tick in compiled code, or None where Python does it in its place."""
        # imported here: most do without
        from condyn_pin.control.compiled import CompiledTick

        try:
            return CompiledTick(
                self._program, self.scene, cones, self.actuation, self._settings.regularisation
            )
        except (UnsupportedBackend, MissingExtra):
            if self._settings.engine == "core":
                raise
            return None

    def use(self, scene: Scene, tasks: Sequence[Task] | Hierarchy | None = None) -> Controller:
        """Return the controller for other contacts or other tasks, otherwise unchanged.

        Controllers that were used before are cached with their last active set, so switching back
        costs nothing.

        Parameters
        ----------
        scene : Scene
            Of the same robot, such as ``mechanism.without(scene, ["foot"])``. Cones by name are
            taken of the contacts that it has.
        tasks : sequence of Task, or Hierarchy, optional
            The same by default.

        Raises
        ------
        InvalidArgument
            If the scene is of another robot, or as for a new `Controller`.
        """
        check_scene(scene)
        if scene.robot is not self.scene.robot and scene.robot.model != self.scene.robot.model:
            raise InvalidArgument(
                f"scene: {scene.robot.name} is another robot; make a Controller for it"
            )
        wanted = self.tasks if tasks is None else tasks
        wanted = wanted if isinstance(wanted, Hierarchy) else check_tasks(wanted)
        self._siblings.setdefault((self.scene, self.tasks), self)
        key = (scene, wanted)
        if key not in self._siblings:
            other = object.__new__(Controller)
            other._settings, other._siblings = self._settings, self._siblings
            cones = self._settings.cones
            if isinstance(cones, Mapping):
                cones = {name: cone for name, cone in cones.items() if name in scene.names}
            other._set_up(scene, wanted, cones)
            if len(self._siblings) >= _KEPT:
                del self._siblings[next(iter(self._siblings))]
            self._siblings[key] = other
        return self._siblings[key]

    @single_threaded
    def solve(
        self, q: ArrayLike, v: ArrayLike, t: float = 0.0, *, passive: ArrayLike | None = None
    ) -> ControlAnswer:
        """Return the torques of one control tick.

        Parameters
        ----------
        q, v : (nq,), (nv,) array_like
            Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear
            first.
        t : float
            Time, for references and paths that are functions of it [s].
        passive : (nv,) array_like, optional
            Torques that act anyway [N m, N], such as ``robot.passive_torque(q, v)``.

        Returns
        -------
        ControlAnswer
            With `tau`, `a`, `lam` and their proof; whatever its status, nothing is raised for it.

        Raises
        ------
        InvalidArgument
            If an argument has a wrong size or is not finite.
        StaleModel
            If the robot's model was edited in place.
        """
        arguments = self._accepted(q, v, t, passive)
        if not self._tick:
            return self._python.solve(*arguments)
        found = self._tick.solve(*arguments)
        if found is None:  # in doubt, or something is not finite, which Python names
            found = self._python.solve(*arguments)
            self._tick.begin_from(self._python.polished)
        return found

    @single_threaded
    @one_blas_thread
    def program(
        self, q: ArrayLike, v: ArrayLike, t: float = 0.0, *, passive: ArrayLike | None = None
    ) -> QuadraticProgram:
        """Return the quadratic program of a tick, for your own solver.

        Its unknowns are accelerations: those that loops leave, and contact forces over the mass of
        the robot. Of a hierarchy it is that of the first level alone.

        Parameters
        ----------
        q, v : (nq,), (nv,) array_like
            Configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame, linear
            first.
        t : float
            Time [s].
        passive : (nv,) array_like, optional
            As in `solve` [N m, N].

        Returns
        -------
        QuadraticProgram
            A copy: the next tick does not change it.

        Raises
        ------
        InvalidArgument
            If a cone is round, or an argument has a wrong size or is not finite.
        """
        if self._program.cones.rounds:
            raise InvalidArgument(
                "cones: with a RoundCone the program of a tick is one of second-order cones; that "
                "of a FrictionCone is quadratic"
            )
        given, levels = self._python.assembled(*self._accepted(q, v, t, passive))
        given = Constraints(*(each.copy() for each in given))  # the next tick overwrites them
        return weighted(given, levels[0])

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the inequalities of the program, in order."""
        return tuple(row.name for row in self._program.inequalities)

    def _accepted(
        self, q: ArrayLike, v: ArrayLike, t: float, passive: ArrayLike | None
    ) -> tuple[Array, Array, float, Array]:
        """Return the arguments of a tick: sizes are checked, and of numbers that of t."""
        self.scene.robot.check_unedited()
        still = self._still
        q_, v_, _ = self._arguments.accept(q, v, still)
        time = t if type(t) is float and isfinite(t) else float(finite("t", t, ()))
        return q_, v_, time, still if passive is None else finite("passive", passive, len(still))

    def __repr__(self) -> str:
        named = repr(self.tasks)
        if not isinstance(self.tasks, Hierarchy):
            named = f"[{', '.join(task.name for task in self.tasks)}]"
        held = ", ".join(self.scene.names) or "nothing"
        by = ", compiled core" if self._tick else ""
        return f"Controller({self.scene.robot.name} on {held}: {named}{by})"

    def __reduce__(self) -> tuple[Any, ...]:
        # a copy has memory of its own
        return partial(Controller, **vars(self._settings)), (self.scene, self.tasks)


# PythonTick: terms, program, answer and proof of a control tick, here in Python.
#
# `CompiledTick` does the same in the compiled core, and leaves to this what it is in doubt of.


class PythonTick:
    """The tick of one controller, with the active set of the last one."""

    def __init__(
        self, program: Program, scene: Scene, cones: Cones, actuation: Actuation,
        cascade: Cascade | SecondOrder, arguments: Arguments,
    ) -> None:  # fmt: skip
        self._program, self._scene = program, scene
        self._cones, self._actuation = cones, actuation
        self._cascade, self._arguments = cascade, arguments
        self._still = np.zeros(scene.robot.nv)
        # the last answer of each level with its active set, of those that were asked for
        self.polished: list[PolishedAnswer | None] = []

    @one_blas_thread
    def solve(self, q: Array, v: Array, t: float, passive: Array) -> ControlAnswer:
        """Return the answer of one tick."""
        given, levels = self.assembled(q, v, t, passive)
        start = perf_counter()
        x, answers = self._cascade.solve(given, levels, lambda: self._costs(given))
        asked: list[ChainAnswer] = answers
        said: tuple[str, ...] = ()
        gives = answers[-1].elastic if x is None else None
        if gives and (less := self._program.relaxed(given, gives)):
            given, said = less[0], (less[1],)
            x, answers = self._cascade.solve(given, levels, lambda: self._costs(given))
            asked = [*asked, *answers]
        elapsed = perf_counter() - start
        self.polished = [each.answer for each in answers]
        found = verdict(self._program, given, x, answers)
        return ControlAnswer(
            **found._replace(of_tick=said + found.of_tick)._asdict(),
            path=tuple(step for each in asked for step in each.path),
            iterations=sum(each.iterations for each in asked),
            solve_time=elapsed,
            actuation=self._actuation,
            cones=self._cones,
            scene=self._scene,
            q=q.copy(),
            t=t,
            v=self._program.motion.v.copy(),
        )

    def assembled(
        self, q: Array, v: Array, t: float, passive: Array
    ) -> tuple[Constraints, list[Level]]:
        """Return the constraints of a tick and its levels; what is not finite is refused."""
        with np.errstate(all="ignore"):  # what overflows is refused
            if not isfinite(q.dot(q) + v.dot(v)):  # not finite, or very large
                self._arguments.check(q, v, self._still)
            if not isfinite(passive.dot(passive)):
                check_overflow("passive", passive, passive**2)
            if len(self._program.rigid):
                v = self._program.locked_velocity(q, v)
            given, levels = self._program.assemble(q, v, t, passive)
            size = given.b.dot(given.b)
            for level in levels:
                size += level.rows.b.dot(level.rows.b)
            if not isfinite(size):
                check_overflow("v", v, given.b, *(level.rows.b for level in levels))
        return given, levels

    def _costs(self, given: Constraints) -> tuple[Array, Array]:
        """Return the costs of breaking each equation and each inequality."""
        equations = self._program.equation_rows(given)
        of_equations = np.array([row.cost for row in equations])
        return of_equations, np.array([row.cost for row in self._program.inequalities])


# at_rate: a controller in closed loop, as the torque function of a simulation.


_LONGEST: Final = 1.0  # [s]; no robot is controlled more slowly, and rates in Hz are larger

# Share of a period: times of steps are sums, and rounded.
_ROUNDING = 1e-6


def at_rate(
    controller: Controller, period: float, *, watch: Callable[[ControlAnswer], object] | None = None
) -> Callable[[float, Array, Array], Array]:
    """Return a torque function (t, q, v) that runs a controller once per period.

    tau(t) = tau_k,    t_k <= t < t_k + period,    t_k = k period

    ``simulate(floor, q, v, at_rate(controller, 1e-3), dt=5e-4, duration=2.0)`` closes the loop.

    Parameters
    ----------
    controller : Controller
        Of the robot that moves, on contacts that it takes for closed; the scene that moves may
        have others. It is told `Robot.passive_torque`, which a simulation adds as well.
    period : float
        From one tick to the next [s], preferably a whole number of steps.
    watch : callable, optional
        Called with every answer that is applied, such as ``answers.append``.

    Returns
    -------
    callable
        Raises SolveFailed, with the answer as its `solution`, in a tick without torques. Torques of
        an answer that is INACCURATE are applied.

    Raises
    ------
    InvalidArgument
        If there is no controller, or the period is not positive, or longer than a second.

    Notes
    -----
    Between two ticks a call costs a microsecond. A call at the instant of a tick with another
    state, from a trial step of an integrator or from another run, solves again.
    """
    check_type("controller", controller, Controller, "a Controller is needed")
    check_positive("time [s]", period=period)
    if period > _LONGEST:
        raise InvalidArgument(
            f"period = {period:g} s: torques would be held for so long; at a rate in Hz the period "
            "is 1 / rate"
        )
    if watch is not None:
        check_called("watch", watch, "answer")
    return _HeldAnswer(controller, float(period), watch)


class _HeldAnswer:
    """A controller, and the answer that is applied until its next tick."""

    def __init__(
        self,
        controller: Controller,
        period: float,
        watch: Callable[[ControlAnswer], object] | None,
    ) -> None:
        self._controller, self._period, self._watch = controller, period, watch
        self._tick, self._t = 0, np.inf
        self._state: tuple[Array, Array] = np.zeros(0), np.zeros(0)
        self._tau = np.zeros(0)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques of the tick (nv,) [N m, N]."""
        ticks = t / self._period
        if not isfinite(ticks):
            raise InvalidArgument(
                f"t = {t!r}: not a finite number of periods of {self._period:g} s"
            )
        tick = floor(ticks + _ROUNDING)
        if tick != self._tick or t < self._t or (t == self._t and self._is_elsewhere(q, v)):
            self._tau = self._answer(t, q, v)
            self._tick, self._t, self._state = tick, t, (q.copy(), v.copy())
        return self._tau

    def _answer(self, t: float, q: Array, v: Array) -> Array:
        passive = self._controller.scene.robot.passive_torque(q, v)
        answer = self._controller.solve(q, v, t, passive=passive)
        if not np.isfinite(answer.tau).all():
            named = "; ".join(str(answer.infeasible or answer.status).splitlines())
            raise SolveFailed(f"t = {t:g} s: the controller has no torques: {named}", answer)
        if self._watch is not None:
            self._watch(answer)
        return answer.tau

    def _is_elsewhere(self, q: Array, v: Array) -> bool:
        return not (np.array_equal(q, self._state[0]) and np.array_equal(v, self._state[1]))

    def __repr__(self) -> str:
        return f"at_rate({self._controller!r}, {self._period:g})"
