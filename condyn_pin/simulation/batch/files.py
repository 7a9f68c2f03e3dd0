"""Files of batches of motions: the archives that trajectories are in, one row per motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array, finite, read_only
from condyn_pin._core.rows import MISSING
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.archive import (
    CHOICES,
    MOTIONS,
    Content,
    Header,
    Path_,
    check_times,
    choice,
    encode,
    limits_of,
    read,
    scene_of,
    write,
)
from condyn_pin.simulation.batch.inputs import loose
from condyn_pin.simulation.batch.samples import SAMPLED, Samples, samples_in
from condyn_pin.simulation.batch.trajectory import ENDS, RUN_STATUSES, BatchTrajectory, kinds_of
from condyn_pin.simulation.contact_columns import candidates_of
from condyn_pin.simulation.contact_record import written_before
from condyn_pin.simulation.outcome import RunStatus

_PLAIN = ("duration", "dt", "steps", "seconds")
_CONTACT = "samples_contact"


def save(batch: BatchTrajectory, path: Path_) -> None:
    """Write a batch; see `BatchTrajectory.save`."""
    header = {
        "constraints": [encode(c) for c in batch.scene.constraints],
        "contacts": [encode(c) for c in batch.scene.contacts],
        **{key: getattr(batch, key) for key in _PLAIN},
        **{key: encode(getattr(batch, key)) for key in CHOICES},
        "limits": encode(batch.limits),
        "endings": [status.name for status in RUN_STATUSES],
        "reasons": {int(i): batch.reasons[i] for i in np.flatnonzero(batch.reasons)},
    }
    arrays = {name: getattr(batch, name) for name in ENDS}
    if batch.samples:
        arrays |= {f"samples_{name}": array for name, array in batch.samples.arrays.items()}
    write(path, MOTIONS, batch.scene.robot, header, arrays)


def load(path: Path_) -> BatchTrajectory:
    """Return a batch from a file; see `BatchTrajectory.load`."""
    return read(path, MOTIONS, (*ENDS, *(f"samples_{name}" for name in SAMPLED)), _batch)


def _batch(robot: Robot, header: Header, content: Content) -> BatchTrajectory:
    scene = scene_of(robot, header)
    kept = content["samples_t"].shape[-1] if "samples_t" in content else 0
    kinds = kinds_of(scene, kept)
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
    if any(loose(batch.scene.robot, q)):
        raise ValueError(f"{name} has a quaternion that is not normalised")
