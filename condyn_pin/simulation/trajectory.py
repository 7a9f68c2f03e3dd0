"""Trajectory: a motion that was simulated, and what it says about itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import renamed
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.simulation.contact_columns import candidates_of, contact_rows, gaps_along, row_names
from condyn_pin.simulation.contact_record import ContactRecord
from condyn_pin.simulation.measures import Energy, Kinematics, gauge_of
from condyn_pin.simulation.motion_error import MotionError, estimated_error
from condyn_pin.simulation.motion_status import Course, judged
from condyn_pin.simulation.notices import notices_of
from condyn_pin.simulation.outcome import Run, RunStatus
from condyn_pin.simulation.recorder import Phase


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
        """How the run ended, or which of its `MotionLimits` the motion has left.

        Ok only if constraints, their velocities, contacts, stops and energy stayed within these at
        all samples.
        """
        return self._judged[0]

    @property
    def reason(self) -> str:
        """Why the run ended where it did, or where, when and how far limits were left."""
        return self._judged[1]

    @cached_property
    def error(self) -> float:
        """How far points of the bodies may be off at the end [m], estimated by doubled steps.

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
        status, reason = judged(self.course) if run.status.ok else (run.status, run.reason)
        return (run.status, run.reason) if status.ok else (status, reason)

    @property
    def course(self) -> Course:
        """The motion as its status is judged."""
        run, measured = self.run, self._kinematics
        return Course(
            self.phases, self.t, self.q, self.v, measured.violation, measured.constraint_velocity,
            self.energy, run.dt, run.integrator, run.solver, run.limits,
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

        In the axes of each constraint; what its kind does not transmit is zero, the moment of a
        point too that becomes a surface of its name. A rod has one number, its tension with the
        sign of lam. A contact has (t1, t2, n) on the robot, n from the ground to it; a stop and dry
        friction have one number.
        """
        parts: dict[str, list[tuple[slice, Array]]] = {}
        for phase in self.phases:
            for bound in phase.scene.bounds:
                force = self.lam[phase.samples][:, list(phase.columns[bound.rows])]
                if not bound.is_scalar:
                    force = np.array([bound.whole(row) for row in force])
                parts.setdefault(bound.name, []).append((phase.samples, force))
            rows = list(phase.columns[phase.scene.rows :])
            for name, its in contact_rows(candidates_of(phase.scene)).items():
                force = self.lam[phase.samples][:, rows[its]]
                parts.setdefault(name, []).append((phase.samples, force))
        return {name: self._joined(each) for name, each in parts.items()}

    def _joined(self, parts: list[tuple[slice, Array]]) -> Array:
        """Return what phases have of one constraint, as wide as the widest, zero elsewhere."""
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
        from condyn_pin.simulation.trajectory_energy import energy_of

        return energy_of(self, self._kinematics)

    @cached_property
    def notices(self) -> tuple[str, ...]:
        """What deserves attention, a sentence each."""
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
        """Return the same table as a `pandas.DataFrame`, the time its index.

        Columns are named by joint: ``run.to_pandas()["q knee"].plot()``. A joint with several
        numbers has ``q root_joint[0]`` and so on.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        from condyn_pin._core.show import require_pandas
        from condyn_pin.simulation.columns import columns

        return require_pandas().DataFrame(columns(self)).set_index("t [s]")

    def __len__(self) -> int:
        return len(self.t)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        from condyn_pin.simulation.trajectory_html import trajectory_html

        return trajectory_html(self)

    def __repr__(self) -> str:
        return (
            f"Trajectory({self.scene.robot.name}: {len(self.t)} samples to t = {self.t[-1]:.6g} s, "
            f"{self.status.name.lower()})"
        )

    def __str__(self) -> str:
        from condyn_pin.simulation.trajectory_text import trajectory_text

        return trajectory_text(self)
