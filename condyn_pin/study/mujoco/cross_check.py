"""CrossCheck: what two engines say of one robot at one state, and where their models differ."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class TermCheck:
    """One term in both engines.

    Attributes
    ----------
    term : str
        M, h, passive (springs and damping), a, gap or J.
    error : float
        Relative to the size of the term, light joints counted as heavy ones (`comparing`); of a
        gap, the difference [m, rad].
    where : str
        The joints, or the loop, where it is largest.
    here, there : float or None
        The numbers there, of Pinocchio and of MuJoCo [kg, kg m, kg m^2; N, N m; m/s^2, rad/s^2;
        m, rad]; None of J, whose rows are scaled otherwise in MuJoCo.
    """

    term: str
    error: float
    where: str
    here: float | None
    there: float | None


@dataclass(frozen=True)
class CrossCheck:
    """The terms of both engines at one state, and where their models differ.

    Attributes
    ----------
    robot : str
    terms : tuple of TermCheck
        M, h, springs and damping, a without constraints, and of loops the gap and the rows.
    causes : tuple of str
        Differences of the models, the root first, a sentence each: a body's mass, an armature, a
        place. Also those that do not show at this state.
    notes : tuple of str
        What MuJoCo's model has besides, which was not compared.
    tolerance : float
        Error that counts as none: relative, of gaps [m, rad].
    """

    robot: str
    terms: tuple[TermCheck, ...]
    causes: tuple[str, ...]
    notes: tuple[str, ...]
    tolerance: float

    @property
    def ok(self) -> bool:
        """Whether every term agrees at this state."""
        return all(term.error <= self.tolerance for term in self.terms)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, for json."""
        return asdict(self) | {"ok": self.ok}

    def __str__(self) -> str:
        found = "agree" if self.ok else "differ"
        lines = [f"{self.robot}: Pinocchio and MuJoCo {found}, to {self.tolerance:g}"]
        lines += [f"{'term':<8} {'error':<8} {'here':>14} {'MuJoCo':>14}  where it is largest"]
        for term in self.terms:
            numbers = (f"{'' if x is None else f'{x:.8g}':>14}" for x in (term.here, term.there))
            mark = "  <-" if not term.error <= self.tolerance else ""
            line = f"{term.term:<8} {term.error:<8.1e} {' '.join(numbers)}  {term.where}{mark}"
            lines.append(line.rstrip())
        lines += [f"differs: {cause}" for cause in self.causes]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])
