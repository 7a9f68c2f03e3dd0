"""BatchTrajectory: many motions of one scene, each with its errors and its status."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import nan
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import check_count, renamed
from condyn_pin._core.arrays import Array, finite, read_only
from condyn_pin._core.rows import MISSING, BatchResult, Some
from condyn_pin._core.show import require_pandas
from condyn_pin._core.work import Arrays, Kind
from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import NotRecorded
from condyn_pin.mechanism.closing import with_anchors
from condyn_pin.model.joints import by_joint
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.batch.inputs import denormalised_parts
from condyn_pin.simulation.files import (
    CHOICES,
    MOTIONS,
    Content,
    Header,
    check_times,
    choice,
    encode,
    limits_of,
    read_archive,
    scene_of,
    write,
)
from condyn_pin.simulation.integrators.integrator import Integrator
from condyn_pin.simulation.motion_status import MotionLimits, Run, RunStatus
from condyn_pin.simulation.records import (
    ContactRecord,
    Phase,
    candidates_of,
    row_names,
    width,
    written_before,
)
from condyn_pin.simulation.trajectory import Trajectory

# A status as a number is its place here.
RUN_STATUSES: Final = tuple(RunStatus)

# The arrays with one row per motion, as numbers.
ENDS: Final = (
    *("q", "v", "t", "violation", "constraint_velocity", "energy_error", "run_times"),
    "statuses",
)


def array_kinds(scene: Scene, kept: int) -> dict[str, Kind]:
    """Row shape and dtype of each array of a batch, with `kept` samples of each motion."""
    robot, rows = scene.robot, len(row_names(scene))
    widths: dict[str, tuple[int, ...]] = {
        "t": (),
        "q": (robot.nq,),
        "lam": (rows,),
    }
    widths |= dict.fromkeys(("v", "a", "tau"), (robot.nv,))
    ends = {name: Kind(widths.get(name, ())) for name in ENDS} | {"statuses": Kind((), "i1")}
    if scene.contacts:
        candidates = len(candidates_of(scene).names)
        widths["contact"] = (width(candidates, is_driven=scene.is_driven),)
    sampled = [name for name in SAMPLED if name in widths]
    samples = {f"samples_{name}": Kind((kept, *widths[name])) for name in sampled}
    return ends | samples if kept else ends


@dataclass(frozen=True, eq=False, repr=False)
class BatchTrajectory(BatchResult[Trajectory]):
    """The ends of N motions, and how well each kept constraints and energy.

    Attributes
    ----------
    scene : Scene
    integrator, drift, solver
        What was used.
    duration, dt : float
        What was asked for, and the step [s].
    steps : int
        Of each motion that went to its end.
    limits : MotionLimits
        Of what a status calls ok.
    t : (N,) array
        How far each motion went [s]; 0 where it could not begin.
    q, v : (N, nq), (N, nv) array
        Where it ended.
    violation, constraint_velocity : (N,) array
        The largest abs(c(q)) [m, rad] and abs(J v) [m/s, rad/s] among the samples checked.
    energy_error : (N,) array
        The largest energy that came or went without work, among the samples checked [J]. Work is
        integrated over them: where torques or damping act, ``record=1`` makes it accurate.
    statuses : (N,) int8 array
        Place in ``tuple(RunStatus)``: 0 is finished. -1 where no worker got that far, which only
        the batch of a `WorkersLost` or an `Interrupted` has.
    reasons : (N,) array of str
        Why each ended early, or where, when and how far it left its limits; empty of those ok.
    run_times : (N,) array
        Of each motion [s], while other processes used the machine too.
    samples : Samples or None
        None if nothing was to be recorded.
    seconds : float
        Wall time of the whole batch [s].

    Notes
    -----
    Printing it names the motions that are not ok. If samples were recorded, ``batch[i]`` is the
    `Trajectory` that `simulate` returns, bit for bit except for its wall time, with energies, gaps,
    forces, notices, and why it ended. Otherwise it raises `NotRecorded`, which says why.
    ``batch[2:4]`` and ``batch[batch.failed]`` are batches of some.
    """

    scene: Scene
    integrator: Integrator
    drift: Drift
    solver: Solver
    duration: float  # [s]
    dt: float  # [s]
    steps: int
    limits: MotionLimits
    t: Array
    q: Array
    v: Array
    violation: Array
    constraint_velocity: Array
    energy_error: Array
    statuses: NDArray[np.int8]
    reasons: NDArray[np.object_]
    run_times: Array  # [s]
    samples: Samples | None
    seconds: float  # [s]

    _rows = (*ENDS, "reasons")
    _endings = RUN_STATUSES
    _row = "motion"

    slip = renamed("constraint_velocity")

    def save(self, path: str | PathLike[str]) -> None:
        """Write all of it to a file (npz), as `Trajectory.save` does."""
        header = {
            "constraints": [encode(c) for c in self.scene.constraints],
            "contacts": [encode(c) for c in self.scene.contacts],
            **{key: getattr(self, key) for key in _PLAIN},
            **{key: encode(getattr(self, key)) for key in CHOICES},
            "limits": encode(self.limits),
            "endings": [status.name for status in RUN_STATUSES],
            "reasons": {int(i): self.reasons[i] for i in np.flatnonzero(self.reasons)},
        }
        arrays = {name: getattr(self, name) for name in ENDS}
        if self.samples:
            arrays |= {f"samples_{name}": array for name, array in self.samples.arrays.items()}
        write(path, MOTIONS, self.scene.robot, header, arrays)

    @staticmethod
    def load(path: str | PathLike[str]) -> BatchTrajectory:
        """Return a batch that was saved.

        Raises
        ------
        InvalidArgument
            If the file is missing, or is not one of a batch of motions.
        """
        return read_archive(
            path, MOTIONS, (*ENDS, *(f"samples_{name}" for name in SAMPLED)), _batch
        )

    def to_pandas(self) -> Any:
        """Return the ends as a `pandas.DataFrame`, a motion a row; ``batch[i].to_pandas()`` is one.

        Columns: status, reason, t, q and v by joint, and the errors.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        table: dict[str, Any] = {"status": self.status_names, "reason": self.reasons}
        table |= {"t [s]": self.t}
        table |= by_joint(self.scene.robot.model, {"q": self.q, "v": self.v})
        errors = "violation", "constraint_velocity", "energy_error", "run_times"
        return require_pandas().DataFrame(table | {name: getattr(self, name) for name in errors})

    def _some(self, rows: Some) -> BatchTrajectory:
        return replace(super()._some(rows), samples=self.samples and self.samples.of(rows))

    def _one(self, i: int) -> Trajectory:
        self._check_found(i, self.statuses, "motion")
        if self.samples is None:
            raise NotRecorded(
                f"motion {i}: no samples were kept; simulate_batch(..., record=1) keeps them all"
            )
        columns = {name: array[i] for name, array in self.samples.arrays.items()}
        kept = np.count_nonzero(np.isfinite(columns["t"]))
        if not kept:
            raise NotRecorded(f"motion {i} could not begin: {self.reasons[i]}")
        samples = {name: column[:kept] for name, column in columns.items()}
        scene = with_anchors(self.scene, samples["q"][0], {})
        status, reason = RUN_STATUSES[self.statuses[i]], self.reasons[i]
        if status.went_on:  # a motion is judged by its samples
            status, reason = RunStatus.FINISHED, ""
        run = Run(
            duration=self.duration, dt=self.dt, integrator=self.integrator, drift=self.drift,
            solver=self.solver, limits=self.limits, status=status, reason=reason,
            wall_time=float(self.run_times[i]),
        )  # fmt: skip
        phase = Phase(scene, slice(0, int(kept)), tuple(range(samples["lam"].shape[1])))
        touches, contact = samples.pop("contact", None), None
        if touches is not None:
            contact = ContactRecord(candidates_of(scene).names, touches)
        return Trajectory((phase,), run=run, contact=contact, **samples)

    def _how(self) -> str:
        speed = float(self.t.sum()) / self.dt / self.seconds if self.seconds else nan
        time = f"{self.steps} steps of {1e3 * self.dt:.4g} ms, {super()._how()}"
        return f"{time}: {speed:.4g} steps/s"

    def _worst(self) -> list[str]:
        of_c, of_v, of_energy = (
            f"{known.max():.1e}" if (known := each[np.isfinite(each)]).size else "?"
            for each in (self.violation, self.constraint_velocity, self.energy_error)
        )
        return [
            f"violation   {of_c} m, rad at most; {of_v} m/s, rad/s",
            f"unexplained {of_energy} J at most",
        ]

    def _named(self, i: int) -> str:
        return str(i) if self.statuses[i] == MISSING else f"{i} after {self.t[i]:.4g} s"


