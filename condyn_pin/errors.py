"""Errors of the library, one class for each cause.

Every error that the library raises is a `CondynError`. Its text names the argument or the file, the
value that was found, and what would do instead. Errors that answer a failed solve or
assembly carry the `Solution` or the `Assembly`, so nothing that was computed is lost. What they
carry is of rooms above this one: it is handed on, and not looked at.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any
from unicodedata import category

__all__ = [
    "BranchChanged",
    "BrokenPinocchio",
    "BrowserFailed",
    "CondynError",
    "DerivativesDisagree",
    "Infeasible",
    "Interrupted",
    "InvalidArgument",
    "InvalidConstraint",
    "InvalidModel",
    "MissingExtra",
    "NotAssembled",
    "NotReached",
    "NotRecorded",
    "NotTuned",
    "SharedWorkspace",
    "SolveFailed",
    "StaleModel",
    "StepFailed",
    "TargetsNotReached",
    "UnknownName",
    "UnmodelledWarning",
    "UnsupportedBackend",
    "UnsupportedConstraint",
    "WorkersLost",
]


def printable(text: str) -> str:
    r"""Return a text with its unprintable characters escaped as ``\x1b``.

    Names come from files, and a terminal obeys what it is sent.
    """
    if text.isprintable():
        return text
    return "".join(
        each
        if each.isprintable() or each == "\n" or category(each) == "Zs"  # any space
        else each.encode("unicode_escape").decode()
        for each in text
    )


class CondynError(Exception):
    """Root of every error of this library."""

    def __str__(self) -> str:
        return printable(super().__str__())


class BrokenPinocchio(CondynError, ImportError):
    """Pinocchio is missing, or its wheels do not fit together."""


class UnsupportedBackend(CondynError):
    """The installed Pinocchio, or the compiled core, lacks the requested feature."""


class MissingExtra(CondynError, ImportError):
    """An optional dependency is not installed."""

    def __str__(self) -> str:  # ImportError keeps its first text, whatever is added to args
        return printable(str(self.args[0]))


class BrowserFailed(CondynError, RuntimeError):
    """The browser failed to draw a picture."""


class InvalidArgument(CondynError, ValueError):
    """An argument has a wrong size, a wrong type or a value that cannot be used."""


class UnknownName(CondynError, KeyError):
    """No robot, frame, joint, posture or constraint has this name."""

    def __str__(self) -> str:
        return printable(str(self.args[0]))


class InvalidModel(CondynError, ValueError):
    """A robot description cannot be read, or its model cannot be used for dynamics."""


class InvalidConstraint(CondynError, ValueError):
    """A constraint does not fit the robot, or two constraints share a name."""


class UnsupportedConstraint(CondynError):
    """A solver does not accept a kind of constraint; the text names one that does."""


class StaleModel(CondynError):
    """A model, or the raw objects of a workspace, were edited behind the library's back."""


class SharedWorkspace(CondynError, RuntimeError):
    """Two threads use one workspace; the text says what to do."""


class NotAssembled(CondynError):
    """A loop is open, and could not be closed or should not be.

    Attributes
    ----------
    assembly : Assembly or None
        The configuration with the smallest gap that was found, where one was looked for.
    """

    def __init__(self, message: str, assembly: Any = None) -> None:
        super().__init__(message)
        self.assembly = assembly

    def __reduce__(self) -> tuple[type[NotAssembled], tuple[str, Any]]:
        return type(self), (str(self), self.assembly)


class BranchChanged(NotAssembled):
    """The loops were closed, but on the other side of a dead point.

    Attributes
    ----------
    assembly : Assembly
        The configuration, closed, on the other branch.
    """

    def __init__(self, message: str, assembly: Any) -> None:
        super().__init__(message, assembly)


class TargetsNotReached(CondynError):
    """No configuration with closed loops nearby meets the targets of an inverse kinematics.

    Attributes
    ----------
    answer : InverseKinematics
        The configuration that comes nearest, with the errors of each target.
    """

    def __init__(self, message: str, answer: Any) -> None:
        super().__init__(message)
        self.answer = answer

    def __reduce__(self) -> tuple[type[TargetsNotReached], tuple[str, Any]]:
        return type(self), (str(self), self.answer)


class Infeasible(CondynError, ArithmeticError):
    """No forces satisfy the demands; the text names the rows that contradict each other."""


class DerivativesDisagree(CondynError, ArithmeticError):
    """Derivatives differ from central differences; the text names the worst entry."""


class SolveFailed(CondynError):
    """A solve ended with a status other than ok.

    Attributes
    ----------
    solution : Solution
        What was computed, with its errors and its status.
    """

    def __init__(self, message: str, solution: Any) -> None:
        super().__init__(message)
        self.solution = solution

    def __reduce__(self) -> tuple[type[SolveFailed], tuple[str, Any]]:
        return SolveFailed, (str(self), self.solution)


class NotReached(CondynError):
    """No measured solver meets the requested error.

    Attributes
    ----------
    row : Row or None
        The row with the smallest error; None if no solver answers every state.
    """

    def __init__(self, message: str, row: Any = None) -> None:
        super().__init__(message)
        self.row = row

    def __reduce__(self) -> tuple[type[NotReached], tuple[str, Any]]:
        return NotReached, (str(self), self.row)


class NotTuned(CondynError):
    """No plan was saved for this scene, error, machine and versions; `tune` makes one."""


class WorkersLost(CondynError, RuntimeError):
    """Worker processes died, and their executor cannot go on.

    Attributes
    ----------
    done : BatchSolution, BatchDerivatives, BatchTrajectory, Table, list of Outcome, or None
        What was computed, of a batch, a study or a stress test; the `missing` of a batch says which
        rows were not.
    """

    def __init__(self, message: str, done: Any = None) -> None:
        super().__init__(message)
        self.done = done

    def __reduce__(self) -> tuple[type[WorkersLost], tuple[str, Any]]:
        return WorkersLost, (str(self), self.done)


class NotRecorded(CondynError):
    """A batch has no samples of a motion; the text says why."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C in a long run: not an error of this library, so not a `CondynError`.

    Attributes
    ----------
    table
        What was measured until then, as the run would have returned it: of `Study.run` a `Table`,
        of `simulate_batch` a `BatchTrajectory`.
    """

    def __init__(self, table: Any) -> None:
        super().__init__("interrupted; what was measured until then is in its `table`")
        self.table = table

    def __reduce__(self) -> tuple[type[Interrupted], tuple[Any]]:
        return Interrupted, (self.table,)


class StepFailed(CondynError):
    """A step of an integrator did not converge; the text says what to do."""


class UnmodelledWarning(UserWarning):
    """A file has what changes the motion, and is not in the model: `Robot.unmodelled` lists it."""


def unknown_name(kind: str, name: str, known: Iterable[str]) -> UnknownName:
    """Error for a name that does not exist, with the nearest names that do."""
    known = list(known)
    near = get_close_matches(name, known, n=4, cutoff=0.6) or _with_part(name, known)[:4]
    if near:
        hint = "did you mean " + " or ".join(repr(n) for n in near) + "?"
    elif len(known) <= 30:
        hint = "known: " + (", ".join(known) or "none")
    else:
        hint = f"known: {', '.join(known[:30])}, and {len(known) - 30} more"
    return UnknownName(f"no {kind} named {name!r}; {hint}")


def _with_part(name: str, known: list[str]) -> list[str]:
    """Names that contain a name of two letters or more."""
    return [each for each in known if len(name) > 1 and name.lower() in each.lower()]
