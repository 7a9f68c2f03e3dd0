"""Files written beside their place, and put there once they are whole.

A disk that fills up, a bug or Ctrl-C in the middle of writing leaves the old file as it was. What a
writer that was killed has left beside it goes with the next one: nobody holds its lock.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

from condyn_pin.errors import InvalidArgument

try:
    import fcntl
except ImportError:  # Windows, where a file that is open stays
    fcntl = None  # type: ignore[assignment]

_MARK = ".condyn-"  # of all files that are being written


@contextmanager
def written_beside(path: str | PathLike[str]) -> Iterator[Path]:
    """Give the path of a new file in the same folder, which takes the place of `path` at the end.

    A file that was there keeps its permissions, a link stays a link. What is no file, such as
    /dev/stdout, is written to as it is.

    Raises
    ------
    InvalidArgument
        If it cannot be written; then what was there is as it was.
    """
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
    """Refuse a file whose name says another format than it would have."""
    ending = Path(path).suffix
    if ending and ending.lower() not in endings:
        raise InvalidArgument(
            f"{path}: its name says {ending[1:]}, and what is written is {endings[0][1:]}; name it "
            f"{Path(path).with_suffix(endings[0])}"
        )


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a text as UTF-8; see `written_beside`."""
    with written_beside(path) as new:
        new.write_text(text, encoding="utf-8")


def check_writable(path: str | PathLike[str]) -> None:
    """Raise InvalidArgument if a file could not be written; nothing is left behind."""
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
    """Return the file that a path means, behind its links."""
    try:
        return Path(os.path.realpath(path))
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"path = {path!r}: the name of a file is needed ({error})") from error


def _new_file(target: Path, suffix: str) -> tuple[Path, int | None]:
    """Return an empty file beside another one, and its lock, which `_release` gives back.

    With the permissions that the other one has or gets.
    """
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
    """Give the lock of a file back, if there is one."""
    if lock is not None:
        os.close(lock)


def _remove_abandoned(folder: Path) -> None:
    """Remove what writers have left that live no more: their locks went with them."""
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