# Samples: what is kept of many motions, and the arrays that hold it.


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """The samples of N motions; NaN after the end of one that broke down."""

    t: Array  # (N, k) [s]
    q: Array
    v: Array
    a: Array
    lam: Array  # (N, k, m) constraint forces in the axes of each constraint [N, N m]
    # (N, k, nv) torques applied, those of forces from outside with them, without springs and
    # damping [N, N m]
    tau: Array
    # (N, k, 4 + candidates) `ContactRecord.columns` of each motion, where contacts may open
    contact: Array | None = None

    @property
    def arrays(self) -> dict[str, Array]:
        """Recorded arrays by name."""
        return {name: array for name, array in vars(self).items() if array is not None}

    def of(self, motions: Some) -> Samples:
        """Samples of some motions."""
        return Samples(**{name: read_only(x[motions]) for name, x in self.arrays.items()})


SAMPLED: Final = tuple(field.name for field in fields(Samples))


def samples_in(arrays: Arrays) -> Samples | None:
    """Return the samples among the arrays of a batch."""
    keys = {name: f"samples_{name}" for name in SAMPLED}
    found = {name: arrays[key] for name, key in keys.items() if key in arrays}
    return Samples(**found) if found else None


# Files of batches of motions: the archives that trajectories are in, one row per motion.


