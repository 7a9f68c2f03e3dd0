"""Arrays: their checks, values that act as arrays, and floating-point errors.

Arrays of numbers: their type, and how they come in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextvars import Context
from dataclasses import is_dataclass
from functools import partial
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import ArrayLike, NDArray

from condyn_pin.errors import InvalidArgument

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
T = TypeVar("T")

# What makes arrays of values by joint, of the name of a posture, and of q and v.
_MADE_BY: Final = (
    dict.fromkeys(
        ("q", "start"), "robot.configuration({joint: value}) makes one, robot.postures[name] is one"
    )
    | dict.fromkeys(("v", "a", "tau"), "robot.joint_vector({joint: value}) makes one")
    | {"x": "np.concatenate([q, v]) makes one"}
)

_SHOWN: Final = 200  # characters of a value in an error


def read_only(value: T) -> T:
    """Return a value with every array in it made read-only."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, tuple):
        for each in value:
            read_only(each)
    elif is_dataclass(value):
        read_only(tuple(vars(value).values()))
    return value


def entries(places: NDArray[np.int_]) -> NDArray[np.int_] | slice:
    """Indices into an array, as a slice if they are consecutive: numpy then copies nothing."""
    if len(places) and (np.diff(places) == 1).all():
        return slice(int(places[0]), int(places[-1]) + 1)
    return places


def diagonal_of(matrix: Array) -> Array:
    """Diagonal of a contiguous matrix (n, n), as a writable view."""
    return matrix.ravel("K")[:: len(matrix) + 1]


def read_only_view(array: Array) -> Array:
    """Read-only view of an array."""
    view = array.view()
    view.flags.writeable = False
    return view


def check_overflow(name: str, value: Array, *results: Array) -> None:
    """Raise InvalidArgument if numbers computed from a finite argument overflow."""
    if not all(np.isfinite(each).all() for each in results):
        raise InvalidArgument(
            f"{name} has numbers up to {np.abs(value).max():.3g}: what is computed from it "
            "overflows; smaller numbers are needed"
        )


def finite(name: str, value: ArrayLike, shape: int | tuple[int, ...]) -> Array:
    """Float array of a user's numbers, checked for size and finiteness."""
    # The text names the argument, the entry and its value, and what would do.
    wanted = (shape,) if isinstance(shape, int) else shape
    if type(value) is np.ndarray and value.dtype == np.float64 and value.shape == wanted:
        plain: Array = value
        if np.isfinite(plain).all():
            return plain  # without the questions below
    needed = f"an array of shape {wanted}" if wanted else "one finite number"
    found = name if wanted else f"{name} = {text_of(value)}"
    made = _MADE_BY.get(name.partition("(")[0]) if len(wanted) == 1 else None  # also tau(t, q, v)
    if made and isinstance(value, str | Mapping):
        raise InvalidArgument(f"{name}: {needed} is needed, not {text_of(value)}; {made}")
    cure = f"; {made}" if made else ""
    try:
        array = np.asarray(value)
        several = value if isinstance(value, (list, tuple)) else ()  # where numpy makes 1 and 0
        if array.dtype.kind == "b" or any(isinstance(x, (bool, np.bool_)) for x in several):
            raise TypeError("numbers, not True or False")
        if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
            raise TypeError("some of them are masked; .filled(...) says what they are")
        if array.dtype.kind == "c":
            raise TypeError("they are complex")
        if array.dtype.kind == "O" and any(each is None for each in array.flat):
            raise TypeError("numbers, not None")
        is_text = array.dtype.kind in "SU"
        array = array.astype(np.float64, copy=False)
        if is_text:
            raise TypeError("numbers, not text")
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidArgument(f"{found}: {needed} is needed ({error}){cure}") from error
    if array.shape != wanted:
        raise InvalidArgument(f"{found} has shape {array.shape}: {needed} is needed{cure}")
    if not np.isfinite(array).all():
        bad = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        entry = str(list(bad)) if bad else ""
        raise InvalidArgument(f"{name}{entry} = {array[bad]}: finite numbers are needed")
    return array


def text_of(value: object) -> str:
    """Text of a value for error messages, shortened."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an int of thousands of digits; lists without an end
        return f"a {type(value).__name__} that cannot be shown"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


_ROUNDING: Final = 1e-8  # numbers that are all smaller are printed as zeros


def rounded(values: ArrayLike, *, decimals: int = 4, width: int = 88) -> str:
    """Text of numbers, rounded to four decimals, or to four digits of the largest; no -0."""
    x = np.asarray(values, dtype=float)
    largest = float(np.abs(x, where=np.isfinite(x), out=np.zeros_like(x)).max(initial=0.0))
    if _ROUNDING < largest < 0.1:
        decimals = max(decimals, 3 - int(np.floor(np.log10(largest))))
    whole = np.round(x, decimals) + 0.0
    return np.array2string(whole, precision=decimals, suppress_small=True, max_line_width=width)


def in_column(values: Mapping[str, float]) -> list[tuple[str, str]]:
    """Names and numbers as a column, to four decimals and aligned at the point; no -0."""
    return [(name, f"{round(float(x), 4) + 0.0:10.4f}") for name, x in values.items()]


def finite_rows(name: str, value: ArrayLike, size: int) -> Array:
    """Float array of one row of numbers or many, (..., size), checked as by `finite`."""
    try:
        many = np.shape(value)[:-1]
    except ValueError:  # of lists that differ in length, which `finite` refuses
        many = ()
    return finite(name, value, (*many, size))


# AsArray: a value that works as the array of its components.


class ArrayValue(NDArrayOperatorsMixin):
    """Value with `components` that NumPy accepts in place of an array."""

    components: Array

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        array = self.components if dtype is None else self.components.astype(dtype)
        return array.copy() if copy else array

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        plain = [x.components if isinstance(x, ArrayValue) else x for x in inputs]
        return getattr(ufunc, method)(*plain, **options)

    def __len__(self) -> int:
        return len(self.components)

    def __getitem__(self, index: Any) -> Any:
        return self.components[index]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the components."""
        return self.components.shape

    @property
    def size(self) -> int:
        """Number of components."""
        return self.components.size

    def copy(self) -> Array:
        """Copy of the components."""
        return self.components.copy()

    def tolist(self) -> list[float]:
        """Components as a list."""
        return [float(x) for x in self.components]

    def round(self, decimals: int = 0) -> Array:
        """Components rounded to some `decimals`."""
        return self.components.round(decimals)


# Call a function where numpy does not warn of what overflows; `errstate` costs ten times more.


_Arguments = ParamSpec("_Arguments")
_Answer = TypeVar("_Answer")


def ignore_float_errors(function: Callable[_Arguments, _Answer]) -> Callable[_Arguments, _Answer]:
    """Decorate `function` to run without numpy's warnings: the status of a solution reports them.

    numpy keeps its settings in the context of Python. `np.errstate` changes them before a call and
    back after it, half a microsecond in a solve that takes ten; here they are those of a context
    that the function is always called in. Not to be called by two threads, nor by itself.
    """
    silent = Context()
    silent.run(np.seterr, over="ignore", invalid="ignore")
    return partial(silent.run, function)
