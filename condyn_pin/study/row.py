"""Row: one solver with its parameters on one set of states, its time beside its error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields
from math import inf, isfinite
from typing import Any, Final

from condyn_pin._core.renamed import renamed
from condyn_pin.errors import InvalidArgument

Parameter = float | int | str | bool | None
Key = tuple[str, str, str, str, str]

# What a row with times says of them.
ALONE = "timed alone on its core"

# Of these, the larger the worse, without end; json has no infinity and says null.
_ERRORS = ("error_median", "error_worst", "dynamics_error", "constraint_error")
_TIMES = ("build_us", "median_us", "p95_us", "bare_us", "solve_us")


@dataclass(frozen=True)
class Row:
    """What one solver with its parameters costs and gives on one set of states.

    Attributes
    ----------
    scene : str
        Label of the scene.
    rows, nv : int
        Constraint rows, and columns.
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

    @property
    def ok(self) -> bool:
        """Whether every state ended with a status of ok."""
        return set(self.statuses) == {"ok"}

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as json has them: an infinite error is None."""
        row = asdict(self)
        return row | {name: row[name] if isfinite(row[name]) else None for name in _ERRORS}

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Row:
        """Return the row that `as_dict` wrote.

        Raises
        ------
        InvalidArgument
            If a field is missing, there is one that rows do not have, or a number is none.
        """
        known = {f.name: f.default is f.default_factory is MISSING for f in fields(cls)}
        needed = {name for name, is_needed in known.items() if is_needed}
        if not isinstance(row, Mapping) or not needed <= set(row) <= set(known):
            odd = sorted(needed - set(row) | set(row) - set(known))
            raise InvalidArgument(f"row: missing, or not a field of a row: {', '.join(odd)}")
        for name in (*_ERRORS, *_TIMES):
            _check_number(name, row.get(name))
        kinds = {f.name: kind for f in fields(cls) if (kind := _KINDS.get(str(f.type)))}
        for name in kinds.keys() & row.keys():
            if type(row[name]) is not kinds[name]:
                raise InvalidArgument(
                    f"row: {name} = {row[name]!r}: {kinds[name].__name__} is needed"
                )
        _check_table("statuses", row["statuses"], (int,))
        for name in ("parameters", "how"):
            _check_table(name, row.get(name, {}), (float, int, str, bool, type(None)))
        return cls(**{**row, **{name: inf if row[name] is None else row[name] for name in _ERRORS}})


_KINDS: Final = {"str": str, "int": int}  # of fields


def _check_table(name: str, value: Any, kinds: tuple[type, ...]) -> None:
    """Refuse what is no table of words and values of some kinds."""
    if not isinstance(value, Mapping) or not all(isinstance(x, kinds) for x in value.values()):
        raise InvalidArgument(f"row: {name} = {value!r}: values by name are needed")


def _check_number(name: str, value: Any) -> None:
    """Refuse an error or a time that is no number from 0, or NaN; None is not known."""
    if value is not None and not (isinstance(value, int | float) and value >= 0):
        raise InvalidArgument(f"row: {name} = {value!r}: a number from 0, or null, is needed")


def key(scene: str, solver: str, measure: str, how: Mapping[str, Parameter], states: str) -> Key:
    """Return what tells a row from others."""
    return scene, solver, measure, ", ".join(f"{k}={v!r}" for k, v in how.items()), states
