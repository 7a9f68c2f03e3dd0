"""Mutants: the library with one small mistake each, and the share of them that tests find.

    python tests/mutants.py                    all (hours of one core); survivors are printed
    python tests/mutants.py --sample 30        a look: some of each room
    python tests/mutants.py --room proof       those of files whose names contain the word
    python tests/mutants.py --list             what they are, without running any

A comparison is turned, + and - change places, a constant is another one, what is returned has the
other sign, or a statement is left out. The same seed gives the same mutants of the same source.
Each runs in a copy of the package, with the tests of its room that call its function: those of
`ROOMS`, without `--long`, the fastest first, until one fails or they took `SECONDS`. A mutant that
takes ten times as long as the library is found, too.
A survivor may be equivalent: then the line can often be simpler.
"""

from __future__ import annotations

import argparse
import ast
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = "condyn_pin"

SECONDS = 20.0  # tests of one mutant take, without the mistake


@dataclass(frozen=True)
class Room:
    """Files of the package, how many mutants they have in all, and the tests that should see them.

    A file belongs to the first room that names it.
    """

    files: str  # a pattern below condyn_pin/
    count: int
    tests: str


ROOMS = [
    Room("dynamics/proof.py", 30, "solution numerics weights contract"),
    Room("dynamics/digits.py", 30, "digits mechanisms variants"),
    Room("constraints/rows/redundancy.py", 30, "scene solvers extremes derivatives open_states"),
    Room("constraints/contacts/*.py", 40, "contacts contact_pairs steppers"),
    Room("constraints/**/*.py", 60, "constraints equations derivatives contract"),
    Room("dynamics/derivatives/*.py", 40, "derivatives open_states"),
    Room("dynamics/**/*.py", 60, "solution solvers numerics contract"),
    Room("mechanism/rank.py", 10, "diagnosis"),
    Room("simulation/motion_status.py", 10, "motion_status"),
    Room("contact/residuals.py", 10, "contact_residuals cones"),
    Room("contact/**/*.py", 60, "cones contact_residuals contact_solvers restitution"),
    Room("stepping/**/*.py", 50, "steppers step_closings event_driven contact_work"),
    Room("gradients/**/*.py", 30, "routes step_derivatives_batch"),
    Room("control/**/*.py", 50, "control control_by_hand qp inverse operational balance standing"),
]

SKIPPED = (ast.Raise, ast.Assert, ast.Import, ast.ImportFrom, ast.JoinedStr, ast.FunctionDef)
TURNED = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
SWAPPED = {ast.Add: ast.Sub, ast.Sub: ast.Add}


@dataclass(frozen=True)
class Mutant:
    """A file with one node replaced by another text."""

    file: Path  # below condyn_pin/
    line: int
    function: int  # first line of the function
    start: int  # of the node, in bytes of the file
    end: int
    old: str
    new: str

    def __str__(self) -> str:
        old, new = (" ".join(text.split())[:50] for text in (self.old, self.new))
        return f"{self.file}:{self.line}: {old}  ->  {new}"

    def applied(self, source: bytes) -> bytes:
        """Source of the file with the mistake in it."""
        return source[: self.start] + self.new.encode() + source[self.end :]


def mutants_of(package: Path, file: Path) -> Iterator[Mutant]:
    """Every mutant of a file."""
    source = (package / file).read_bytes()
    lines = [0]
    for line in source.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))

    for function, old, new in replacements(ast.parse(source)):
        start = lines[old.lineno - 1] + old.col_offset
        end = lines[old.end_lineno - 1] + old.end_col_offset
        yield Mutant(file, old.lineno, function, start, end, source[start:end].decode(), new)


