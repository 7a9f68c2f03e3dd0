"""Files: atomic writes, and reads of limited size.

Files written beside their place, and put there once they are whole.

A disk that fills up, a bug or Ctrl-C in the middle of writing leaves the old file as it was. What a
writer that was killed has left beside it goes with the next one: nobody holds its lock.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import stat
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import prod
from os import PathLike
from pathlib import Path
from typing import Any, Final
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray

from condyn_pin.errors import InvalidArgument, printable

try:
    import fcntl
except ImportError:  # Windows, where a file that is open stays
    fcntl = None  # type: ignore[assignment]

_MARK = ".condyn-"  # of all files that are being written


@contextmanager
def atomic_write(path: str | PathLike[str]) -> Iterator[Path]:
    """Yield the path of a temporary file in the same folder, renamed to `path` at the end."""
    # A file that was there keeps its permissions, a link stays a link. What is no file, such as
    # /dev/stdout, is written to as it is. InvalidArgument if that fails: then all is as it was.
    target = _target(path)
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            yield target
            return
        new, lock = _new_file(target, Path(path).suffix)
        try:
            yield new
            new.replace(target)
        except BaseException:
            new.unlink(missing_ok=True)
            raise
        finally:
            _release(lock)
    except OSError as error:
        raise _not_written(path, error) from error


def check_format(path: str | PathLike[str], *endings: str) -> None:
    """Raise InvalidArgument if the suffix of a file is that of another format."""
    ending = Path(path).suffix
    if ending and ending.lower() not in endings:
        raise InvalidArgument(
            f"{path}: its name says {ending[1:]}, and what is written is {endings[0][1:]}; name it "
            f"{Path(path).with_suffix(endings[0])}"
        )


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a text as UTF-8; see `atomic_write`."""
    with atomic_write(path) as new:
        new.write_text(text, encoding="utf-8")


def check_writable(path: str | PathLike[str]) -> None:
    """Raise InvalidArgument if a file could not be written; no file is left behind."""
    target = _target(path)
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            target.open("ab").close()
        else:
            new, lock = _new_file(target, "")
            new.unlink()
            _release(lock)
    except OSError as error:
        raise _not_written(path, error) from error


def _target(path: str | PathLike[str]) -> Path:
    """Target file of a path, its links resolved."""
    try:
        return Path(os.path.realpath(path))
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"path = {path!r}: the name of a file is needed ({error})") from error


