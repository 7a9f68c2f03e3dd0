"""What parameters may be, and the sentences that say so."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core.arrays import finite, shown
from condyn_pin._core.tolerances import FINEST
from condyn_pin.errors import InvalidArgument

_MOST_REFINEMENTS = 100
# Values that are worth a look in a study: a solver declares which of its parameters take which.
WEIGHTS: Final = tuple(float(f"1e{k}") for k in range(-12, 1))  # [1/kg]
ITERATIONS: Final = (1, 2, 3, 5, 10, 20, 50, 100)
ACCURACIES: Final = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
Grid = dict[str, tuple[Any, ...]]

# Steps whose squares are numbers [s].
_SHORTEST, _LONGEST = 1e-150, 1e150

_LONGEST_CALL = 1000  # characters
_MOST_ITERATIONS = 2**31 - 1  # Pinocchio counts in a C int


def check_damping(mu: float) -> None:
    """Refuse a damping that cannot be used."""
    if finite("mu", mu, ()) < 0:
        raise InvalidArgument(f"mu = {shown(mu)}: a number >= 0 [1/kg] is needed")


def check_proximal(mu: float | str | None, max_iterations: int, *, smallest_mu: float) -> None:
    """Refuse a proximal weight or an iteration limit that cannot be used."""
    if mu is not None and not finite("mu", mu, ()) >= smallest_mu:
        limit = ">= 0" if smallest_mu == 0 else f">= {smallest_mu:g}"
        raise InvalidArgument(f"mu = {shown(mu)}: a finite number {limit} [1/kg] is needed")
    check_iterations(max_iterations)


def check_iterations(max_iterations: int) -> None:
    """Refuse an iteration limit that cannot be used."""
    if not is_whole(max_iterations) or not 1 <= max_iterations <= _MOST_ITERATIONS:
        raise InvalidArgument(
            f"max_iterations = {shown(max_iterations)}: a whole number from 1 to "
            f"{_MOST_ITERATIONS} is needed (with 0 Pinocchio returns a wrong answer and no warning)"
        )


def check_refinements(refinements: int) -> None:
    """Refuse a number of corrections that cannot be used."""
    if not is_whole(refinements) or not 0 <= refinements <= _MOST_REFINEMENTS:
        raise InvalidArgument(
            f"refinements = {shown(refinements)}: a whole number from 0 to {_MOST_REFINEMENTS}; "
            "two reach what doubles can"
        )


def check_flag(name: str, value: object) -> None:
    """Refuse what is neither True nor False, of Python or of numpy."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidArgument(f"{name} = {shown(value)}: True or False is needed")


def is_whole(value: object) -> bool:
    """Whether a value is a whole number, of Python or of numpy; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def check_count(name: str, value: int, *, least: int = 1, most: int | None = None) -> None:
    """Refuse what is not a whole number that is large enough, and not too large."""
    if most is not None and is_whole(value) and value > most:
        raise InvalidArgument(f"{name} = {shown(value)}: {most} is the largest")
    if not is_whole(value) or value < least:
        raise InvalidArgument(
            f"{name} = {shown(value)}: a whole number of at least {least} is needed"
        )


def check_accuracy(name: str, value: float) -> None:
    """Refuse an accuracy that cannot be used."""
    if finite(name, value, ()) < 0:
        raise InvalidArgument(f"{name} = {shown(value)}: a number >= 0 is needed")


def check_accuracy_of_a(accuracy: float) -> float:
    """Return an accuracy; refuse one that doubles cannot have."""
    if finite("accuracy", accuracy, ()) < FINEST:
        raise InvalidArgument(f"accuracy = {accuracy!r}: a number of at least {FINEST:g} is needed")
    return accuracy


def check_share(name: str, value: float) -> None:
    """Refuse what is not between 0 and 1, both excluded."""
    if not 0 < finite(name, value, ()) < 1:
        raise InvalidArgument(f"{name} = {shown(value)}: between 0 and 1")


def seconds(name: str, value: float) -> float:
    """Return a time that a user handed in [s]; InvalidArgument if it is not above zero."""
    if not finite(name, value, ()) > 0:
        raise InvalidArgument(f"{name} = {value!r}: a number > 0 [s] is needed")
    return float(value)  # of numpy it may have fewer digits


def step_size(dt: float) -> float:
    """Return a time step [s]; InvalidArgument if its square is no number."""
    dt = seconds("dt", dt)
    if not _SHORTEST <= dt <= _LONGEST:
        raise InvalidArgument(
            f"dt = {dt:g}: its square under- or overflows; a step between {_SHORTEST:g} and "
            f"{_LONGEST:g} s is needed"
        )
    return dt


def check_called(name: str, function: object, words: str) -> None:
    """Refuse what cannot be called with these arguments.

    Parameters
    ----------
    name : str
        What errors call it.
    function : callable
    words : str
        The arguments as one would write them: ``t, q, v``.
    """
    if not callable(function):
        raise InvalidArgument(f"{name} = {shown(function)}: a function of ({words}) is needed")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # some functions of C do not tell
        return
    try:
        signature.bind(*words.split(", "))
    except TypeError as error:
        raise InvalidArgument(
            f"{name} takes {signature}: it is called with ({words}), so {error}"
        ) from error
    wanted = words.split(", ")
    for word, own in zip(wanted, signature.parameters, strict=False):
        if own != word and own in wanted:
            raise InvalidArgument(
                f"{name} takes {signature}: it is called with ({words}), in this order"
            )


class Call(NamedTuple):
    """A value as its repr has it: a name, and parameters, which may be such values themselves."""

    name: str
    parameters: dict[str, Any]

    def made(self, kinds: Mapping[str, Callable[..., Any]]) -> Any:
        """Return the value, of classes by their names in small letters.

        Raises
        ------
        KeyError
            If there is no class of a name.
        """
        return kinds[self.name.lower()](**self.parameters_made(kinds))

    def parameters_made(self, kinds: Mapping[str, Callable[..., Any]]) -> dict[str, Any]:
        """Return the parameters, those that are values themselves made."""
        given = self.parameters.items()
        return {key: x.made(kinds) if isinstance(x, Call) else x for key, x in given}


def read_call(text: str) -> Call:
    """Return what is in ``Name(parameter=value)``, or in a bare name.

    A value is plain, or again a call: ``Moreau(contact=ADMM(tolerance=1e-06))``.

    Raises
    ------
    ValueError
        If it is neither.
    """
    if len(text) > _LONGEST_CALL:
        raise ValueError("a text of this length")
    try:
        node = ast.parse(text, mode="eval").body
    except SyntaxError as error:
        raise ValueError(text) from error
    found = Call(node.id, {}) if isinstance(node, ast.Name) else _value(node)
    if not isinstance(found, Call):
        raise ValueError(text)
    return found


def _value(node: ast.expr) -> Any:
    """Return a plain value, or a call with parameters that all have names."""
    if not isinstance(node, ast.Call):
        return ast.literal_eval(node)
    if not isinstance(node.func, ast.Name) or node.args:
        raise ValueError(ast.unparse(node))
    return Call(node.func.id, {str(word.arg): _value(word.value) for word in node.keywords})
