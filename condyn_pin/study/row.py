"""Row: one solver with its parameters on one set of states, its time beside its error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any, ClassVar, Final

from condyn_pin._core.arguments import renamed
from condyn_pin.study.method import method_named, usual_parameters
from condyn_pin.study.tables import Record

Parameter = float | int | str | bool | None
Key = tuple[str, str, str, str, str]

# What a row with times says of them.
ALONE: Final = "timed alone on its core"

# Answers that are what they say: an inaccurate one says by how much it is.
ANSWERED: Final = {"ok", "inaccurate"}


@dataclass(frozen=True)
class Row(Record):
    """Time and error of one solver with its parameters on one set of states.

    Attributes
    ----------
    scene : str
        Label of the scene.
    rows, nv : int
        Rows of constraints and contacts, and columns.
    method : str
        Title of the solver.
    solver : str
        The solver as text, with every parameter.
    parameters : dict of str to float, int, str, bool or None
        Its parameters by name; None where the solver chooses by itself.
    measure : str
        What the error is one of: a name of `MEASURES`, with the parameters that change the
        question. Rows of the same scene and measure can be compared.
    states : str
        Name of the set of states.
    n : int
        How many states there are in it.
    error_median, error_worst : float
        Over the states, relative: of the accelerations, to the larger of |a|_inf and gravity.
        Infinite where there is no finite answer.
    dynamics_error, constraint_error : float
        Worst residuals [N, N m] and [m/s^2, rad/s^2]; infinite where there is no answer.
    iterations : int
        The most that a state took.
    statuses : dict of str to int
        How many states ended how; "refused" where the solver does not take the scene.
    build_us : float or None
        To build a workspace [us].
    median_us, p95_us : float or None
        What the measure calls, once [us]: for accelerations `Workspace.acceleration`.
    bare_us, solve_us : float or None
        Pinocchio's own call behind it, unguarded, and `Workspace.solve` with its proof [us].
    timed : str
        How the times were taken, or why there are none.
    note : str
        What a refusal said.
    how : dict of str to float, int, str, bool or None
        Parameters of the measure that belong to the answer, such as the step of an integrator.
    """

    unknown: ClassVar[float | None] = inf  # the larger an error, the worse, without end

    scene: str
    rows: int
    nv: int
    method: str
    solver: str
    parameters: dict[str, Parameter]
    measure: str
    states: str
    n: int
    error_median: float
    error_worst: float
    dynamics_error: float  # [N, N m]
    constraint_error: float  # [m/s^2, rad/s^2]
    iterations: int
    statuses: dict[str, int]
    build_us: float | None = None
    median_us: float | None = None
    p95_us: float | None = None
    bare_us: float | None = None
    solve_us: float | None = None
    timed: str = "not timed"
    note: str = ""
    how: dict[str, Parameter] = field(default_factory=dict)

    knobs = renamed("parameters")

    @property
    def key(self) -> Key:
        """What was measured: scene, solver, measure, how and states."""
        return key(self.scene, self.solver, self.measure, self.how, self.states)

    def in_words(self) -> dict[str, Any]:
        """Return the fields as csv has them: parameters as in a call, statuses as counts."""
        words = {"parameters": words_of(self.parameters), "how": words_of(self.how)}
        return super().in_words() | words | {"statuses": self.said}

    @property
    def ok(self) -> bool:
        """Whether every state ended with a status of ok."""
        return set(self.statuses) == {"ok"}

    @property
    def answered(self) -> bool:
        """Whether every state got an answer, with an error that is a number."""
        return bool(self.statuses) and set(self.statuses) <= ANSWERED and isfinite(self.error_worst)

    @property
    def comparable(self) -> bool:
        """Whether there is both a time and an error, at every state."""
        return self.median_us is not None and self.answered

    @property
    def us(self) -> float:
        """The median time of a row that was timed [us]."""
        assert self.median_us is not None
        return self.median_us

    @property
    def short(self) -> str:
        """The solver as one would type it, with what was set, and what `how` says."""
        name = self.solver.split("(")[0]
        kind = method_named(name)
        usual = {} if kind is None else usual_parameters(kind)
        chosen = {k: value for k, value in self.parameters.items() if value != usual.get(k)}
        how = f", {words_of(self.how)}" if self.how else ""
        return f"{name}({words_of(chosen)}){how}"

    @property
    def said(self) -> str:
        """How many states ended how: ``18 ok, 2 singular``."""
        return ", ".join(f"{count} {status}" for status, count in sorted(self.statuses.items()))


def key(scene: str, solver: str, measure: str, how: Mapping[str, Parameter], states: str) -> Key:
    """Return what tells a row from others."""
    return scene, solver, measure, words_of(how), states


def words_of(parameters: Mapping[str, Any]) -> str:
    """Return parameters as they stand in a call."""
    return ", ".join(f"{name}={value!r}" for name, value in parameters.items())


def pareto_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return the rows that no other is faster than with at most the same error, fastest first.

    Rows of different scenes or measures do not compare: hand in those of one.
    """
    kept: list[Row] = []
    timed = (row for row in rows if row.comparable)
    for row in sorted(timed, key=lambda r: (r.us, r.error_worst)):
        if not kept or row.error_worst < kept[-1].error_worst:
            kept.append(row)
    return tuple(kept)
