"""System: what an integrator sees of a scene.

    q' = v,    M(q) v' + h(q, v) = tau(t, q, v) + J(q)^T lam,    J v' + gamma = a_ref

on the manifold of configurations.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from math import isclose
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.terms import Terms
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.slopes import Slopes
from condyn_pin.simulation.torques import Applied, Passive, Torque

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene

# The last answer where there is none: t, q, v and a.
_NOTHING: Final[tuple[float, Array | None, Array | None, Array]] = (0.0, None, None, np.zeros(0))


class System:
    """A scene with the torques that act on it.

    Arguments are not checked, and arrays that are returned are owned by the caller, unless it says
    otherwise.

    Parameters
    ----------
    workspace : Workspace
        Scene, solver, and what is asked of the rows. The system uses its memory.
    tau : float, (nv,) array_like or callable
        The torques applied [N, N m]: 0, constant, or tau(t, q, v), which may not write to q and v.
    springs, damping : bool
        Whether those of the robot act.

    Attributes
    ----------
    workspace : Workspace
    model : pin.Model
        The workspace's own.
    manifold : Manifold
    passive : Passive
        Springs and damping, those that are on.
    applied, torque : callable
        (t, q, v) -> (nv,) [N, N m]: what is applied, and that with springs and damping. Not to be
        written to.
    slopes : Slopes
        How the torques applied change with the state.
    integrate, difference : callable
        (q, dv) -> q moved along dv; (q0, q1) -> the dv from one to the other.
    """

    def __init__(
        self,
        workspace: Workspace,
        tau: float | ArrayLike | Torque | Applied = 0.0,
        *,
        springs: bool = True,
        damping: bool = True,
    ) -> None:
        self.workspace = workspace
        self.model = workspace.model
        self.manifold = Manifold(self.model)
        self.applied = tau if isinstance(tau, Applied) else Applied(self.model.nv, tau)
        self.passive = Passive.of(self.scene.robot, springs=springs, damping=damping)
        self.torque = self.passive.with_torques(self.applied)
        # bound once: these are called in every step
        self.integrate: Callable[[Array, Array], Array] = partial(pin.integrate, self.model)
        self.difference: Callable[[Array, Array], Array] = partial(pin.difference, self.model)
        self.slopes = Slopes(self.applied, self.integrate)
        self.lam: Callable[[], Array] = workspace.lam
        self._solve = workspace.next_acceleration
        self._last = _NOTHING
        # the last one, and its dt: motion after motion has the same
        self._implicit: tuple[System, float] = (self, 0.0)

    def use(self, scene: Scene) -> None:
        """Switch to another scene of the same robot; steppers have to be started again."""
        self.workspace.use(scene)
        self._last = _NOTHING
        if "spare" in vars(self):
            self.spare.model.armature[:] = self.model.armature  # another model would be refused
            self.spare.use(scene)
            self._implicit[0]._last = _NOTHING

    @property
    def scene(self) -> Scene:
        """The scene of the workspace."""
        return self.workspace.scene

    @property
    def m(self) -> int:
        """Number of rows."""
        return self.scene.rows

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,) by the solver; `lam()` then returns its constraint forces (m,).

        The last answer is kept: asked again at the same time for the very same arrays, it is
        returned. A correction at the end of a step and the next step share one solve.

        Raises
        ------
        InvalidArgument, SolveFailed
            If something is not finite, or the method's matrix is singular.
        """
        last = self._last
        # k dt and (k - 1) dt + dt are one time
        if q is last[1] and v is last[2] and isclose(t, last[0], rel_tol=1e-14):
            return last[3]
        self._last = _NOTHING  # a solve that fails leaves no answer behind, nor lam of the last one
        a = self._solve(q, v, self.torque(t, q, v))
        self._last = t, q, v, a
        return a

    def carry_over(self, q: Array, v: Array) -> None:
        """Take the last answer as that of (q, v), a state so near that nothing would change."""
        t, _, _, a = self._last
        self._last = t, q, v, a

    def implicit(self, dt: float) -> System:
        """Return the system whose springs and damping act at the end of a step of size dt.

        With v1 = v + dt a and q1 = q + dt v1 in the torques -D v1 - K (q1 - q0),

            (M + dt D + dt^2 K) a + h = tau - (D + dt K) v - K (q - q0) + J^T lam,

        which is stable however large D and K are. All of them share the memory of `spare`. Torques
        of a function that comes with its derivatives act there too.
        """
        from condyn_pin.simulation.implicit import AtTheEnd  # it is a system itself

        stiff = self.applied.jacobian is not None
        if self.passive.is_nothing and not stiff:
            return self
        system, its_dt = self._implicit
        if its_dt != dt:
            system = self
            if not self.passive.is_nothing:
                system = _Heavier(self, dt, self.passive.with_torques(self.applied, dt))
            if stiff:
                system = AtTheEnd(system, self.slopes, dt)
            self._implicit = system, dt
        return system

    def iterated(self, dt: float, last: Callable[[], Array]) -> System:
        """Return the system of an iteration on a, where v changes with dt a and q with dt^2 a.

        Its solution is that of the system where a is the `last` one,

            (M + dt D + dt^2 K) a + h = tau - D v - K (q - q0) + (dt D + dt^2 K) last + J^T lam,

        and however large D and K are, they do not keep the iteration from it; nor do those of the
        torques of a function, once their slopes are known.
        """
        from condyn_pin.simulation.implicit import Iterated  # it is a system itself

        system = self
        if not self.passive.is_nothing:
            inertia, between = self.passive.inertia(dt), self.passive.between

            def torque(t: float, q: Array, v: Array) -> Array:
                tau = self.torque(t, q, v) + inertia * last()
                if between:
                    rows, weights = between.inertia_rows(q, dt)
                    tau += rows.T @ (weights * (rows @ last()))
                return tau

            system = _Heavier(self, dt, torque)
        if self.applied.constant is not None:
            return system
        return Iterated(system, self.slopes, dt, last)

    def difference_if_stiff(self, t: float, q: Array, v: Array) -> None:
        """Begin to difference the torques of a function, if that is what this system is for."""

    def size(self, q: Array) -> float:
        """Return how large the numbers are that c(q) is a difference of [m, rad], at least 1."""
        return max(1.0, self._reach, float(np.abs(q).max(initial=0.0)))

    @cached_property
    def _reach(self) -> float:
        """How far joints may be from the world's origin, all shifts at zero [m], at most."""
        return sum(float(np.abs(p.translation).max()) for p in self.model.jointPlacements)

    @cached_property
    def spare(self) -> Workspace:
        """Another workspace of the same scene, whose model may be changed."""
        workspace = self.workspace
        return Workspace(self.scene, workspace.solver, drift=workspace.drift)

    def rate(self, theta: Array, v: Array) -> Array:
        """Return theta' (nv,) of q = integrate(q0, theta) at velocity v; see `Manifold`."""
        return self.manifold.rate(theta, v)

    @property
    def equations(self) -> Equations:
        """The equations of the scene, with memory of their own."""
        return self.workspace.equations

    def terms(self, q: Array, v: Array) -> Terms:
        """Return M, h, J, gamma and a_ref."""
        return self.equations.terms(q, v)

    def mass(self, q: Array) -> Array:
        """Return M (nv, nv), both triangles, armature included."""
        return np.array(pin.crba(self.model, self._data, q))

    def bias(self, q: Array, v: Array) -> Array:
        """Return h (nv,): Coriolis, centrifugal and gravity torque."""
        return np.array(pin.nonLinearEffects(self.model, self._data, q, v))

    def jacobian(self, q: Array) -> Array:
        """Return J (m, nv)."""
        return self.equations.jacobian(q)

    def violation(self, q: Array) -> Array:
        """Return c(q) (m,) [m, rad]."""
        return self.equations.violation(q)

    @property
    def _data(self) -> Any:
        return self.equations.data


