"""The verb trajectory_derivatives: derivatives of the end of a motion with contacts.

    x_i+1 = step(x_i, tau + u_i, p),    dx_i+1 = A_i dx_i + B_i du_i + P_i dp

Forward, columns go along with the steps; backward, a gradient goes against them (`StepChain`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array, finite, read_only
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.forces import AppliedForce, applied_forces
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.active_set import ActiveSet
from condyn_pin.gradients.routes.linear_steps import LinearizedStep
from condyn_pin.gradients.routes.route import Route, StepChain, check_parameters
from condyn_pin.gradients.routes.step_derivatives import PARAMETERS, StepDerivatives
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.motion_status import RunStatus
from condyn_pin.simulation.records import Note, Remarks
from condyn_pin.simulation.system import System
from condyn_pin.simulation.torques import AppliedTorques, Torque, TorqueJacobian
from condyn_pin.simulation.trajectory import Trajectory


class Gradient(NamedTuple):
    """The gradient of a function of the end of a motion."""

    q: Array  # (nv,), by the start; tangent
    v: Array  # (nv,), by the start
    tau: Array  # (steps, nv), by the torques of each step
    friction: Array  # (k,), by the coefficient of each contact; zeros where a route has none
    restitution: Array  # (k,)
    solref: Array  # (2,)
    inertias: Array  # (10 a joint,); none if `wrt` has not named them


class TrajectoryDerivatives:
    """The derivatives of the end of a motion; columns and rows of q are tangent.

    Attributes
    ----------
    q, v : (nq,), (nv,) array
        The end: that of the route's own steps.
    route : Route
    steps : int
        How many there are.
    one_sided : tuple of int
        The steps in which a contact is so near to another mode that derivatives hold on one side,
        or moves by a rule where Coulomb's law leaves its velocity open. Costs a sweep if none
        was made.
    """

    def __init__(
        self, route: Route, steps: LinearizedStep, count: int, start: tuple[Array, Array],
        wrt: tuple[str, ...],
    ) -> None:  # fmt: skip
        self.route, self.steps, self._wrt = route, count, wrt
        self._chain, self._columns = StepChain(route, steps, count), steps.columns
        self._kept = self._chain.kept(start)
        self.q, self.v = read_only(self._kept[-1])
        self._one_sided, self._notes, self._swept = set[int](), dict[int, list[Note]](), False

    @property
    def one_sided(self) -> tuple[int, ...]:
        """Steps, as in the list of attributes."""
        self._sweep()
        return tuple(sorted(self._one_sided))

    @property
    def notices(self) -> tuple[str, ...]:
        """Warnings about the derivatives, one sentence each."""
        self._sweep()
        remarks = Remarks()
        for i in sorted(self._notes):
            remarks.count((i * self._chain.steps.dt, note) for note in self._notes[i])
        return tuple(str(remark) for remark in remarks.all)

    def _sweep(self) -> None:
        """Make a sweep, if none was made."""
        if not self._swept:
            assert self._matrices

    @property
    def dx_dx(self) -> Array:
        """(q+, v+) by (q, v) of the start (2 nv, 2 nv)."""
        return self._matrices["state"]

    def by(self, parameter: str) -> Array:
        """Return (q+, v+) by a parameter: tau held over the motion (2 nv, nv), friction and so on.

        It has to be named in `wrt`.
        """
        if parameter not in self._wrt:
            raise InvalidArgument(
                f"parameter = {parameter!r}: wrt has {', '.join(self._wrt) or 'none'}; "
                "trajectory_derivatives(motion, wrt=[...]) names it"
            )
        return self._matrices[parameter]

    @one_blas_thread
    def jvp(
        self, dq: ArrayLike, dv: ArrayLike, dtau: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Return (dq+, dv+) along dq and dv of the start, and dtau (nv,) or (steps, nv)."""
        n = len(self.v)
        x = np.concatenate((finite("dq", dq, n), finite("dv", dv, n)))
        u = np.zeros((self.steps, n))
        if dtau is not None:
            given = np.asarray(dtau, dtype=np.float64)
            u += finite("dtau", given, (self.steps, n) if given.ndim > 1 else (n,))
        for i, of in enumerate(self._forward()):
            x = of.matrix[:, : 3 * n] @ np.concatenate((x, u[i]))
        return x[:n], x[n:]

    @one_blas_thread
    def vjp(self, dq1: ArrayLike, dv1: ArrayLike) -> Gradient:
        """Return the gradient of dq1 . q+ + dv1 . v+, for dq1 and dv1 (nv,), in one sweep back."""
        n, columns = len(self.v), self._columns
        y = np.concatenate((finite("dq1", dq1, n), finite("dv1", dv1, n)))

        def asked(i: int, of: StepDerivatives) -> Array | None:
            self._note(i, of)
            return y if i == self.steps - 1 else None

        start, tau, by = self._chain.adjoint(self._kept, asked)
        start = start if self.steps else y
        return Gradient(start[:n], start[n:], tau, *(by[columns.of(name)] for name in PARAMETERS))

    @cached_property
    @one_blas_thread
    def _matrices(self) -> dict[str, Array]:
        n, columns = len(self.v), self._columns
        places = {name: columns.of(name) for name in self._wrt}
        found = {"state": np.eye(2 * n)}
        found |= {name: columns.empty(2 * n)[:, at] for name, at in places.items()}
        for of in self._forward():
            A = of.matrix
            found = {name: A[:, : 2 * n] @ block for name, block in found.items()}
            for name, at in places.items():
                found[name] += A[:, at]
        return found

    def _forward(self) -> Iterator[StepDerivatives]:
        for i, of in enumerate(self._chain.forward(self._kept[0])):
            self._note(i, of)
            yield of

    def _note(self, i: int, of: StepDerivatives) -> None:
        self._swept |= i == self.steps - 1
        if of.one_sided:
            self._one_sided.add(i)
        if of.notes:
            self._notes[i] = list(of.notes)

    def __repr__(self) -> str:
        return f"TrajectoryDerivatives({self.route!r}: {self.steps} steps)"