_PLAIN = ("duration", "dt", "steps", "seconds")
_CONTACT = "samples_contact"


def _batch(robot: Robot, header: Header, content: Content) -> BatchTrajectory:
    scene = scene_of(robot, header)
    kept = content["samples_t"].shape[-1] if "samples_t" in content else 0
    kinds = array_kinds(scene, kept)
    arrays, count = {name: content[name] for name in kinds}, len(content["t"])
    if _CONTACT in arrays:
        arrays[_CONTACT] = written_before(arrays[_CONTACT], len(candidates_of(scene).names))
    for name, kind in kinds.items():
        there, wanted = arrays[name], kind.times(count)
        if there.shape != wanted.shape or there.dtype != wanted.dtype:
            raise ValueError(
                f"{name} has shape {there.shape} of {there.dtype}: {wanted.shape} of "
                f"{np.dtype(wanted.dtype)} is needed"
            )
    arrays["statuses"] = _statuses(header["endings"], arrays["statuses"])
    parts: dict[str, Any] = {key: choice(key, header[key], kind) for key, kind in CHOICES.items()}
    parts |= {key: header[key] for key in _PLAIN} | {name: arrays[name] for name in ENDS}
    parts |= {"limits": limits_of(header), "reasons": _reasons(header["reasons"], count)}
    batch = BatchTrajectory(scene, **parts, samples=samples_in(arrays))
    _check(batch)
    read_only((*arrays.values(), batch.reasons))
    return batch


def _statuses(endings: list[str], codes: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return places in `RUN_STATUSES` for those in the list of a file."""
    known = {place: RUN_STATUSES.index(RunStatus[name]) for place, name in enumerate(endings)}
    known[MISSING] = MISSING
    return np.array([known[code] for code in codes.tolist()], np.int8)


def _reasons(words: dict[str, str], count: int) -> NDArray[np.object_]:
    reasons = np.full(count, "", object)
    for i, text in words.items():
        if int(i) not in range(count) or not isinstance(text, str):
            raise ValueError(f"reason {text!r} of motion {i}: there are {count} motions")
        reasons[int(i)] = text
    return reasons


def _check(batch: BatchTrajectory) -> None:
    """Refuse motions that do not go together with their ends."""
    check_count("steps", batch.steps)
    check_times(duration=batch.duration, dt=batch.dt, seconds=batch.seconds)
    done = np.flatnonzero(batch.statuses != MISSING)
    for name in ("t", "q", "v"):
        ends = getattr(batch, name)[done]
        finite(f"{name} at the ends", ends, ends.shape)
    _check_units("q at the ends", batch, batch.q[done])
    if batch.samples:
        _check_samples(batch, batch.samples)


def _check_samples(batch: BatchTrajectory, samples: Samples) -> None:
    """Refuse samples that are not numbers to the end of a motion, and NaN from there."""
    kept = np.isfinite(samples.t)
    counts = np.count_nonzero(kept, axis=1)
    motions = np.flatnonzero(counts)
    if (kept[:, 1:] & ~kept[:, :-1]).any() or (np.diff(samples.t) <= 0).any():
        raise ValueError("samples_t goes back, or has a gap")
    if not counts[batch.statuses == 0].all():
        raise ValueError("samples_t has no sample of a motion that went to its end")
    for name, array in samples.arrays.items():
        if not np.isfinite(array[kept]).all():
            raise ValueError(f"samples_{name}: a sample is not finite")
    for name in ("t", "q", "v"):
        last = getattr(samples, name)[motions, counts[motions] - 1]
        if not np.array_equal(last, getattr(batch, name)[motions]):
            raise ValueError(f"samples_{name} do not lead to {name} at the ends")
    _check_units("samples_q", batch, samples.q[kept])


def _check_units(name: str, batch: BatchTrajectory, q: Array) -> None:
    """Refuse quaternions that are not normalised, of configurations (k, nq)."""
    if any(denormalised_parts(batch.scene.robot, q)):
        raise ValueError(f"{name} has a quaternion that is not normalised")