def replacements(tree: ast.Module) -> Iterator[tuple[int, ast.AST, str]]:
    """First line of a function, a node of its body, and what may stand in the place of the node."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            is_bool = isinstance(function.returns, ast.Name) and function.returns.id == "bool"
            first = min(node.lineno for node in (function, *function.decorator_list))
            for statement in function.body:
                for node in below(statement):
                    yield from ((first, node, text) for text in other_texts(node, is_bool))


def below(node: ast.AST) -> Iterator[ast.AST]:
    """A node and all below it, but for messages, checks, annotations and functions of their own."""
    if isinstance(node, SKIPPED) or (isinstance(node, ast.keyword) and node.arg == "strict"):
        return
    yield node
    for name, child in ast.iter_fields(node):
        if name not in ("annotation", "decorator_list"):
            for each in child if isinstance(child, list) else [child]:
                if isinstance(each, ast.AST):
                    yield from below(each)


def other_texts(node: ast.AST, is_bool: bool) -> Iterator[str]:
    """Texts that turn a node into a mistake."""
    match node:
        case ast.Compare(left=left, ops=[op], comparators=right):
            yield f"({ast.unparse(ast.Compare(left, [TURNED[type(op)]()], right))})"
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            yield f"({ast.unparse(ast.BinOp(left, SWAPPED[type(op)](), right))})"
        case ast.Constant(value=bool(value)):
            yield repr(not value)
        case ast.Constant(value=int(value)):
            yield repr(value + 1)
        case ast.Constant(value=float(value)):
            yield repr(2 * value if value else 1.0)
        case ast.Return(value=ast.Name() | ast.BinOp() | ast.Compare() | ast.BoolOp() as value):
            yield f"return {'not' if is_bool else '-'} ({ast.unparse(value)})"
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield "pass"


def chosen(seed: int) -> list[tuple[Room, list[Mutant]]]:
    """Mutants of every room, in the order in which they run."""
    package, taken, of_rooms = ROOT / PACKAGE, set(), []
    for room in ROOMS:
        paths = [path for path in package.glob(room.files) if path.stem != "compiled"]
        files = {path.relative_to(package) for path in paths} - taken
        taken |= files
        found = [mutant for file in sorted(files) for mutant in mutants_of(package, file)]
        draw = random.Random(f"{seed} {room.files}")
        of_rooms.append((room, draw.sample(found, min(room.count, len(found)))))
    return of_rooms


class Called(NamedTuple):
    """A test that passes, and the functions of the package that it calls."""

    test: str
    seconds: float
    functions: set[tuple[str, int]]  # file below condyn_pin/, first line


class Calls:
    """Plugin of pytest that looks at the functions of a package."""

    def __init__(self, package: Path) -> None:
        self.package = f"{package}{os.sep}"
        self.of_tests: list[Called] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        functions = set()

        def trace(frame: FrameType, event: str, argument: object) -> None:
            code = frame.f_code
            if code.co_filename.startswith(self.package):
                file = code.co_filename.removeprefix(self.package)
                functions.add((file, code.co_firstlineno))

        start = time.monotonic()
        sys.settrace(trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            test = f"{item.path}{item.nodeid[item.nodeid.find('::') :]}"
            self.of_tests.append(Called(test, time.monotonic() - start, functions))


def pytest_run(tests: list[str], package: Path, calls: Connection | None) -> None:
    """Exit with the status of tests; calls gets what they call."""
    sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    sys.path.insert(0, str(package.parent))
    sys.dont_write_bytecode = calls is None  # that of mutants is kept nowhere
    plugins = [Calls(package)] if calls else []
    options = ["-q", "-x", "-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml")]
    status = pytest.main([*options, *tests], plugins)
    if calls:
        calls.send(plugins[0].of_tests)
    os._exit(status)


class Copy:
    """A copy of the package that tests import, with one file at a time changed."""

    def __init__(self, folder: Path) -> None:
        self.package = folder / PACKAGE
        shutil.copytree(ROOT / PACKAGE, self.package, ignore=shutil.ignore_patterns("__pycache__"))
        (folder / "robots").symlink_to(ROOT / "robots")
        os.environ["PYTHONPATH"] = str(folder)
        os.chdir(folder)
        # Runs are forks of a process that has imported what does not change.
        self.processes = multiprocessing.get_context("forkserver")
        self.processes.set_forkserver_preload(["pytest", "scipy.linalg", "pinocchio"])

    def called(self, names: str) -> list[Called]:
        """Tests in files of these names, the fastest first."""
        files = [str(ROOT / "tests" / f"test_{name}.py") for name in names.split()]
        here, there = self.processes.Pipe(duplex=False)
        run = self.processes.Process(target=pytest_run, args=(files, self.package, there))
        run.start()
        there.close()
        of_tests = here.recv()
        run.join()
        if run.exitcode:
            sys.exit(f"tests fail without a mistake: {names}")
        return sorted(of_tests, key=lambda one: one.seconds)

    def is_found(self, mutant: Mutant, of_tests: list[Called]) -> bool:
        """Whether one of the tests that call its function fails, or takes too long."""
        tests, seconds = [], 0.0
        for one in of_tests:
            if (str(mutant.file), mutant.function) in one.functions and seconds < SECONDS:
                tests.append(one.test)
                seconds += one.seconds
        if not tests:
            return False
        path = self.package / mutant.file
        source = path.read_bytes()
        path.write_bytes(mutant.applied(source))
        try:
            run = self.processes.Process(target=pytest_run, args=(tests, self.package, None))
            run.start()
            run.join(10 * seconds + 30)
            run.kill()
            run.join()
            return run.exitcode != 0
        finally:
            path.write_bytes(source)


def run(of_rooms: list[tuple[Room, list[Mutant]]]) -> None:
    """Print survivors as they are found, and the share of each room that was not."""
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        called = cache(copy.called)
        for room, mutants in of_rooms:
            for mutant in mutants:
                if copy.is_found(mutant, called(room.tests)):
                    found[room.files] += 1
                else:
                    print(f"survived: {mutant}", flush=True)
            if mutants:
                print(f"{room.files}: {found[room.files]} of {len(mutants)} found", flush=True)
    print(f"in all: {found.total()} of {sum(len(mutants) for _, mutants in of_rooms)} found")


def main() -> None:
    """Run what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sample", type=int, help="how many of all rooms together")
    parser.add_argument("--room", default="", help="a part of the name of a file")
    parser.add_argument("--list", action="store_true", help="print them, run none")
    given = parser.parse_args()
    of_rooms = [
        (room, [mutant for mutant in found if given.room in str(mutant.file)])
        for room, found in chosen(given.seed)
    ]
    if given.sample:
        total = sum(len(mutants) for _, mutants in of_rooms)
        share = given.sample / total
        of_rooms = [(room, found[: round(share * len(found))]) for room, found in of_rooms]
    if given.list:
        for _, mutants in of_rooms:
            print(*mutants, sep="\n")
    else:
        run(of_rooms)


if __name__ == "__main__":
    main()
