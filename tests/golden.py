"""A record of what the library answers, in bits: moving code may not move a number.

    python tests/golden.py write build/golden/before.json
    python tests/golden.py compare build/golden/before.json build/golden/after.json

A change that should alter no number writes `before.json`, then `after.json`, and compares: a minute
each. Records are never committed.

An array is kept as the hash of its bytes, with its first numbers for reading; times are left out.
Two processors, two BLAS or two Pinocchios differ in the last bits: compare what one machine wrote.
`golden_questions.py` says what is asked.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import numpy as np

import condyn_pin as cp

# What a clock says, addresses, and files of this program, wherever words have them.
CLOCKED = re.compile(
    r"[\d.]+(e[-+]\d+)?( us| ms)\b|(took|CPU) .*|time  .*|x real time|0x[0-9a-f]{6,}|built in \S+ *"
)
# Fields that are times, or the question itself.
UNTOLD = re.compile("^_|time|seconds|^scene$|^robot$|^solver$|^actuation$")


class Record(dict[str, str]):
    """Answers as text, by question."""

    def keep(self, question: str, call: Callable[..., Any], *args: Any, **options: Any) -> Any:
        """Call, record what comes back or how it is refused, and return it."""
        try:
            answer = call(*args, **options)
        except cp.CondynError as error:
            self[question] = f"{type(error).__name__}: {said(str(error))}"
            return None
        self.update(told(question, answer))
        return answer


def told(key: str, value: Any) -> Iterator[tuple[str, str]]:
    """Give every number and word of a value, by its place in it."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        yield key, repr(value.tolist())
    elif isinstance(value, np.ndarray):
        first = np.array2string(value.ravel()[:3], precision=6)
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
        yield key, f"{value.dtype}{value.shape} {first} {digest}"
    elif isinstance(value, str):
        yield key, said(value)
    elif isinstance(value, Enum):
        yield key, value.name
    elif value is None or isinstance(value, int | float | np.number | np.bool_):
        yield key, repr(value)
    else:
        for name, part in parts(value):
            yield from told(f"{key}{name}", part)


def parts(value: Any) -> Iterator[tuple[str, Any]]:
    """Give what a value is made of: items, or fields that are not the question."""
    if isinstance(value, Mapping):
        yield from ((f"[{name}]", part) for name, part in value.items())
    elif hasattr(value, "_fields"):  # a named tuple
        yield from ((f".{name}", getattr(value, name)) for name in value._fields)
    elif isinstance(value, tuple | list):
        yield from ((f"[{i}]", part) for i, part in enumerate(value))
    elif is_dataclass(value) and not isinstance(value, cp.Scene | cp.Robot):
        known = {name: part for name, part in vars(value).items() if not UNTOLD.search(name)}
        yield from ((f".{name}", part) for name, part in known.items())


def said(text: str) -> str:
    """Leave out what another run, or another checkout, may say otherwise."""
    return CLOCKED.sub("~", text.replace(str(Path(cp.__file__).parents[1]), "."))


def compare(old: dict[str, str], new: dict[str, str]) -> int:
    """Print what differs, and count it."""
    changed = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    for key in changed:
        print(f"{key}\n  - {old.get(key, 'not there')}\n  + {new.get(key, 'not there')}")
    print(f"{len(changed)} of {len(old)} answers differ")
    return len(changed)


def main() -> int:
    """Write a record, or compare two; 1 if they differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("write").add_argument("files", type=Path, nargs=1, metavar="FILE")
    verbs.add_parser("compare").add_argument("files", type=Path, nargs=2, metavar="FILE")
    args = parser.parse_args()
    if args.verb == "compare":
        return int(compare(*(json.loads(path.read_text("utf-8")) for path in args.files)) > 0)
    from golden_questions import ask

    record = Record()
    ask(record)
    args.files[0].parent.mkdir(parents=True, exist_ok=True)
    args.files[0].write_text(json.dumps(record, indent=0), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
