"""Tests of a compiled core whose own instructions check memory, arithmetic or threads.

    pip install ./native -C cmake.build-type=Debug -C cmake.define.CONDYN_SANITIZE=thread
    python tests/under_sanitizers.py                          all tests of the core
    python tests/under_sanitizers.py -- tests/test_native.py  those of your choice

A sanitizer of the compiler sees stacks and arithmetic, which valgrind does not. `SANITIZERS` are
those for memory and undefined behaviour, all in one build; "thread", for races, goes alone. A build
takes 20 minutes of a core and 5 GB. The first wrong access to memory ends the tests.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from under_valgrind import OURS

# All of -fsanitize=undefined but for null pointers, alignment and sizes of objects, which double
# the code that templates become: what they find, that for addresses does where it is used.
SANITIZERS = (
    "address,bounds,shift,integer-divide-by-zero,signed-integer-overflow,float-cast-overflow,"
    "return,unreachable,bool,enum,pointer-overflow,vla-bound"
)

# What has to be there before Python is: Python itself is not linked with C++.
RUNTIMES = {"address": ("libasan.so", "libubsan.so"), "thread": ("libtsan.so",)}


def runtime_of(module: Path) -> str:
    """Return the library of the sanitizer that a module was linked with: address or thread."""
    linked = subprocess.run(["ldd", str(module)], check=True, capture_output=True, text=True)
    for kind, (library, *_) in RUNTIMES.items():
        if library in linked.stdout:
            return kind
    sys.exit(
        f"{module} has no sanitizer; build it so: pip install ./native "
        f"-C cmake.build-type=Debug -C cmake.define.CONDYN_SANITIZE={SANITIZERS}"
    )


def environment(kind: str, log: Path) -> dict[str, str]:
    """Return the variables that load what the module needs, and send reports to `log`."""
    paths = [
        subprocess.run(
            ["gcc", f"-print-file-name={library}"], check=True, capture_output=True, text=True
        ).stdout.strip()
        for library in (*RUNTIMES[kind], "libstdc++.so.6")
    ]
    return os.environ | {
        "LD_PRELOAD": ":".join(paths),
        # Python frees little when it ends, so that leaks say nothing.
        "ASAN_OPTIONS": f"log_path={log}:detect_leaks=0:detect_stack_use_after_return=1",
        "UBSAN_OPTIONS": f"log_path={log}:print_stacktrace=1",
        "TSAN_OPTIONS": f"log_path={log}",
        "PYTHONMALLOC": "malloc",
        "OMP_NUM_THREADS": "1",
    }


def reports(log: str) -> Iterator[str]:
    """Yield what a sanitizer says that has the core in its stack."""
    begins = ("==", "WARNING: ThreadSanitizer")
    block: list[str] = []
    for line in [*log.splitlines(), "=="]:
        if block and (line.startswith(begins) or ": runtime error: " in line):
            if OURS in "\n".join(block):
                yield "\n".join(block)
            block = []
        if line.strip("= "):
            block.append(line)


def main() -> None:
    """Run tests under the sanitizer that the core was built with."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("tests", nargs="*")
    tests = parser.parse_args().tests
    tests = tests or sorted(str(path) for path in Path(__file__).parent.glob("test_native*.py"))
    import condyn_pin_native

    (module,) = Path(condyn_pin_native.__file__).parent.glob("_core.*.so")
    kind = runtime_of(module)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        ended = subprocess.run(command, check=False, env=environment(kind, log))
        logs = [path.read_text() for path in sorted(Path(folder).iterdir())]
        said = dict.fromkeys(one for text in logs for one in reports(text))
    print(f"{kind}: {len(said)} reports of the core", *said, sep="\n\n")
    sys.exit(bool(said) or ended.returncode)


if __name__ == "__main__":
    main()
