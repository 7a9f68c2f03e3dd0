"""Other processors on this one: pytest with each kernel of OpenBLAS, level of numpy, and threads.

    python tests/kernels.py                             say what this processor can run
    python tests/kernels.py -- tests/test_scene.py      run pytest with each, all files by default
    python tests/kernels.py --others 2 -- ...           with two kernels that are not its own
    python tests/kernels.py --older -- ...              with the older of these two, or --newer

OpenBLAS chooses its kernels by the processor, or by OPENBLAS_CORETYPE; numpy chooses its loops, and
leaves out what NPY_DISABLE_CPU_FEATURES names; the C library its sine and cosine. Sums are rounded
otherwise by each. A kernel that this processor cannot run ends its probe, or becomes another.
"""

from __future__ import annotations

import argparse
import functools
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

# From the oldest to the newest; Zen has Haswell's. The second line is ARM's.
WITHOUT_AVX2 = ("Prescott", "Nehalem", "Sandybridge")
WITHOUT_AVX512 = (*WITHOUT_AVX2, "Haswell", "Zen")
KERNELS = (*WITHOUT_AVX512, "SkylakeX", "Cooperlake")
KERNELS += ("ARMV8", "CORTEXA57", "NEOVERSEN1", "NEOVERSEV1")

# A triangle, a product and singular values: what a processor cannot run ends the interpreter.
_PROBE = """
import numpy as np
from threadpoolctl import threadpool_info
A = np.arange(2500.0).reshape(50, 50) + 2500 * np.eye(50)
np.linalg.solve(A, A @ A), np.linalg.svd(A)
print(*sorted({library.get("architecture", "") for library in threadpool_info()}))
"""


@dataclass(frozen=True)
class Environment:
    """Variables that another processor is imitated by; an empty one is taken away."""

    label: str
    variables: dict[str, str]

    def applied(self) -> dict[str, str]:
        """Return all variables of a process in this environment."""
        merged = os.environ | self.variables
        return {name: value for name, value in merged.items() if value}

    def architecture(self) -> str:
        """Return which kernels OpenBLAS takes, or nothing where they do not run."""
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=self.applied(), capture_output=True, text=True, check=False,
        )  # fmt: skip
        return probe.stdout.strip() if probe.returncode == 0 else ""


def levels(kernel: str) -> dict[str, str]:
    """Return what a processor of the age of a kernel has not, of what this one has."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    newer = [name for name in found if name.startswith(("AVX512", "X86_V4"))]
    missing = {"NPY_DISABLE_CPU_FEATURES": " ".join(newer if kernel in WITHOUT_AVX512 else [])}
    if kernel in WITHOUT_AVX2:
        missing["NPY_DISABLE_CPU_FEATURES"] = " ".join(found)
        missing["GLIBC_TUNABLES"] = "glibc.cpu.hwcaps=-AVX2,-FMA"
    return missing


@functools.cache
def kernels() -> tuple[Environment, ...]:
    """Return the kernels that this processor can run, each once, its own first."""
    own = Environment("its own", {"OMP_NUM_THREADS": "1"})
    found = {own.architecture(): own}
    for kernel in KERNELS:
        variables = {"OPENBLAS_CORETYPE": kernel, "OMP_NUM_THREADS": "1"} | levels(kernel)
        there = Environment(kernel, variables)
        if architecture := there.architecture():
            found.setdefault(architecture, there)
    return tuple(found.values())


def environments() -> Iterator[Environment]:
    """Yield the kernels, then numbers of threads, and the own kernel with the oldest numpy."""
    yield from kernels()
    yield Environment("4 threads", {"OMP_NUM_THREADS": "4"})
    yield Environment("threads unset", {"OMP_NUM_THREADS": "", "TEST_THREADS": "unset"})
    oldest = {"OMP_NUM_THREADS": "1"} | levels(WITHOUT_AVX2[0])
    yield Environment("its own, numpy and libm without AVX2", oldest)


def others(count: int) -> list[Environment]:
    """Return so many kernels that are not this processor's own, as far apart as can be."""
    found = kernels()[1:]
    if count > len(found):
        raise SystemExit(f"this processor runs {len(found)} kernels that are not its own")
    places = np.linspace(0, len(found) - 1, count).round().astype(int) if count else []
    return [found[k] for k in places]


def main() -> int:
    """Run pytest in each environment; the exit code is that of the first that fails."""
    words = sys.argv[1:]
    cut = words.index("--") if "--" in words else len(words)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asks = parser.add_mutually_exclusive_group()
    asks.add_argument("--others", type=int, metavar="N", help="only N kernels, not its own")
    asks.add_argument("--older", action="store_true", help="only the older of two, not its own")
    asks.add_argument("--newer", action="store_true", help="only the newer of these two")
    asked = parser.parse_args(words[:cut])
    if asked.older or asked.newer:
        chosen = [others(2)[asked.newer]]
    else:
        chosen = list(environments()) if asked.others is None else others(asked.others)
    codes = []
    for each in chosen:
        said = " ".join(f"{name}={value!r}" for name, value in each.variables.items() if value)
        print(f"== {each.label}: {said}", flush=True)
        if cut < len(words):
            command = [sys.executable, "-m", "pytest", "-q", *words[cut + 1 :]]
            codes.append(subprocess.run(command, env=each.applied(), check=False).returncode)
    for each, code in zip(chosen, codes, strict=False):
        print(f"{'failed' if code else 'passed'}: {each.label}")
    return next((code for code in codes if code), 0)


if __name__ == "__main__":
    sys.exit(main())
