"""Files of trajectories: archives, and csv."""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import finite
from condyn_pin._core.files import written_beside
from condyn_pin.contact.problem import MODES
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.archive import (
    CHOICES,
    MOTION,
    Content,
    Header,
    Path_,
    check_times,
    choice,
    decode,
    encode,
    limits_of,
    read,
    scene_of,
    write,
)
from condyn_pin.simulation.columns import columns
from condyn_pin.simulation.contact_columns import candidates_of, row_names
from condyn_pin.simulation.contact_record import ContactRecord, width, written_before
from condyn_pin.simulation.events import Happened
from condyn_pin.simulation.outcome import Effects, Run, RunStatus
from condyn_pin.simulation.recorder import Phase
from condyn_pin.simulation.remarks import Remark
from condyn_pin.simulation.trajectory import Trajectory

_ARRAYS = ("t", "q", "v", "a", "lam", "tau")
_PLAIN = ("duration", "dt", "reason", "wall_time")
_CHOICES = CHOICES | {"effects": Effects}


def save(trajectory: Trajectory, path: Path_) -> None:
    """Write a trajectory; see `Trajectory.save`."""
    arrays = {name: getattr(trajectory, name) for name in _ARRAYS}
    if trajectory.contact:
        arrays["contact"] = trajectory.contact.columns
    write(path, MOTION, trajectory.scene.robot, _header(trajectory), arrays)


def _header(trajectory: Trajectory) -> Header:
    """Return what is no array, in words and numbers."""
    run = trajectory.run
    return {
        "phases": [
            {
                "constraints": [encode(c) for c in phase.scene.constraints],
                "contacts": [encode(c) for c in phase.scene.contacts],
                "samples": [phase.samples.start, phase.samples.stop],
                "columns": phase.columns,
            }
            for phase in trajectory.phases
        ],
        "run": {
            **{key: getattr(run, key) for key in _PLAIN},
            **{key: encode(getattr(run, key)) for key in _CHOICES},
            "limits": encode(run.limits),
            "status": run.status.name,
            "happened": [encode(event) for event in run.happened],
            "missed": run.missed,
            "differenced": run.differenced,
            "remarks": [encode(remark) for remark in run.remarks],
        },
    }


def load(path: Path_) -> Trajectory:
    """Return a trajectory from a file; see `Trajectory.load`."""
    return read(path, MOTION, (*_ARRAYS, "contact"), _trajectory)


def _trajectory(robot: Robot, header: Header, content: Content) -> Trajectory:
    phases = tuple(
        Phase(
            scene_of(robot, phase),
            slice(*phase["samples"]),
            tuple(phase["columns"]),
        )
        for phase in header["phases"]
    )
    _check_arrays(content, robot, phases)
    made = _run(header["run"])
    _check_run(made, len(content["t"]))
    contact = None
    if "contact" in content:
        names = dict.fromkeys(n for phase in phases for n in candidates_of(phase.scene).names)
        is_driven = any(phase.scene.is_driven for phase in phases)
        kept = written_before(content["contact"], len(names))
        shape = (len(content["t"]), width(len(names), is_driven=is_driven))
        contact = ContactRecord(tuple(names), finite("contact", kept, shape))
    arrays = {name: content[name] for name in _ARRAYS}
    return Trajectory(phases=phases, run=made, contact=contact, **arrays)


def _run(run: dict[str, Any]) -> Run:
    return Run(
        **{key: run[key] for key in _PLAIN},
        **{key: choice(key, run[key], kind) for key, kind in _CHOICES.items()},
        limits=limits_of(run),
        status=RunStatus[run["status"]],
        happened=tuple(decode(event) for event in run["happened"]),
        missed=tuple(run.get("missed", ())),  # files of before have none
        differenced=int(run.get("differenced", 0)),
        remarks=tuple(decode(remark) for remark in run.get("remarks", ())),
    )


def _check_arrays(content: Content, robot: Robot, phases: tuple[Phase, ...]) -> None:
    """Refuse arrays that do not fit each other, and numbers that are none."""
    k, nv = _count(phases), robot.nv
    m = max((column + 1 for phase in phases for column in phase.columns), default=0)
    shapes = {"t": (k,), "q": (k, robot.nq), "lam": (k, m)} | dict.fromkeys(
        ("v", "a", "tau"), (k, nv)
    )
    for name, shape in shapes.items():
        if finite(name, content[name], shape).dtype != content[name].dtype:
            raise ValueError(f"{name} is of {content[name].dtype}: float64 is needed")
    times = [content["t"][phase.samples] for phase in phases]
    if any((np.diff(t) <= 0).any() for t in times) or (np.diff(content["t"]) < 0).any():
        raise ValueError("t goes back, or stands still")
    for i, q in enumerate(content["q"]):
        if not pin.isNormalized(robot.model, q, tolerances.QUATERNION):
            raise ValueError(f"q[{i}] has a quaternion that is not normalised")


def _count(phases: tuple[Phase, ...]) -> int:
    """Return how many samples there are; phases have to follow one another, each with its rows."""
    count = 0
    for phase in phases:
        start, stop = phase.samples.start, phase.samples.stop
        if type(start) is not int or type(stop) is not int or start != count or stop <= start:
            raise ValueError(f"samples {start} to {stop} of a phase do not follow {count}")
        columns, rows = phase.columns, len(row_names(phase.scene))
        if not all(type(column) is int and column >= 0 for column in columns) or not (
            len(columns) == len(set(columns)) == rows
        ):
            raise ValueError(f"columns {columns}: {rows} different ones are needed")
        count = stop
    return count


def _check_run(run: Run, count: int) -> None:
    """Refuse what are no words, times and events of a run."""
    if not isinstance(run.reason, str):
        raise TypeError(f"reason = {run.reason!r}")
    check_times(duration=run.duration, dt=run.dt, wall_time=run.wall_time)
    if not all(isinstance(why, str) for why in run.missed):
        raise TypeError(f"missed = {run.missed!r}")
    for remark in run.remarks:
        if not isinstance(remark, Remark) or not isinstance(remark.text, str):
            raise TypeError(f"remarks = {run.remarks!r}")
        check_times(t=remark.t, steps=remark.steps)
    for event in run.happened:
        if not isinstance(event, Happened) or not _fits(event, count):
            raise ValueError(f"event {event!r} of {count} samples")


def _fits(event: Happened, count: int) -> bool:
    """Return whether an event is one of a run of so many samples."""
    struck = event.impulses
    words = (event.name, *event.added, *event.dropped, *(name for name, *_ in struck))
    words += tuple(name for name, _, _ in event.modes)
    if not all(mode in MODES for _, *both in event.modes for mode in both):
        raise ValueError(f"modes = {event.modes!r}")
    numbers = [x for _, *impulse in struck for x in impulse]
    finite("impulses", numbers, len(numbers))
    finite("t", event.t, ())
    finite("energy_lost", event.energy_lost, ())
    finite("driven", event.driven, ())
    known = type(event.sample) is int and event.sample in range(count)
    return known and all(isinstance(word, str) for word in words)


def to_csv(trajectory: Trajectory, path: Path_) -> None:
    """Write a trajectory as a table; see `Trajectory.to_csv`."""
    table = columns(trajectory)
    samples, header = np.column_stack(list(table.values())), ",".join(table)
    with written_beside(path) as new:
        np.savetxt(new, samples, fmt="%.17g", delimiter=",", header=header, comments="")
