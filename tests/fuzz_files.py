"""Archives spoilt at random, from their bytes to the numbers in them."""

from __future__ import annotations

import io
import json
import random
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import crash
import numpy as np

Members = dict[str, bytes]

NUMBERS = ("-1", "0", "1", "2", "7", "255", "65536", "4294967295", "-9223372036854775808",
           "18446744073709551615", "1" + "0" * 400, "1" * 5000, "0.5", "1e308", "1e999", "-1e-320",
           "NaN", "Infinity", "true", "null", '"x"', "[]", "{}",
           "[" * 3000 + "]" * 3000)  # fmt: skip
VALUES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 0.0, -1.0, 1.0, 2.0, 1e9)

READ = """
import sys, resource, warnings
from pathlib import Path
import condyn_pin as cp
warnings.simplefilter("ignore", RuntimeWarning)
kind, files = {kind}, sorted(Path({folder!r}).glob("bad*.npz"))
loaded = 0
for path in files:
    try:
        found = kind.load(path)
    except cp.InvalidArgument as error:
        assert len(str(error)) > 20 and "MemoryError" not in str(error), error
        continue
    except BaseException as error:
        print(repr(error), path)
        sys.exit(1)
    loaded += 1
    try:
        str(found)
        robot = found.scene.robot
        robot.model.createData()
        found.scene.check(found.q[..., -1, :].reshape(-1, robot.nq)[0])
        found.save(Path({folder!r}) / "again.npz")
    except cp.CondynError:
        pass
    except OverflowError:
        pass
print(loaded, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def members_of(path: Path) -> Members:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(members: Members, compression: int) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed.getvalue()


def npy(array: Any) -> bytes:
    packed = io.BytesIO()
    np.save(packed, array, allow_pickle=True)
    return packed.getvalue()


def header_edited(members: Members, rng: random.Random) -> None:
    """Put another number or word in the header, or take a piece of it away."""
    text = str(np.load(io.BytesIO(members["header.npy"])))
    for _ in range(rng.randint(1, 3)):
        spans = [m.span() for m in re.finditer(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]
        words = [m.span() for m in re.finditer(r'"[^"]*"', text)]
        i, j = rng.choice(rng.choice([spans, words]) or [(0, 1)])
        new = rng.choice([rng.choice(NUMBERS), text[slice(*rng.choice(words or [(0, 1)]))], ""])
        text = text[:i] + new + text[j:]
    members["header.npy"] = npy(np.array(text))


def field_removed(members: Members, rng: random.Random) -> None:
    """Take an entry of some table in the header away, or put another one in its place."""
    header = json.loads(str(np.load(io.BytesIO(members["header.npy"]))))
    tables: list[Any] = [header]
    for table in tables:
        inner = table.values() if isinstance(table, dict) else table
        tables += [x for x in inner if isinstance(x, (dict, list)) and x]
    one, other = rng.choice(tables), rng.choice(tables)
    key = rng.choice(list(one) if isinstance(one, dict) else range(len(one)))
    if rng.random() < 0.5:
        del one[key]
    else:
        one[key] = json.loads(json.dumps(other))
    members["header.npy"] = npy(np.array(json.dumps(header)))


def array_edited(members: Members, rng: random.Random) -> None:
    name = rng.choice([n for n in members if n != "header.npy"])
    array = np.load(io.BytesIO(members[name]))
    changes: list[Callable[[], Any]] = [
        lambda: array.ravel(),
        lambda: array.T,
        lambda: array[:-1] if array.ndim else array[None],
        lambda: np.concatenate([array, array]) if array.ndim else array[None],
        lambda: array.astype(rng.choice(["f4", "i8", "i1", "U7", "f2", "?", "O"])),
        lambda: array.reshape(*array.shape, 1),
        lambda: np.zeros(rng.choice([0, 1, (3, 0), (0, 3), ()])),
    ]
    if array.size:
        flat = array.ravel().copy()
        if array.dtype.kind == "f":
            flat[rng.randrange(flat.size)] = rng.choice(VALUES)
        changes += 7 * [lambda: flat.reshape(array.shape)]
    with np.errstate(all="ignore"):
        members[name] = npy(rng.choice(changes)())


def arrays_swapped(members: Members, rng: random.Random) -> None:
    one, other = rng.choice(list(members)), rng.choice(list(members))
    members[one], members[other] = members[other], members[one]


def shape_edited(members: Members, rng: random.Random) -> None:
    """Let the first line of an array say something else."""
    name = rng.choice(list(members))
    size = str(rng.choice([0, 1, 3, 10**6, 10**9, 2**31, 2**62, 2**63, 10**30]))
    head, rest = members[name][:128], members[name][128:]
    old, new = rng.choice(
        [
            (rb"'shape': \([^)]*\)", f"'shape': ({size},)".encode()),
            (rb"'shape': \([^)]*\)", f"'shape': ({size}, {size})".encode()),
            (rb"'shape': \(", b"'shape': " + b"(" * 50),
            (rb"'descr': '[^']*'", rng.choice([b"'descr': '|O'", b"'descr': '<U0'",
             b"'descr': '<f999999'", b"'descr': '<U268435456'", b"'descr': '>f8'"])),
            (rb"False", b"True"),
        ]
    )  # fmt: skip
    head = re.sub(old, new.replace(b"\\", rb"\\"), head)
    members[name] = (head.rstrip(b"\n ") + b" " * 128)[:127] + b"\n" + rest


def member_lost(members: Members, rng: random.Random) -> None:
    del members[rng.choice(list(members))]


SPOIL = (header_edited, header_edited, field_removed, array_edited, array_edited, arrays_swapped,
         shape_edited, member_lost)  # fmt: skip


def spoilt(whole: bytes, members: Members, rng: random.Random) -> bytes:
    """Return an archive with something wrong: in its bytes, or in what they mean."""
    raw = bytearray(whole)
    kind = rng.random()
    if kind < 0.15:
        for _ in range(rng.randint(1, 4)):
            raw[rng.randrange(len(raw))] ^= 1 << rng.randrange(8)
        return bytes(raw)
    if kind < 0.2:
        return bytes(raw[: rng.randrange(len(raw))])
    if kind < 0.25:  # where zip says how large things are
        end = len(raw) - rng.randrange(min(len(raw), 3000))
        raw[end : end + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\x7f", b"\0\0\0\0"])
        return bytes(raw)
    members = dict(members)
    rng.choice(SPOIL)(members, rng)
    return zipped(members, rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]))


def survivors(folder: Path, kind: str, whole: bytes, seed: int, count: int) -> tuple[int, int]:
    """Load spoilt archives in an interpreter that may die.

    Returns
    -------
    tuple of int
        How many were read, and the memory that it took [kB].
    """
    rng = random.Random(seed)
    good = folder / "good.npz"
    good.write_bytes(whole)
    members = members_of(good)
    for k in range(count):
        (folder / f"bad{k:05}.npz").write_bytes(spoilt(whole, members, rng))
    outcome = crash.run(READ.format(kind=kind, folder=str(folder)))
    assert outcome.kind == "ok", (seed, outcome)
    loaded, memory = map(int, outcome.text.splitlines()[-1].split())
    return loaded, memory
