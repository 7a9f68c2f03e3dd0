"""Arguments of users: checks, names, parameters, registries and their errors.

What users hand in: sizes, finiteness, unit quaternions.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import partial
from importlib import import_module
from math import hypot
from struct import Struct
from typing import Any, Final, NamedTuple, TypeVar
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite, text_of
from condyn_pin._core.tolerances import FINEST
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name

Given = tuple[ArrayLike, ArrayLike, ArrayLike]  # q, v and tau as they are handed in
State = tuple[Array, Array, Array]  # and as they are accepted

# Limits of the squared norm of a unit part of q.
LOW: Final = 1.0 - 2 * tolerances.QUATERNION
HIGH: Final = 1.0 + 2 * tolerances.QUATERNION

# | |quaternion| - 1 | from which on a quaternion is normalised before it is used. Accelerations of
# light bodies are off by hundreds of times as much; float32 leaves 1e-8, integration 1e-16.
QUATERNION_TOLERANCE: Final = 1e-12
NOT_LOOSE: Final = (1.0 - 2 * QUATERNION_TOLERANCE, 1.0 + 2 * QUATERNION_TOLERANCE)

# | |quaternion| - 1 | that normalising a quaternion leaves.
NORMALISED: Final = 4 * float(np.finfo(float).eps)

# The one dtype that goes to Pinocchio as it is: 64 bits in the byte order of this machine. An array
# that was pickled comes back with another object for it: compare with ==, never with `is`.
FLOAT: Final = np.dtype(np.float64)

# Reads a quaternion out of a contiguous q twice as fast as a slice does; ValueError otherwise.
unpack_quaternion: Final[Callable[[Any, int], tuple[float, ...]]] = Struct("4d").unpack_from

# Where the unit part of a joint's configuration begins, and its size.
_UNIT_PARTS = {
    "JointModelFreeFlyer": (3, 4),
    "JointModelSpherical": (0, 4),
    "JointModelPlanar": (2, 2),
    "JointModelRUBX": (0, 2),
    "JointModelRUBY": (0, 2),
    "JointModelRUBZ": (0, 2),
    "JointModelRevoluteUnboundedUnaligned": (0, 2),
}


class Arguments:
    """The check of (q, v, tau) for one model."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._shapes = ((model.nq,), (model.nv,), (model.nv,))
        self.units = _unit_parts(model)  # where q holds either
        # where q holds quaternions [bytes from its start]
        self.quaternions = tuple(
            FLOAT.itemsize * part.start for part in self.units if part.stop - part.start == 4
        )
        # where q holds (cos, sin)
        self.pairs = tuple(part for part in self.units if part.stop - part.start == 2)
        on_world = [*zip(model.idx_vs, model.parents, strict=True)][1:]  # but for the world itself
        # where v begins for each joint on the world: what is not finite in the input shows there
        self.roots = tuple(int(v) for v, parent in on_world if parent == 0 and v >= 0)

    def check_pairs(self, q: Array) -> None:
        """Raise ValueError if a (cos, sin) of q is not a unit vector."""
        for part in self.pairs:
            cos, sin = q[part].tolist()
            if not LOW < cos * cos + sin * sin < HIGH:
                raise ValueError

    def accept(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> State:
        """Return the arguments as float arrays of the right size, or raise InvalidArgument."""
        # Arrays that are right already pass in half a microsecond, without a look at their
        # finiteness: what is not finite shows in the answer, and `check` then finds it.
        if (
            type(q) is np.ndarray
            and type(v) is np.ndarray
            and type(tau) is np.ndarray
            and self._shapes == (q.shape, v.shape, tau.shape)
            and q.dtype == v.dtype == tau.dtype == FLOAT
            and q.flags.c_contiguous
            and not self.pairs
        ):
            for offset in self.quaternions:
                x, y, z, w = unpack_quaternion(q, offset)
                if not LOW < x * x + y * y + z * z + w * w < HIGH:
                    break
            else:
                return q, v, tau
        return self.check(q, v, tau)

    def check(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> State:
        """Return the arguments converted; InvalidArgument names entry, value and cure."""
        (nq,), (nv,), _ = self._shapes
        q_ = finite("q", q, nq)
        self._check_units("q", q_)
        return q_, finite("v", v, nv), joint_torques("tau", tau, nv)

    def configuration(self, name: str, q: ArrayLike) -> Array:
        """Configuration q (nq,) of a user's state, normalised to rounding."""
        # InvalidArgument if its quaternions are further from norm 1 than `check` allows.
        array = np.array(finite(name, q, self._model.nq))
        if pin.isNormalized(self._model, array, NORMALISED):
            return array
        self._check_units(name, array)
        return np.array(pin.normalize(self._model, array))

    def _check_units(self, name: str, q: Array) -> None:
        for part in self.units:
            x = q[part]
            norm = hypot(*x)
            if not LOW < norm * norm < HIGH:
                raise not_of_norm_one(name, f"{part.start}:{part.stop}", x, norm)


def not_of_norm_one(name: str, at: str, x: Array, norm: float, row: str = "") -> InvalidArgument:
    """Error for a quaternion, or a (cos, sin), of a state that is not of norm one."""
    index = f"{row}, {at}" if row else at
    of = f"{name}[{row}]" if row else name
    return InvalidArgument(
        f"{name}[{index}] = {x} has norm {norm:.9g}: a unit quaternion (x y z w) or (cos, sin) is "
        f"needed; pin.normalize(robot.model, {of}) makes one"
    )


def joint_torques(name: str, tau: ArrayLike, nv: int) -> Array:
    """Torques (nv,) of a user; the plain number 0 stands for none."""
    return finite(name, np.zeros(nv) if is_none(tau) else tau, nv)


def is_none(tau: object) -> bool:
    """True if the torques of a user are the plain number 0, which stands for none."""
    return isinstance(tau, int | float) and not isinstance(tau, bool) and tau == 0


def normalised(model: Any, name: str, q: ArrayLike) -> Array:
    """Configuration of a user, a guess or a posture, its quaternions normalised."""
    # One that is normalised already is returned as it is, digit by digit: pin.normalize would move
    # the last bits of it again and again.
    array = np.array(finite(name, q, model.nq))
    if pin.isNormalized(model, array, NORMALISED):
        return array
    array = np.array(pin.normalize(model, array))
    if not pin.isNormalized(model, array, tolerances.QUATERNION):
        raise InvalidArgument(f"{name}: a quaternion of it is zero; use 0 0 0 1")
    return array


def _unit_parts(model: Any) -> tuple[slice, ...]:
    """Slices of q with quaternions and (cos, sin) pairs, which have norm one."""
    parts = []
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.idx_q < 0 or joint.nq == joint.nv:  # the world, or a plain joint
            continue
        if joint.shortname() not in _UNIT_PARTS:
            raise InvalidModel(
                f"joint {name!r} is a {joint.shortname()} whose configuration cannot be checked; "
                "split it into joints that Pinocchio has by themselves"
            )
        start, size = _UNIT_PARTS[joint.shortname()]
        parts.append(slice(joint.idx_q + start, joint.idx_q + start + size))
    return tuple(parts)


# Lists of names: as users hand them in, and as sentences show them.


_NAMES_SHOWN = 8


def checked_names(argument: str, names: Any, known: Sequence[str], what: str) -> tuple[str, ...]:
    """List of names, each of which exists and occurs once."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InvalidArgument(f"{argument} = {names!r}: a list of names is needed")
    found = []
    for name in names:
        if not isinstance(name, str):
            raise InvalidArgument(f"{argument}: {name!r} is not the name of a {what}")
        if name not in known:
            raise unknown_name(what, name, known)
        found.append(name)
    return tuple(dict.fromkeys(found))


def listed(names: Sequence[str]) -> str:
    """Names joined for a sentence, the first few of many."""
    more = len(names) - _NAMES_SHOWN
    return ", ".join(names[:_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def short_list(names: Sequence[str]) -> str:
    """Names of up to four joints, or the number of joints."""
    return ", ".join(names) if len(names) <= 4 else f"{len(names)} joints"


def quoted_names(names: Iterable[str]) -> str:
    """Names in quotes, for error messages."""
    return ", ".join(repr(name) for name in names)


def count_text(number: int, thing: str) -> str:
    """Number and noun of things: 1 loop, 2 loops."""
    return f"{number} {thing}{'s' * (number != 1)}"


def short_repr(value: Any) -> str:
    """Repr of a dataclass with those parameters that are not at their defaults."""
    parameters = (
        f"{f.name}={x!r}" for f in fields(value) if (x := getattr(value, f.name)) != f.default
    )
    return f"{type(value).__name__}({', '.join(parameters)})"


# What parameters may be, and their sentences in errors.


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
    """Raise InvalidArgument unless a damping is usable."""
    if finite("mu", mu, ()) < 0:
        raise InvalidArgument(f"mu = {text_of(mu)}: a number >= 0 [1/kg] is needed")


def check_proximal(mu: float | str | None, max_iterations: int, *, smallest_mu: float) -> None:
    """Raise InvalidArgument unless a proximal weight and an iteration limit are usable."""
    if mu is not None and not finite("mu", mu, ()) >= smallest_mu:
        limit = ">= 0" if smallest_mu == 0 else f">= {smallest_mu:g}"
        raise InvalidArgument(f"mu = {text_of(mu)}: a finite number {limit} [1/kg] is needed")
    check_iterations(max_iterations)


def check_iterations(max_iterations: int) -> None:
    """Raise InvalidArgument unless an iteration limit is usable."""
    if not is_whole(max_iterations) or not 1 <= max_iterations <= _MOST_ITERATIONS:
        raise InvalidArgument(
            f"max_iterations = {text_of(max_iterations)}: a whole number from 1 to "
            f"{_MOST_ITERATIONS} is needed (with 0 Pinocchio returns a wrong answer and no warning)"
        )


def check_refinements(refinements: int) -> None:
    """Raise InvalidArgument unless a number of corrections is usable."""
    if not is_whole(refinements) or not 0 <= refinements <= _MOST_REFINEMENTS:
        raise InvalidArgument(
            f"refinements = {text_of(refinements)}: a whole number from 0 to {_MOST_REFINEMENTS}; "
            "two reach what doubles can"
        )


def check_type(name: str, value: object, kind: Any, needed: str) -> None:
    """Raise InvalidArgument unless a value is of a kind; `needed` says which one is, as text."""
    if not isinstance(value, kind):
        raise InvalidArgument(f"{name} = {text_of(value)}: {needed}")


def check_flag(name: str, value: object) -> None:
    """Raise InvalidArgument unless a value is True or False, of Python or of numpy."""
    check_type(name, value, bool | np.bool_, "True or False is needed")


def is_whole(value: object) -> bool:
    """True if a value is a whole number of Python or of numpy; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def check_count(name: str, value: int, *, least: int = 1, most: int | None = None) -> None:
    """Raise InvalidArgument unless a value is a whole number within its bounds."""
    if most is not None and is_whole(value) and value > most:
        raise InvalidArgument(f"{name} = {text_of(value)}: {most} is the largest")
    if not is_whole(value) or value < least:
        raise InvalidArgument(
            f"{name} = {text_of(value)}: a whole number of at least {least} is needed"
        )


def check_accuracy(name: str, value: float) -> None:
    """Raise InvalidArgument unless an accuracy is usable."""
    if finite(name, value, ()) < 0:
        raise InvalidArgument(f"{name} = {text_of(value)}: a number >= 0 is needed")


def check_accuracy_of_a(accuracy: float) -> float:
    """Return an accuracy; refuse one that doubles cannot have."""
    if finite("accuracy", accuracy, ()) < FINEST:
        raise InvalidArgument(f"accuracy = {accuracy!r}: a number of at least {FINEST:g} is needed")
    return accuracy


def check_share(name: str, value: float) -> None:
    """Raise InvalidArgument unless a number is between 0 and 1, both excluded."""
    if not 0 < finite(name, value, ()) < 1:
        raise InvalidArgument(f"{name} = {text_of(value)}: between 0 and 1")


def seconds(name: str, value: float) -> float:
    """Positive time of a user [s]; InvalidArgument if it is not above zero."""
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
    """Raise InvalidArgument unless a value can be called with arguments, `words` "t, q, v"."""
    if not callable(function):
        raise InvalidArgument(f"{name} = {text_of(function)}: a function of ({words}) is needed")
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
        """Return the value, of classes by their names in small letters, or KeyError."""
        return kinds[self.name.lower()](**self.parameters_made(kinds))

    def parameters_made(self, kinds: Mapping[str, Callable[..., Any]]) -> dict[str, Any]:
        """Return the parameters, those that are values themselves made."""
        given = self.parameters.items()
        return {key: x.made(kinds) if isinstance(x, Call) else x for key, x in given}


def read_call(text: str) -> Call:
    """Parse a call, ``Name(parameter=value)``, or a bare name; ValueError if it is neither."""
    # A value is plain, or again a call: ``Moreau(contact=ADMM(tolerance=1e-06))``.
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


# Registries: what registers itself under a name, once.


_Entry = TypeVar("_Entry")


def register(registry: dict[str, _Entry], name: str, entry: _Entry, what: str) -> None:
    """Add an entry to a registry; InvalidArgument says that `what` exists if its name is taken."""
    if name in registry:
        raise InvalidArgument(f"{what} exists: choose another name")
    registry[name] = entry


# What a member of a class was called in the last version: it warns, and forwards.


class renamed:  # noqa: N801  used as a function is
    """Forward a member to its name of today, for one version.

    now: what it is called now: another member, or a function of the object with the room that has
        it, ``mechanism.keep``
    called: that a function is called, since the member was no method
    """

    def __init__(self, now: str, *, called: bool = False) -> None:
        self._room, _, self._now = now.rpartition(".")
        self._called = called

    def __set_name__(self, owner: type, name: str) -> None:
        place = self._room or owner.__name__
        self._text = f"{owner.__name__}.{name} is {place}.{self._now} now"

    def __get__(self, instance: Any, owner: type) -> Any:
        """Member under its new name; the descriptor itself on the class."""
        if instance is None:
            return self
        warn(self._text, DeprecationWarning, stacklevel=2)
        if not self._room:
            return getattr(instance, self._now)
        function = getattr(import_module(f"condyn_pin.{self._room}"), self._now)
        return function(instance) if self._called else partial(function, instance)
