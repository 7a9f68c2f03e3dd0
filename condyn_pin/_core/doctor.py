"""Diagnosis of the installation: versions, the import of Pinocchio, and the command of repair.

This module imports nothing that could fail: it has to work when Pinocchio does not.
"""

from __future__ import annotations

import importlib.util
import platform
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata

MEND_3 = 'python -m pip install --upgrade "pin==3.9.0" "cmeel-urdfdom<5" "cmeel-tinyxml2<11"'
MEND_4 = 'python -m pip install --upgrade "pin>=4.1,<5"'
REPLACE_NAMESAKE = "python -m pip uninstall -y pinocchio && " + MEND_4

_WATCHED = (
    "condyn_pin",
    "condyn_pin_native",
    "pin",
    "libpinocchio",
    "cmeel-urdfdom",
    "cmeel-tinyxml2",
    "cmeel-boost",
    "eigenpy",
    "coal",
    "example-robot-data",
    "numpy",
    "scipy",
    "matplotlib",
    "meshcat",
    "mujoco",
)


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of the installation by `condyn doctor`."""

    platform: str  # Python version and machine
    # distribution name to installed version, for what matters here; missing ones are left out
    versions: dict[str, str]
    imports: bool  # whether `import pinocchio` works in a fresh interpreter
    features: dict[str, str]  # feature name to a sentence; empty when Pinocchio does not import
    findings: tuple[str, ...]  # what is wrong, one sentence each
    remedy: str  # the command that repairs it; empty when nothing is wrong


def installed_version(distribution: str) -> str | None:
    """Return the installed version of a distribution, or None."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def _major(version: str | None) -> int:
    return int(version.split(".")[0]) if version else 0


def _pinocchio_cure(pin: str | None) -> str:
    return MEND_3 if _major(pin) == 3 else MEND_4


def mixed_install() -> tuple[tuple[str, ...], str]:
    """Conflicts among the installed distributions, and the remedy."""
    pin, lib = installed_version("pin"), installed_version("libpinocchio")
    mend = _pinocchio_cure(pin)
    if pin is None and installed_version("pinocchio"):
        return (
            "the distribution 'pinocchio' is a test plugin that shares the import name; "
            "the dynamics library is the distribution 'pin'",
        ), REPLACE_NAMESAKE
    found = []
    if pin and lib and pin != lib:
        found.append(f"pin {pin} is beside libpinocchio {lib}: they must be the same version")
    if _major(pin) == 3:
        for name, first_bad in (("cmeel-urdfdom", 5), ("cmeel-tinyxml2", 11)):
            version = installed_version(name)
            if _major(version) >= first_bad:
                found.append(f"{name} {version} is too new for pin {pin}: it must be <{first_bad}")
    conda = importlib.util.find_spec("pinocchio")
    if pin is None and conda is not None and conda.origin:
        found.append(
            f"Pinocchio comes from {conda.origin}, not from pip: "
            "do not mix package managers in one environment"
        )
        mend = "python -m venv .venv && .venv/bin/" + MEND_4
    return tuple(found), (mend if found else "")


def advise(error: BaseException) -> str:
    """Return the sentence for an `import pinocchio` that failed with `error`."""
    findings, remedy = mixed_install()
    remedy = remedy or _pinocchio_cure(installed_version("pin"))
    reason = "; ".join(findings) or f"{type(error).__name__}: {error}"
    return f"Pinocchio does not import ({reason}). This repairs it: {remedy}"


def diagnose() -> Diagnosis:
    """Diagnose the installation; never raises."""
    versions = {name: v for name in _WATCHED if (v := installed_version(name))}
    probe = subprocess.run(
        [sys.executable, "-c", "import pinocchio; pinocchio.Model"],
        capture_output=True,
        text=True,
        check=False,
    )
    findings, remedy = mixed_install()
    features: dict[str, str] = {}
    if probe.returncode == 0:
        try:
            from condyn_pin._core._pin import pinocchio_features
            from condyn_pin._core.compiled import core_features
            from condyn_pin._core.threads import blas_features

            features = pinocchio_features() | core_features() | blas_features()
        except ImportError as error:
            findings, remedy = (str(error), *findings), remedy or MEND_4
    else:
        lines = probe.stderr.strip().splitlines()
        last = lines[-1] if lines else f"the interpreter ended with {probe.returncode}"
        findings = (f"`import pinocchio` fails: {last}", *findings)
        remedy = remedy or _pinocchio_cure(versions.get("pin"))
    machine = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return Diagnosis(machine, versions, probe.returncode == 0, features, findings, remedy)