@one_blas_thread
def trajectory_derivatives(
    motion: Trajectory,
    tau: float | ArrayLike | Torque = 0.0,
    *,
    wrt: Sequence[str] = (),
    route: Route | None = None,
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None,
) -> TrajectoryDerivatives:
    """Return the derivatives of the end of a motion with contacts by its start and parameters.

    x_i+1 = step(x_i, tau + u_i, p),    dx_i+1 = A_i dx_i + B_i du_i + P_i dp

    Parameters
    ----------
    motion : Trajectory
        By a scheme with contacts, and without events.
    tau : 0, (nv,) array_like or callable, optional
        Applied torques, as given to `simulate` [N, N m].
    wrt : sequence of {"tau", "friction", "restitution", "solref", "inertias"}
        Parameters of the matrices, beside the start; the gradient of `vjp` has all of them, but
        inertias, ten columns a joint, only if they are named, as all of `Randomised`.
    route : Route, optional
        `ActiveSet()` by default.
    forces, jacobian : optional
        As given to `simulate`. Without a jacobian, differences are taken of a function tau.

    Returns
    -------
    TrajectoryDerivatives

    Raises
    ------
    InvalidArgument
        If the motion is of another kind, was given other torques or forces, or its steps have no
        derivatives by a parameter.

    Notes
    -----
    The motion is computed again, by the steps of the route. Cost: `Route.cost` per step in each
    sweep, and twice the steps for a backward sweep. Memory: about sqrt(steps) states.

    References
    ----------
    Griewank, Walther. Evaluating Derivatives. SIAM, 2008, chapter 12: checkpoints.
    """
    chosen = ActiveSet() if route is None else route
    check_type("route", chosen, Route, "a Route is needed, such as ActiveSet()")
    scheme, run = _scheme_of(motion), motion.run
    names = check_parameters(chosen, scheme, wrt, ("tau",))
    effects = run.effects
    scene = effects.applied_to(motion.scene).at(0.0)
    applied = AppliedTorques(scene.robot, tau, jacobian, applied_forces(forces, functions=True))
    _check_applied(motion, applied)
    system = System(
        Workspace(scene.bilateral), applied, springs=effects.springs, damping=effects.damping,
        contacts=scene.contact_bounds,
    )  # fmt: skip
    steps = LinearizedStep(scene, chosen.scheme(scheme), run.dt, system, wrt=names)
    count = round(float(motion.t[-1] - motion.t[0]) / run.dt)
    with np.errstate(all="ignore"):
        start = np.array(motion.q[0]), np.array(motion.v[0])
        return TrajectoryDerivatives(chosen, steps, count, start, names)


def _scheme_of(motion: Trajectory) -> ContactScheme:
    """Return the scheme of a motion; refuse one that is not by its steps alone."""
    if not isinstance(motion, Trajectory):
        raise InvalidArgument(
            f"motion = {type(motion).__name__}: a Trajectory is needed; of a batch, one: batch[i]"
        )
    run = motion.run
    if not isinstance(run.integrator, ContactScheme):
        raise InvalidArgument(
            f"motion: it is by {run.integrator!r}; one by a scheme with contacts is needed, such "
            "as StewartTrinkle()"
        )
    if len(motion.phases) > 1 or run.happened or run.status is not RunStatus.FINISHED:
        raise InvalidArgument("motion: one that went to its end without events is needed")
    if run.drift.corrects and motion.scene.rows:
        raise InvalidArgument(
            f"motion: drift = {run.drift!r} moved it behind each step; leave drift out, for "
            f"{run.integrator.title} closes loops itself"
        )
    return run.integrator


def _check_applied(motion: Trajectory, applied: AppliedTorques) -> None:
    """Refuse torques and forces that are not those of the motion: it would be another one."""
    for k in (0, len(motion.t) // 2, -1):
        t, its = float(motion.t[k]), motion.tau[k]
        given = applied.at_sample(t, motion.q[k], motion.v[k])
        size = max(float(np.abs(each).max(initial=0.0)) for each in (its, given))
        i = int(np.abs(given - its).argmax())
        if abs(given[i] - its[i]) > tolerances.SAME_TORQUES * size:
            raise InvalidArgument(
                f"tau, forces: they give {given[i]:.6g} in entry {i} at t = {t:g} s, where the "
                f"motion had {its[i]:.6g}; pass what simulate was given"
            )
    applied.forget()