class _Heavier(System):
    """A system with more inertia, dt D + dt^2 K, and another torque."""

    def __init__(self, system: System, dt: float, torque: Torque) -> None:
        super().__init__(system.spare, system.applied)
        self.torque = torque
        armature = self.model.armature  # a view: Pinocchio reads it in every call
        heavier = np.array(system.model.armature) + system.passive.inertia(dt)
        solve, between = self._solve, system.passive.between

        def solve_heavier(q: Array, v: Array, tau: Array) -> Array:
            armature[:] = heavier  # the workspace is that of others, too
            if between is None:
                return solve(q, v, tau)
            return with_rows(lambda tau: solve(q, v, tau), tau, *between.inertia_rows(q, dt))

        self._solve, self._rows = solve_heavier, between and partial(between.inertia_rows, dt=dt)

    def mass(self, q: Array) -> Array:
        """Return M (nv, nv) with all that is added to it."""
        M = super().mass(q)
        if self._rows:
            rows, weights = self._rows(q)
            M += rows.T @ (weights[:, None] * rows)
        return M


def with_rows(solve: Callable[[Array], Array], tau: Array, rows: Array, weights: Array) -> Array:
    """Return the a of (M + U^T w U) a + h = tau + J^T lam, by solves of M a + h = tau + J^T lam.

    What the rows U (r, nv) take is U^T f with f = w U a, and a falls with f as the solves say:

        U a = U a0 - G f,    G = U P U^T,    (1 / w + G) f = U a0,

    with a0 that of f = 0, and P the inverse inertia that the constraints leave. A solve a row finds
    G; the last one is that of the answer, and leaves its lam behind.

    Parameters
    ----------
    solve : callable
        Returns a (nv,) of tau (nv,).
    tau : (nv,) array
    rows : (r, nv) array
        U.
    weights : (r,) array
        w, positive [kg, kg m^2].
    """
    a0 = solve(tau)
    free = rows @ a0
    scale = weights * np.abs(free).max(initial=0.0)  # forces as they come: G is known as well as a0
    pushed = [(solve(tau + f * row) - a0) / f for f, row in zip(scale, rows, strict=True) if f]
    if not pushed:
        return a0
    G = rows @ np.array(pushed).T
    force = np.linalg.solve(np.diag(1 / weights) + G, free)
    return solve(tau - rows.T @ force)
