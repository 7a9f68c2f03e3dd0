"""Arrays in memory that the processes of this machine share.

A file without a name, which exists only in memory (Linux's memfd): this process holds it open, and
others open it by its number, ``/proc/<process>/fd/<number>``. There is no name to be left over: the
memory is free again when the last array in it is gone, however the processes end.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

# Whether this system has such memory. Elsewhere arrays go to processes as pickled copies.
CAN_SHARE: Final = hasattr(os, "memfd_create") and Path("/proc/self/fd").exists()

# Where an array may begin: a line of the cache [bytes].
_ALIGNED: Final = 64


class Kind(NamedTuple):
    """Shape and type of an array."""

    shape: tuple[int, ...]
    dtype: str = "f8"

    @property
    def size(self) -> int:
        """Bytes that it takes, with what is left free behind it."""
        size = prod(self.shape) * np.dtype(self.dtype).itemsize
        return -(-size // _ALIGNED) * _ALIGNED

    def times(self, count: int) -> Kind:
        """Return so many of it."""
        return Kind((count, *self.shape), self.dtype)


Kinds = Mapping[str, Kind]
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Address:
    """Where shared arrays are, for another process of this machine."""

    path: str
    inode: int  # which file it is: the number in the path is given to others after it is closed
    kinds: Kinds = field(compare=False)

    def open(self) -> Arrays:
        """Return the arrays by name, for reading and writing.

        FileNotFoundError if they are gone: whoever asked for the work no longer waits for it.
        """
        with Path(self.path).open("r+b") as file:
            if os.fstat(file.fileno()).st_ino != self.inode:
                raise FileNotFoundError(f"{self.path}: it is another file by now")
            return _views(mmap.mmap(file.fileno(), 0), self.kinds)


class SharedArrays:
    """Arrays of zeros that other processes open by `address`.

    OSError if there is obviously not enough memory; as with other arrays, it is taken when it is
    written to. After `close` no other process can open the arrays. They live on where they are
    open, and one file with them, for as long as something refers to them.
    """

    def __init__(self, kinds: Kinds) -> None:
        size = max(sum(kind.size for kind in kinds.values()), 1)
        self._file = os.memfd_create("condyn_pin")
        try:
            os.ftruncate(self._file, size)
            self.arrays = _views(mmap.mmap(self._file, size), kinds)
        except BaseException:
            os.close(self._file)
            raise
        path, inode = f"/proc/{os.getpid()}/fd/{self._file}", os.fstat(self._file).st_ino
        self.address = Address(path, inode, dict(kinds))

    def close(self) -> None:
        """Let no other process open the arrays any more."""
        os.close(self._file)


def _views(memory: mmap.mmap, kinds: Kinds) -> Arrays:
    """Return the arrays one behind the other in a piece of memory, which they keep alive."""
    arrays, offset = {}, 0
    for name, kind in kinds.items():
        arrays[name] = np.ndarray(kind.shape, kind.dtype, memory, offset)
        offset += kind.size
    return arrays
