"""Arrays of an npz that may come from a stranger: only those asked for, their sizes checked first.

numpy's own reader takes what the file says: a header of a few bytes can ask for any amount of
memory, and members that were not asked for are expanded too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from math import prod
from os import PathLike
from pathlib import Path
from typing import Any, Final
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.files.beside import written_beside

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
    """Write arrays; see `written_beside`."""
    # compressed, Cassie's motions take three quarters of the space and forty times the time
    with written_beside(path) as new, new.open("wb") as file:  # a name without .npz stays as it is
        np.savez(file, allow_pickle=False, **arrays)


def read_npz(path: str | PathLike[str], wanted: Callable[[str], bool]) -> Arrays:
    """Return the arrays whose names are wanted.

    Raises
    ------
    OSError
        If there is no file.
    ValueError
        If its arrays take more memory than a file of its size is good for, or are none. What the
        format of zip has beside this is raised as zipfile raises it.
    """
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
    """Return the array of an npy file, whose numbers have to be all there and no more."""
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