def _new_file(target: Path, suffix: str) -> tuple[Path, int | None]:
    """Return an empty file beside another one, and its lock, which `_release` gives back."""
    # With the permissions that the other one has or gets.
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    mode = None
    if target.exists():
        target.open("ab").close()  # what nobody may write to is not replaced either
        mode = stat.S_IMODE(target.stat().st_mode)
    _remove_abandoned(target.parent)
    while True:
        new = target.parent / f"{_MARK}{secrets.token_hex(8)}{suffix}"
        lock = os.open(new, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        if new.exists():
            break
        os.close(lock)  # another writer came before the lock, and took it for abandoned
    if mode is not None:
        new.chmod(mode)
    if fcntl is None:
        os.close(lock)
        return new, None
    return new, lock


def _release(lock: int | None) -> None:
    """Release the lock of a file, if there is one."""
    if lock is not None:
        os.close(lock)


def _remove_abandoned(folder: Path) -> None:
    """Remove temporary files of writers that were killed: no process holds their locks."""
    if fcntl is None:
        return
    for left in folder.glob(f"{_MARK}*"):
        with suppress(OSError):  # held by a writer, removed by another, or somebody else's
            lock = os.open(left, os.O_RDONLY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                left.unlink()
            finally:
                os.close(lock)


def _not_written(path: str | PathLike[str], error: OSError) -> InvalidArgument:
    why, folder = error.strerror or str(error), Path(path).parent
    if not folder.absolute().is_dir():
        why = f"there is no folder {folder}; make it first"
    return InvalidArgument(f"{path}: cannot be written: {why}")


# Arrays of an npz that may come from a stranger: only those asked for, their sizes checked first.
#
# numpy's own reader takes what the file says: a header of a few bytes can ask for any amount of
# memory, and members that were not asked for are expanded too.


Arrays = dict[str, NDArray[Any]]

_NPY: Final = ".npy"
_MAGIC: Final = b"\x93NUMPY"
_HEADER: Final = re.compile(
    rb"\{'descr': '([<>|][fiuUb]\d{1,9})', 'fortran_order': (True|False), "
    rb"'shape': \((|\d{1,18},|\d{1,18}(?:, \d{1,18}){1,31})\), \} *\n"
)
# Motions pack to three quarters of their size, and to a thousandth only where all stands still.
_FREELY: Final = 2**28  # [bytes]
_RATIO: Final = 30


def write_npz(path: str | PathLike[str], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays; see `atomic_write`."""
    # compressed, Cassie's motions take three quarters of the space and forty times the time
    with atomic_write(path) as new, new.open("wb") as file:  # a name without .npz stays as it is
        np.savez(file, allow_pickle=False, **arrays)


def read_npz(path: str | PathLike[str], wanted: Callable[[str], bool]) -> Arrays:
    """Arrays of an npz file, those of the wanted names."""
    # ValueError if they take more memory than a file of its size is good for, or are none; OSError
    # without a file. What the format of zip has beside this is raised as zipfile raises it.
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ValueError("it is not a file")
    with path.open("rb") as stream, ZipFile(stream) as archive:
        members = {
            info.filename.removesuffix(_NPY): info
            for info in archive.infolist()
            if info.filename.endswith(_NPY) and wanted(info.filename.removesuffix(_NPY))
        }
        size = sum(info.file_size for info in members.values())
        if size > max(_FREELY, _RATIO * path.stat().st_size):
            raise ValueError(f"it would take {size / 1e9:.3g} GB of memory")
        for name, info in members.items():
            if info.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
                raise ValueError(f"{name} is compressed in a way that condyn_pin never writes")
        return {name: _array(name, archive.read(info)) for name, info in members.items()}


def _array(name: str, content: bytes) -> NDArray[Any]:
    """Array of an npy file; ValueError if its size does not match its shape."""
    wide = 2 if content[6:7] == b"\x01" else 4
    start = 8 + wide
    end = start + int.from_bytes(content[8:start], "little")
    header = _HEADER.fullmatch(content[start:end])
    if content[:6] != _MAGIC or header is None:
        raise ValueError(f"{name} is not an array of numbers or text")
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(n) for n in header[3].replace(b",", b" ").split())
    if prod(shape) * dtype.itemsize != len(content) - end or not dtype.itemsize:
        raise ValueError(f"{name} should have shape {shape}, and is of another size")
    flat = np.frombuffer(content, dtype, offset=end)
    order: Any = "F" if header[2] == b"True" else "C"
    return flat.reshape(shape, order=order).astype(dtype.newbyteorder("="), order="C")


# Texts of json and toml that may come from strangers: their size, depth, numbers and letters.


# A text takes up to thirty times its size when it is parsed: a gigabyte. The largest robots and
# tables have a tenth of this.
LARGEST: Final = 2**25  # [bytes]

_SHOWN: Final = 60  # characters of a line in an error
_LINES: Final = str.maketrans("\n\r\t", "   ")


def read_bytes(path: str | PathLike[str]) -> bytes:
    """Bytes of a file; OSError or ValueError if there is none, or if it is no text file."""
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):  # a device without an end
        raise ValueError("it is not a file")
    with path.open("rb") as file:
        content = file.read(LARGEST + 1)
    check_size(len(content))
    return content


def check_size(size: int) -> None:
    """Raise ValueError if a text exceeds the size limit."""
    if size > LARGEST:
        raise ValueError(f"it is larger than {LARGEST / 1e6:.0f} MB")


def read_text(path: str | PathLike[str]) -> str:
    """Return a text in UTF-8, with or without a byte order mark."""
    return read_bytes(path).decode("utf-8-sig")


def parse_json(text: str | bytes) -> Any:
    """Parsed JSON; ValueError if it cannot be read."""
    return _parsed(json.loads, text, json.JSONDecodeError)


def parse_toml(text: str) -> dict[str, Any]:
    """Parsed TOML; ValueError if it cannot be read."""
    try:
        config: dict[str, Any] = _parsed(tomllib.loads, text, tomllib.TOMLDecodeError)
    except tomllib.TOMLDecodeError as error:
        raise tomllib.TOMLDecodeError(f"{error}{_line_of(text, str(error))}") from error
    _check_depth(config)
    return config


def _line_of(text: str, said: str) -> str:
    """Line of the TOML that an error is about, and its most likely fault."""
    found = re.search(r"at line (\d+)", said)
    if not found:
        return ""
    line = text.splitlines()[int(found[1]) - 1 :][:1]
    short = any(re.search(r"=\s*[+-]?\.\d|=\s*[+-]?\d+\.(\D|$)", each) for each in line)
    why = "; numbers have digits on both sides of the point, 0.5 and 1.0" if short else ""
    return "".join(f": {each.strip()[:_SHOWN]!r}{why}" for each in line)


def written_out(value: Any) -> Any:
    """Parsed value with all texts printable, ready for messages."""
    if isinstance(value, str):
        return printable(value.replace("\t", " "))
    if isinstance(value, dict):
        return {written_out(key): written_out(each) for key, each in value.items()}
    if isinstance(value, list):
        return [written_out(each) for each in value]
    return value


def _parsed(parse: Callable[[Any], Any], text: Any, known: type[ValueError]) -> Any:
    check_size(len(text))
    try:
        letters = text if isinstance(text, str) else text.decode("latin-1")
        plain = "\\" not in letters and letters.translate(_LINES).isprintable()
        return parse(text) if plain else written_out(parse(text))
    except (known, UnicodeDecodeError):
        raise
    except ValueError as error:  # Python's own limit, against numbers that take minutes to read
        raise ValueError("a number in it has thousands of digits") from error
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error


def _check_depth(value: Any, most: int = 32) -> None:
    """Raise ValueError if tables are nested too deeply: dotted keys nest without brackets."""
    level = [value]
    for _ in range(most):
        inner = (x.values() if isinstance(x, dict) else x for x in level)
        level = [y for x in inner for y in x if isinstance(y, (dict, list))]
    if level:
        raise ValueError(f"it is nested more than {most} deep")
