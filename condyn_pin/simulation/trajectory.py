"""Trajectory: a motion that was simulated, its summary, and its balance on the floor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import show, tolerances
from condyn_pin._core.arguments import check_type, count_text, renamed
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import algorithms, data_of
from condyn_pin._core.show import require_pandas
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import MODES
from condyn_pin.control.balancing import Balance, balanced
from condyn_pin.control.support import Pressure, SupportPolygon, floor_pressure, margin_within
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites, forces_in_axes
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.joints import by_joint
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.simulation.measures import (
    Energy,
    Kinematics,
    damping_rate,
    drive_power,
    gauge_of,
    integral_error,
    is_accurate,
    work,
)
from condyn_pin.simulation.motion_status import (
    JudgedMotion,
    MotionError,
    Run,
    RunStatus,
    estimated_error,
    judged_status,
)
from condyn_pin.simulation.notices import notices_of
from condyn_pin.simulation.records import (
    ContactRecord,
    Phase,
    candidates_of,
    contact_rows,
    gaps_along,
    row_names,
)
from condyn_pin.simulation.torques import PassiveForces


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A motion, one sample per row; what is not recorded is computed on demand.

    An event has two samples at the same time: before and after it.

    Attributes
    ----------
    phases : tuple of Phase
        Its parts with the same constraints.
    t : (k,) array
        Times of the samples [s].
    q, v, a : (k, nq), (k, nv), (k, nv) array
        Configurations, velocities [rad/s, m/s] and accelerations [rad/s^2, m/s^2], one row per
        sample.
    lam : (k, m) array
        Forces of constraints, and of contacts behind them [N, N m], rows in the order of
        `row_names`; zero while the scene has no such constraint or contact. Those of a step with
        contacts are its impulses over dt.
    tau : (k, nv) array
        Torques applied, those of forces from outside J_f^T f with them, without springs and
        damping [N, N m].
    run : Run
        How it was made, and how it ended.
    contact : ContactRecord or None
        Modes, residuals and work of contacts that open and slide, if the integrator lets them.
    """

    phases: tuple[Phase, ...]
    t: Array
    q: Array
    v: Array
    a: Array
    lam: Array
    tau: Array
    run: Run
    contact: ContactRecord | None = None

    slip = renamed("constraint_velocity")

    @property
    def scene(self) -> Scene:
        """The scene at the start, its contacts anchored."""
        return self.phases[0].scene

    @property
    def status(self) -> RunStatus:
        """Outcome of the run, or the limit of `MotionLimits` that the motion has left.

        Ok only if constraints, their velocities, contacts, stops and energy stayed within these at
        all samples.
        """
        return self._judged[0]

    @property
    def reason(self) -> str:
        """Reason for an early end, or place, time and size of limits that were left."""
        return self._judged[1]

    @cached_property
    def error(self) -> float:
        """Error of the positions of body points at the end [m], estimated by doubled steps.

        The errors of some steps, beside steps of twice the size, added up over the motion; NaN by
        an adaptive integrator. What the motion makes of them later is not in it. Torques of a
        function are those recorded, and are not called again.
        """
        return self._error.off

    @cached_property
    def _error(self) -> MotionError:
        return estimated_error(self)

    @cached_property
    def _judged(self) -> tuple[RunStatus, str]:
        run = self.run
        status, reason = judged_status(self.course) if run.status.ok else (run.status, run.reason)
        return (run.status, run.reason) if status.ok else (status, reason)

    @property
    def course(self) -> JudgedMotion:
        """The motion as its status is judged."""
        run, measured = self.run, self._kinematics
        return JudgedMotion(
            phases=self.phases, t=self.t, q=self.q, v=self.v, violation=measured.violation,
            constraint_velocity=measured.constraint_velocity, energy=self.energy, dt=run.dt,
            integrator=run.integrator, solver=run.solver, limits=run.limits,
        )  # fmt: skip

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the rows of lam."""
        names: dict[str, None] = {}
        for phase in self.phases:
            names.update(dict.fromkeys(row_names(phase.scene)))
        return tuple(names)

    @property
    def forces(self) -> dict[str, Array]:
        """Force on the first-named body by constraint, (k, 3), (k, 6) or (k, 1) [N, N m].

        In the axes of each constraint, or its `axes` if it has such; what its kind does not
        transmit is zero, the moment of a point too that becomes a surface of its name. A rod has
        one number, its tension with the sign of lam. A contact has (t1, t2, n) on the robot, n from
        the ground to it; a stop and dry friction have one number.
        """
        parts: dict[str, list[tuple[slice, Array]]] = {}
        for phase in self.phases:
            lam = self.lam[phase.samples][:, list(phase.columns[: phase.scene.rows])]
            turned = forces_in_axes(phase.scene, self.q[phase.samples], lam)
            for bound in phase.scene.bounds:
                force = lam[:, bound.rows]
                if bound.name in turned:
                    force = turned[bound.name]
                elif not bound.is_scalar:
                    force = np.array([bound.whole(row) for row in force])
                parts.setdefault(bound.name, []).append((phase.samples, force))
            rows = list(phase.columns[phase.scene.rows :])
            for name, its in contact_rows(candidates_of(phase.scene)).items():
                force = self.lam[phase.samples][:, rows[its]]
                parts.setdefault(name, []).append((phase.samples, force))
        return {name: self._joined(each) for name, each in parts.items()}

    def _joined(self, parts: list[tuple[slice, Array]]) -> Array:
        """Arrays of one constraint over all phases (k, columns), zero where a phase has none."""
        joined = np.zeros((len(self.t), max(part.shape[1] for _, part in parts)))
        for samples, part in parts:
            joined[samples, : part.shape[1]] = part
        return joined

    @property
    def modes(self) -> dict[str, NDArray[np.object_]]:
        """Mode of each contact at each sample (k,): open, stick or slide.

        One without an impulse is open, also where it touches: which corners of a flat foot carry it
        is not determined. `gaps` says which of them are on the floor.
        """
        return self.contact.modes if self.contact else {}

    @cached_property
    def gaps(self) -> dict[str, Array]:
        """Distance of each contact and stop (k,) [m, rad]; NaN while the scene does not have it."""
        gaps: dict[str, Array] = {}
        for phase in self.phases:
            names, values = gaps_along(phase.scene, self.q[phase.samples])
            for name, its in zip(names, values.T, strict=True):
                gaps.setdefault(name, np.full(len(self.t), np.nan))[phase.samples] = its
        return gaps

    @property
    def violation(self) -> Array:
        """Max abs(c(q)) at each sample (k,) [m, rad]."""
        return self._kinematics.violation

    @property
    def constraint_velocity(self) -> Array:
        """Max abs(J v) at each sample (k,) [m/s, rad/s]: the violation of the velocities."""
        return self._kinematics.constraint_velocity

    @cached_property
    def momentum(self) -> Array:
        """Linear, and angular about the centre of mass (k, 6) [kg m/s, kg m^2/s], world axes."""
        return gauge_of(self.scene).momentum(self.q, self.v)

    @cached_property
    def energy(self) -> Energy:
        """Energies, and the work that explains how they change.

        The work is integrated over the samples: `record` them all where it is to be accurate;
        `Energy.doubt` bounds what it may be off by.
        """
        return energy_of(self, self._kinematics)

    @cached_property
    def notices(self) -> tuple[str, ...]:
        """Warnings about the motion, one sentence each."""
        return notices_of(self)

    @cached_property
    def _kinematics(self) -> Kinematics:
        parts = [
            gauge_of(p.scene).measure(*(x[p.samples] for x in (self.t, self.q, self.v)))
            for p in self.phases
        ]
        return Kinematics(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def save(self, path: str | PathLike[str]) -> None:
        """Write it to a file (npz): the samples, the robot's model, and how it was made.

        Nothing in it is executed when it is read, and any Pinocchio that is supported reads it.
        """
        from condyn_pin.simulation.files import save

        save(self, path)

    @staticmethod
    def load(path: str | PathLike[str]) -> Trajectory:
        """Return a trajectory that was saved.

        Raises
        ------
        InvalidArgument
            If the file is missing, or not a saved trajectory.
        """
        from condyn_pin.simulation.files import load

        return load(path)

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write t, q, v, a, tau, lam, violation, J v and energy, one sample a line."""
        from condyn_pin.simulation.files import to_csv

        to_csv(self, path)

    def to_pandas(self) -> Any:
        """Return the table of `to_csv` as a `pandas.DataFrame`, with time as its index.

        Columns are named by joint: ``run.to_pandas()["q knee"].plot()``. A joint with several
        numbers has ``q root_joint[0]`` and so on.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        return require_pandas().DataFrame(columns(self)).set_index("t [s]")

    def __len__(self) -> int:
        return len(self.t)

    def _repr_html_(self) -> str:
        """HTML of the trajectory for a notebook."""
        return trajectory_html(self)

    def __repr__(self) -> str:
        return (
            f"Trajectory({self.scene.robot.name}: {len(self.t)} samples to t = {self.t[-1]:.6g} s, "
            f"{self.status.word})"
        )

    def __str__(self) -> str:
        return trajectory_text(self)


# Columns of a motion, named by joint.


def columns(trajectory: Trajectory) -> dict[str, Array]:
    """Return t, q, v, a, tau, lam, violation, J v and energy by name, each (k,)."""
    table = {"t [s]": trajectory.t}
    moved = {name: getattr(trajectory, name) for name in ("q", "v", "a", "tau")}
    table |= by_joint(trajectory.scene.robot.model, moved)
    lam = (f"lam {name}" for name in trajectory.row_names)
    table |= dict(zip(lam, trajectory.lam.T, strict=True))
    table["violation"] = trajectory.violation
    table["constraint_velocity"] = trajectory.constraint_velocity
    energy = trajectory.energy
    return table | {f"{f.name} [J]": getattr(energy, f.name) for f in fields(energy)}


# The energies of a trajectory, and the work that explains how they change.


def energy_of(trajectory: Trajectory, kinematics: Kinematics) -> Energy:
    """Return the energies at the samples, work integrated over these."""
    run, t = trajectory.run, trajectory.t
    robot, effects = trajectory.scene.robot, run.effects
    passive = PassiveForces.of(robot, springs=effects.springs, damping=effects.damping)
    with np.errstate(all="ignore"):  # a run that was lost ends with numbers that overflow
        applied = _Power(trajectory, lambda q, v, tau: np.sum(tau * v, axis=1))
        damped = _Power(trajectory, lambda q, v, tau: -passive.dissipation(q, v))
        if is_accurate(run.integrator):
            damped.rate = damping_rate(passive, trajectory.v, trajectory.a)
        sprung = passive.energy(trajectory.q)
    impacts, struck = np.zeros((2, len(t)))
    for event in run.happened:
        struck[event.sample :] += event.driven
        if event.is_of_contacts:
            continue  # the work of contacts has it
        impacts[event.sample :] -= event.energy_lost
    done, taken = applied.work(), damped.work()
    driven = _driven_work(trajectory)
    contact, correction, algorithmic = _contact_work(trajectory)
    return Energy(
        kinetic=kinematics.kinetic, potential=kinematics.potential, springs=sprung, work=done[0],
        damping=taken[0], impacts=impacts, driven=driven[0] + struck, contact=contact,
        correction=correction, algorithmic=algorithmic, doubt=done[1] + taken[1] + driven[1],
    )  # fmt: skip


class _Power:
    """A power along a motion, of (q, v, tau): at its samples, and of mean velocities between."""

    def __init__(self, trajectory: Trajectory, of: Callable[[Array, Array, Array], Array]) -> None:
        q, v, tau = trajectory.q, trajectory.v, trajectory.tau
        self._motion, self._at = trajectory, of(q, v, tau)
        self._between = of(q[:-1], 0.5 * (v[1:] + v[:-1]), 0.5 * (tau[1:] + tau[:-1]))
        self.rate: Array | None = None  # of the power at the samples [W/s]

    def work(self) -> tuple[Array, Array]:
        """Return its work since the start (k,), and the doubt of it [J]."""
        parts, doubts = [], []
        for phase in self._motion.phases:
            its = phase.samples
            t, power = self._motion.t[its], self._at[its]
            parts.append(work(t, power, None if self.rate is None else self.rate[its]))
            between, v = self._between[its.start : its.stop - 1], self._motion.v[its]
            doubts.append(integral_error(t, power, parts[-1], between, v))
        return _chained(parts), _chained(doubts)


def _contact_work(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    contact = trajectory.contact
    if contact is None:
        none = np.zeros(len(trajectory.t))
        return none, none, none
    return contact.work, contact.correction, contact.algorithmic


def _driven_work(trajectory: Trajectory) -> tuple[Array, Array]:
    """Work of driven constraints between events (k,) [J], and its estimated error (k,) [J]."""
    booked = trajectory.contact.driven if trajectory.contact else None
    if booked is not None and isinstance(trajectory.run.integrator, ContactScheme):
        return booked, np.zeros(len(booked))
    parts, doubts = [], []
    for phase in trajectory.phases:
        t, power = trajectory.t[phase.samples], _drive_power(trajectory, phase)
        parts.append(work(t, power))
        doubts.append(integral_error(t, power, parts[-1], 0.5 * (power[1:] + power[:-1])))
    return _chained(parts), _chained(doubts)


def _drive_power(trajectory: Trajectory, phase: Phase) -> Array:
    its = phase.samples
    lam = trajectory.lam[its][:, list(phase.columns)]
    return drive_power(phase.scene, trajectory.t[its], trajectory.q[its], lam)


def _chained(parts: list[Array]) -> Array:
    """Return integrals over phases, each beginning where the one before ended."""
    start, chained = 0.0, []
    for part in parts:
        chained.append(start + part)
        start = chained[-1][-1]
    return np.concatenate(chained)


# A motion in words: how it was made, how far it drifted, and where its energy went.


# Events that are listed, at most.
_SHOWN: Final = 20


def trajectory_text(motion: Trajectory) -> str:
    """Summary of a trajectory as text, for `print`."""
    run, energy, scene = motion.run, motion.energy, motion.scene
    ratio = motion.t[-1] / run.wall_time if run.wall_time else float("nan")
    return "\n".join(
        [
            f"{scene.robot.name}, {_counts(scene)}: {motion.t[-1]:.6g} s in steps of "
            f"{1e3 * run.dt:.4g} ms, {len(motion.t)} samples, {motion.status.word}",
            run.choices,
            run.effects.text(scene.robot),
            f"time        {run.wall_time:.3g} s, {ratio:.3g} x real time",
            *_constraint_lines(motion),
            *_energy_lines(energy, is_driven=any(phase.scene.is_driven for phase in motion.phases)),
            *_event_lines(motion),
            *(f"note: {notice}" for notice in motion.notices),
        ]
    )


def _counts(scene: Scene) -> str:
    """Numbers of constraint rows and of contacts of a scene, in words."""
    contacts = sum(len(bound.candidates) for bound in scene.contact_bounds)
    rows = [f"{scene.rows} rows"] if scene.rows or not contacts else []
    return ", ".join([*rows, *([count_text(contacts, "contact")] if contacts else [])])


def _constraint_lines(motion: Trajectory) -> list[str]:
    """Text lines on constraint violation, depth of contacts, and contact modes at the end."""
    lines = []
    if any(phase.scene.rows for phase in motion.phases):
        lines.append(
            f"violation   {motion.violation.max():.1e} m, rad at most; "
            f"{motion.constraint_velocity.max():.1e} m/s, rad/s"
        )
    if motion.contact:
        deepest = max((-float(np.nanmin(gap)) for gap in motion.gaps.values()), default=0.0)
        last = [its[-1] for its in motion.modes.values()]
        modes = ", ".join(f"{last.count(mode)} {mode}" for mode in MODES if mode in last)
        lines.append(f"contacts    {max(deepest, 0.0):.1e} m, rad deep at most; at the end {modes}")
    return lines


_ROUNDING: Final = 1e-14  # of the largest energy: smaller parts are printed as zero


def _energy_lines(energy: Energy, *, is_driven: bool) -> list[str]:
    least = _ROUNDING * float(np.abs(energy.total).max(initial=0.0))

    def joule(parts: Mapping[str, Array]) -> str:
        """Energies at the end, those of rounding as zero."""
        ends = {name: float(x[-1]) for name, x in parts.items()}
        return ", ".join(f"{name} {0.0 if abs(x) < least else x:.4g} J" for name, x in ends.items())

    work = {"tau and forces": energy.work, "damping": energy.damping, "impacts": energy.impacts}
    work |= {"contacts": energy.contact} | ({"drives": energy.driven} if is_driven else {})
    lines = [
        f"energy      {energy.total[0]:.6g} J to {energy.total[-1]:.6g} J",
        f"work        {joule(work)}",
    ]
    if energy.correction.any() or energy.algorithmic.any():  # of steps with contacts
        added = {"corrections": energy.correction, "algorithmic": energy.algorithmic}
        lines.append(f"            {joule(added)}")
    return [*lines, f"unexplained {np.abs(energy.error).max():.1e} J at most"]


def _event_lines(motion: Trajectory) -> list[str]:
    events, more = motion.run.happened[:_SHOWN], len(motion.run.happened) - _SHOWN
    lines = [f"event       {each.name} at t = {each.t:.9g} s" for each in events]
    lines += [f"event       and {more} more"] if more > 0 else []
    return [*lines, *(f"event       {missed}" for missed in motion.run.missed)]


# A Trajectory as a notebook shows it.


_EVENTS = 20  # that are listed


def trajectory_html(trajectory: Trajectory) -> str:
    """Summary of a motion as HTML: settings, error curves, events and warnings."""
    run, energy, t = trajectory.run, trajectory.energy, trajectory.t
    said = {
        "motion": f"{t[-1] - t[0]:.6g} s in steps of {1e3 * run.dt:.4g} ms, {len(t)} samples",
        "chosen": run.choices,
        "effects": run.effects.text(trajectory.scene.robot),
        "took": f"{run.wall_time:.3g} s",
    }
    events = [(each.name, f"{each.t:.6g}") for each in run.happened[:_EVENTS]]
    more = len(run.happened) - len(events)
    return show.page(
        f"{trajectory.scene.robot.name}: {run.status.word}",
        show.notes([trajectory.reason] if trajectory.reason else []),
        show.facts(said.items()),
        show.curve("open constraints", t, trajectory.violation, "m, rad")
        if trajectory.scene.rows
        else "",
        show.curve("energy", t, energy.total, "J"),
        show.curve("energy that nothing explains", t, np.abs(energy.error), "J"),
        show.folded_html(
            f"{len(run.happened)} events" + (f", the first {_EVENTS} here" if more > 0 else ""),
            show.grid(("event", "t [s]"), events),
            count=len(events),
        ),
        show.notes([*run.missed, *trajectory.notices]),
        ok=run.status.ok,
    )


@dataclass(frozen=True, eq=False, repr=False)
class MotionBalance:
    """Centre of mass, centre of pressure and capture point along a motion, in world axes.

    A contact that may open counts while it sticks or slides, and so does one next to it that is
    on its plane without a force: which corners of a flat foot carry the load is not determined, and
    all are edges of the support. A contact on another body of the robot does not count. Quantities
    that are not defined at a sample are NaN: in flight, and if the contacts do not lie in one
    plane, all but the centre of mass; and the centre of pressure of a contact without load.

    Attributes
    ----------
    t : (k,) array
        Times of the samples [s].
    com, zmp, cop, dcm, capture_point : (k, 3) array
        Of each sample [m], as in `Balance`.
    zmp_margin, cop_margin, capture_margin : (k,) array
        How far each point is within the support polygon [m]; negative outside.
    polygons : tuple of SupportPolygon or None
        The support at each sample; None in flight and on what is not one plane.
    name : str
        Of the robot.
    """

    t: Array
    com: Array  # [m]
    zmp: Array  # [m]
    cop: Array  # [m]
    dcm: Array  # [m]
    capture_point: Array  # [m]
    zmp_margin: Array  # [m]
    cop_margin: Array  # [m]
    capture_margin: Array  # [m]
    polygons: tuple[SupportPolygon | None, ...]
    name: str

    def __repr__(self) -> str:
        held = sum(each is not None for each in self.polygons)
        return (
            f"MotionBalance({self.name}: {len(self.t)} samples, {held} on one plane; least margins "
            f"to the edge of the support: ZMP {_least(self.zmp_margin):.4g} m, CoP "
            f"{_least(self.cop_margin):.4g} m, capture point {_least(self.capture_margin):.4g} m)"
        )


def motion_balance(trajectory: Trajectory) -> MotionBalance:
    """Return centre of pressure, capture point and stability margins along a motion.

    Parameters
    ----------
    trajectory : Trajectory
        On contacts that are held, that open and slide, or both.

    Returns
    -------
    MotionBalance

    Raises
    ------
    InvalidArgument
        If it has nothing that could press on a floor, or a contact does not say its size.

    Notes
    -----
    Takes a millisecond a sample.
    """
    check_type("trajectory", trajectory, Trajectory, "one of simulate is needed")
    scenes = [phase.scene for phase in trajectory.phases]
    if not any(_on_ground(x) or any(c.support for c in x.constraints) for x in scenes):
        raise InvalidArgument("trajectory: its scene has no contact that presses on a floor")
    found = list(balances(trajectory, range(len(trajectory.t))))
    return MotionBalance(
        t=trajectory.t,
        com=np.array([each.com for each in found]),
        zmp=np.array([each.zmp for each in found]),
        cop=np.array([each.cop for each in found]),
        dcm=np.array([each.dcm for each in found]),
        capture_point=np.array([each.capture_point for each in found]),
        zmp_margin=np.array([each.zmp_margin for each in found]),
        cop_margin=np.array([margin_within(each.polygon, each.cop) for each in found]),
        capture_margin=np.array([each.capture_margin for each in found]),
        polygons=tuple(each.polygon for each in found),
        name=trajectory.scene.robot.name,
    )


def balances(trajectory: Trajectory, samples: Sequence[int]) -> Iterator[Balance]:
    """Yield the balance of some samples, in rising order."""
    modes = trajectory.modes
    for phase in trajectory.phases:
        scene, columns = phase.scene, list(phase.columns)
        candidates = candidates_of(scene)
        for k in samples:
            if not phase.samples.start <= k < phase.samples.stop:
                continue
            q, lam = trajectory.q[k], trajectory.lam[k, columns]
            touching = {name for name, mode in modes.items() if mode[k] != "open"}
            if touching:  # which corners of a flat foot carry it is not determined
                touching |= {name for name in modes if _on_plane(trajectory, name, k)}
            pressure = pressure_of(scene, candidates, q, lam, touching)
            yield balanced(scene, q, trajectory.v[k], trajectory.a[k], pressure)


def pressure_of(
    scene: Scene, candidates: Candidates, q: Array, lam: Array, touching: set[str]
) -> Pressure:
    """Forces lam of constraints and touching contacts on the ground, and their points."""
    held = floor_pressure(Sites(scene, q), lam[: scene.rows])
    if not touching:
        return held
    model = scene.robot.unedited
    data = data_of(model)
    algorithms(data).forwardKinematics(model, data, q)
    axes = candidates.axes(data, q)
    # on the plane itself: what penetrates a little, or is not quite down, is on one plane as well
    gaps = candidates.gaps(data, q)[: candidates.cones]
    points = candidates.points(data, q) - gaps[:, None] * axes[:, :, 2]
    forces = lam[scene.rows :][: 3 * candidates.cones].reshape(-1, 3)
    on_ground = _on_ground(scene) & touching
    places, exerted = [held.points], held.exerted.copy()
    cops, pressing = dict(held.cops), dict(held.forces)
    for i, name in enumerate(candidates.names[: candidates.cones]):
        if name not in on_ground:
            continue
        p, f = points[i], axes[i] @ forces[i]
        places.append(p[None])
        exerted += np.concatenate((f, np.cross(p, f)))
        cops[name] = p if forces[i, 2] > 0 else np.full(3, np.nan)
        if forces[i, 2] > 0:
            pressing[name] = f
    return Pressure(np.vstack(places), exerted, cops, pressing)


def _on_plane(trajectory: Trajectory, name: str, k: int) -> bool:
    gap = trajectory.gaps.get(name)  # dry friction has none
    return gap is not None and bool(gap[k] <= tolerances.TOUCHES)


def _on_ground(scene: Scene) -> set[str]:
    """Return the contacts whose other side is the world."""
    return {name for bound in scene.contact_bounds for name, ground in bound.cones if not ground}


def _least(margins: Array) -> float:
    return float(np.nanmin(margins)) if np.isfinite(margins).any() else float("nan")
