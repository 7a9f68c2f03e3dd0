"""Samples, contacts, work and remarks that a run records.

Recorder: the samples of a run, packed as they come.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin._core.models import algorithms, data_of
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.indeterminacy import Indeterminacy
from condyn_pin.contact.problem import MODES, OPEN, Modes, mode_words
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import forces_in_axes

# Rows are packed into one array each time there are so many: a small array takes a hundred bytes
# more than its numbers.
BLOCK = 4096

# t, q, v, a, lam, tau, and of contacts that open and slide a row of their `ContactRecord`
Row = tuple[float, Array, Array, Array, Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a run with the same constraints."""

    scene: Scene  # with every contact anchored
    samples: slice  # its samples
    # where the rows of the scene, those of its contacts last, are among those of the trajectory
    columns: tuple[int, ...]


class Recorder:
    """The samples of one phase.

    `rows` are the last ones, whose arrays are not written to later. Who appends packs at `BLOCK`.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.rows: list[Row] = []
        self._blocks: list[tuple[Array, ...]] = []
        self._packed = 0

    def add(self, row: Row) -> None:
        """Keep a sample."""
        if len(self.rows) >= BLOCK:
            self.pack()
        self.rows.append(row)

    @property
    def count(self) -> int:
        """Number of samples."""
        return self._packed + len(self.rows)

    @property
    def last(self) -> float | None:
        """The time of the last sample [s]."""
        return self.rows[-1][0] if self.rows else None

    def drop_after(self, t: float) -> None:
        """Drop the last sample if it is later than t."""
        if self.rows and self.rows[-1][0] > t:
            self.rows.pop()

    def columns(self) -> tuple[Array, ...]:
        """Return t, q, v, a, lam and tau, a sample a row; of contacts what a row has of them."""
        blocks = [*self._blocks, _columns(self.rows)]
        return tuple(np.concatenate(parts) for parts in zip(*blocks, strict=True))

    def pack(self) -> None:
        """Put the rows into arrays, but for the last one, which may have to be dropped."""
        self._blocks.append(_columns(self.rows[:-1]))
        self._packed += len(self.rows) - 1
        del self.rows[:-1]


def _columns(rows: Sequence[Row]) -> tuple[Array, ...]:
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def merge(
    recorders: Sequence[Recorder],
) -> tuple[tuple[Phase, ...], tuple[Array, ...], ContactRecord | None]:
    """Return the phases of a run, t, q, v, a, lam and tau over all of them, and the contacts."""
    # The rows of lam are those of all constraints and contacts that a phase has, in the order in
    # which they came; they are zero while one is away.
    recorders = [recorder for recorder in recorders if recorder.count]
    names = [row_names(recorder.scene) for recorder in recorders]
    places = {name: i for i, name in enumerate(dict.fromkeys(n for each in names for n in each))}
    phases, parts, touches, start = [], [], [], 0
    for recorder, its in zip(recorders, names, strict=True):
        t, q, v, a, lam, tau, touch = recorder.columns()
        columns = tuple(places[name] for name in its)
        everything = np.zeros((recorder.count, len(places)))
        everything[:, list(columns)] = lam
        phases.append(Phase(recorder.scene, slice(start, start + recorder.count), columns))
        parts.append((t, q, v, a, everything, tau))
        touches.append(touch)
        start += recorder.count
    contact = None
    if any(touch.shape[1] for touch in touches):
        contact = joined([candidates_of(phase.scene).names for phase in phases], touches)
    return tuple(phases), tuple(np.concatenate(p) for p in zip(*parts, strict=True)), contact


# ContactRecord: what a run keeps of contacts that open and slide, beside their forces.


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """Contacts at the samples of a trajectory.

    Attributes
    ----------
    names : tuple of str
        Of the candidates.
    columns : (k, 4 + candidates) array
        Natural residual [1], three parts of `ContactWork` [J], and modes as places in `MODES` [1],
        open while a candidate is away: what a file has. Where constraints are driven, one column
        more has their work in steps with contacts [J].

    Raises
    ------
    ValueError
        If the columns are not those of so many contacts.
    """

    names: tuple[str, ...]
    columns: Array

    def __post_init__(self) -> None:
        more = self.columns.shape[1] - width(len(self.names))
        if more not in (0, 1) or not np.isin(self.codes, _CODES).all():
            raise ValueError(f"contact: modes of {len(self.names)} contacts are needed")

    @property
    def natural(self) -> Array:
        """Natural residual of the contact problem of the step that ends there (k,), no unit."""
        return self.columns[:, 0]

    @property
    def work(self) -> Array:
        """Work of friction and impacts since the start (k,) [J]; never positive."""
        return self.columns[:, 1]

    @property
    def correction(self) -> Array:
        """Work of pushing penetrations out, and of closing loops, since the start (k,) [J]."""
        return self.columns[:, 2]

    @property
    def algorithmic(self) -> Array:
        """Energy that impulses added against the contact laws since the start (k,) [J]."""
        return self.columns[:, 3]

    @property
    def codes(self) -> Array:
        """Modes (k, candidates), as places in `MODES`."""
        return codes_in(self.columns, len(self.names))

    @property
    def driven(self) -> Array | None:
        """Work of driven constraints in steps with contacts, since the start (k,) [J]."""
        last = width(len(self.names))
        return self.columns[:, last] if self.columns.shape[1] > last else None

    @property
    def modes(self) -> dict[str, NDArray[np.object_]]:
        """Open, stick or slide at each sample (k,), by candidate."""
        words = mode_words(self.codes)
        return {name: words[:, i] for i, name in enumerate(self.names)}


_CODES = range(len(MODES))

# Columns before the modes, and how many files of before have, whose work is all in one.
_WORKS, _WORKS_BEFORE = 4, 2


def width(candidates: int, *, is_driven: bool = False) -> int:
    """Number of columns of a contact record with this number of candidates."""
    return _WORKS + candidates + is_driven


def touch_of(
    natural: float, work: ContactWork, modes: Modes | Array, *, is_driven: bool = False
) -> Array:
    """Return a row of the columns of a record."""
    *works, driven = work
    return np.concatenate(((natural, *works), modes, (driven,) if is_driven else ()))


def codes_in(columns: Array, candidates: int) -> Array:
    """Return the modes (..., candidates) in rows of a record, as places in `MODES`."""
    return columns[..., _WORKS : _WORKS + candidates]


def with_work(touch: Array, candidates: int, work: ContactWork) -> Array:
    """Row of a record with this work; without contacts an empty one."""
    if not len(touch):
        return touch
    is_driven = len(touch) > width(candidates)
    return touch_of(float(touch[0]), work, codes_in(touch, candidates), is_driven=is_driven)


def written_before(columns: Array, candidates: int) -> Array:
    """Return columns (..., 2 + candidates) of a file of before as they are now; others as is."""
    if columns.shape[-1] != _WORKS_BEFORE + candidates:
        return columns
    return np.insert(columns, [_WORKS_BEFORE] * (_WORKS - _WORKS_BEFORE), 0.0, axis=-1)


def joined(names: Sequence[tuple[str, ...]], parts: Sequence[Array]) -> ContactRecord:
    """Return the record of phases one after another, each with the names of its candidates."""
    places = {name: i for i, name in enumerate(dict.fromkeys(n for each in names for n in each))}
    widths = [width(len(its)) for its in names]
    is_driven = any(part.shape[1] > own for part, own in zip(parts, widths, strict=True))
    columns: list[Array] = []
    driven = 0.0  # its work stays what it is while nothing is
    for its, own, part in zip(names, widths, parts, strict=True):
        if not part.shape[1]:  # without contacts, their work stays what it is
            part = np.zeros((len(part), own))
            if columns:
                part[:, 1:] = columns[-1][-1, 1:_WORKS]
        everything = np.full((len(part), width(len(places), is_driven=is_driven)), float(OPEN))
        everything[:, [*range(_WORKS), *(_WORKS + places[name] for name in its)]] = part[:, :own]
        if is_driven:
            everything[:, -1] = part[:, own] if part.shape[1] > own else driven
            driven = everything[-1, -1]
        columns.append(everything)
    return ContactRecord(tuple(places), np.concatenate(columns))


# Rows of lam that belong to constraints and contacts, by name, and the gaps of contacts.


def row_names(scene: Scene) -> tuple[str, ...]:
    """Return the names of the rows of lam: those of constraints, then those of contacts."""
    return scene.row_names + candidates_of(scene).row_names


def candidates_of(scene: Scene) -> Candidates:
    """Return the contacts of a scene, in memory of their own."""
    return Candidates(scene.robot.unedited, scene.contact_bounds)


def contact_rows(candidates: Candidates) -> dict[str, slice]:
    """Return the rows of each candidate: three of a cone, one of the others."""
    sizes = [3 if i < candidates.cones else 1 for i in range(len(candidates.names))]
    ends = accumulate(sizes)
    pairs = zip(candidates.names, ends, sizes, strict=True)
    return {name: slice(end - size, end) for name, end, size in pairs}


def gaps_along(scene: Scene, Q: Array) -> tuple[tuple[str, ...], Array]:
    """Return the names of what has a gap, and the gaps at Q (k, nq) [m, rad]."""
    model = scene.robot.unedited
    candidates = Candidates(model, scene.contact_bounds, exact=True)
    data = data_of(model)
    count = candidates.cones + candidates.half_lines
    gaps = np.empty((len(Q), count))
    for row, q in zip(gaps, Q, strict=True):
        algorithms(data).forwardKinematics(model, data, q)
        row[:] = candidates.gaps(data, q)
    return candidates.names[:count], gaps


def forces_of(scene: Scene, q: Array, lam: Array) -> dict[str, Array]:
    """Return lam (m,) by name: on the first-named body of a constraint, on the robot of a contact.

    In the axes of each at q, or its `axes` if it has such; a contact has (t1, t2, n).
    """
    forces = {
        bound.name: lam[bound.rows] if bound.is_scalar else np.asarray(bound.whole(lam[bound.rows]))
        for bound in scene.bounds
    }
    turned = forces_in_axes(scene, q[None], lam[None, : scene.rows])
    forces |= {name: force[0] for name, force in turned.items()}
    contacts = lam[scene.rows :]
    return forces | {
        name: contacts[rows] for name, rows in contact_rows(candidates_of(scene)).items()
    }


# ContactWork: what steps with contacts did to the energy of a motion, each part by its cause.


class ContactWork(NamedTuple):
    """Work of contacts that open and slide, in a step or since the start of a run.

    Attributes
    ----------
    contact : float
        Friction and impacts; they only take [J].
    correction : float
        What pushes penetrations out, and moves q back onto the loops [J].
    algorithmic : float
        What impulses gave against the laws of contact, for a step knows J at one place only [J].
    driven : float
        Constraints that follow a path of time [J].
    """

    contact: float  # [J]
    correction: float  # [J]
    algorithmic: float  # [J]
    driven: float = 0.0  # [J]

    @property
    def total(self) -> float:
        """Total work [J]."""
        return self.contact + self.correction + self.algorithmic + self.driven

    def plus(self, other: ContactWork) -> ContactWork:
        """Sum of two works."""
        return ContactWork(
            self.contact + other.contact,
            self.correction + other.correction,
            self.algorithmic + other.algorithmic,
            self.driven + other.driven,
        )

    def more(
        self, *, contact: float = 0.0, correction: float = 0.0, driven: float = 0.0
    ) -> ContactWork:
        """Work with more of friction and impacts, of corrections, and of drives added [J]."""
        return self.plus(ContactWork(contact, correction, 0.0, driven))


NO_WORK: Final = ContactWork(0.0, 0.0, 0.0)


# Remarks: sentences of the steps of a run, each once, with its first time.


class Note(NamedTuple):
    """A sentence of one step, with the contacts that it is of."""

    kind: str
    names: tuple[str, ...]  # of contacts
    text: str


def notes_of(several: Iterable[Indeterminacy]) -> list[Note]:
    """Notes on contacts whose velocities Coulomb's law does not determine."""
    return [Note(each.kind, each.whole_names, each.text) for each in several]


@dataclass(frozen=True)
class Remark:
    """Message of one or more steps of a run, with its first time.

    Attributes
    ----------
    text : str
        Sentence of the first step.
    t : float
        Time of the first step [s].
    steps : int
        Number of steps with this message.
    """

    text: str
    t: float  # [s]
    steps: int = 1

    def __str__(self) -> str:
        more = f", in {self.steps} steps" if self.steps > 1 else ""
        return f"from t = {self.t:.4g} s{more}: {self.text}"


class Remarks:
    """Remarks of a run in progress: one of a kind for the same contacts."""

    def __init__(self) -> None:
        self._made: dict[tuple[str, tuple[str, ...]], tuple[Remark, float]] = {}

    def count(self, notes: Iterable[tuple[float, Note]]) -> None:
        """Count notes, each with its time [s]; those of a step that is taken again count once."""
        for t, (kind, names, text) in notes:
            made, last = self._made.get((kind, names), (Remark(text, t, 0), -1.0))
            if t > last:
                self._made[kind, names] = replace(made, steps=made.steps + 1), t

    @property
    def all(self) -> tuple[Remark, ...]:
        """Remarks in the order of their times."""
        return tuple(sorted((made for made, _ in self._made.values()), key=lambda one: one.t))
