"""One virtual environment for each peer: they exclude one another."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

PINOCCHIO_4 = ("pin==4.1.0", "libpinocchio==4.1.0")
CONDYN_ALONE = ("numpy", "scipy", "lazy_loader", "threadpoolctl", "typer", "rich")
CONDYN = (*CONDYN_ALONE, "example-robot-data>=6.0,<7")
BUILT = Path(__file__).resolve().parents[2] / "build" / "native"  # by `make native`


def core() -> tuple[str, ...]:
    """Return what the compiled core is installed from, if it was built."""
    return tuple(
        f"condyn_pin_native @ {wheel.as_uri()}#sha256={sha256(wheel.read_bytes()).hexdigest()}"
        for wheel in sorted(BUILT.glob("*.whl"))[-1:]
    )


class Missing(Exception):
    """A peer cannot be had; the text is the sentence that the table has in its place."""


@dataclass(frozen=True)
class Environment:
    """What is installed together, and what is run there.

    Parameters
    ----------
    name : str
    requirements : tuple of str
        For pip.
    scripts : tuple of str
        Modules of this package, run in this order.
    """

    name: str
    requirements: tuple[str, ...]
    scripts: tuple[str, ...]

    def make(self, folder: Path) -> Path:
        """Return its interpreter, after having made it if it is not there as it should be.

        Raises
        ------
        Missing
            If it cannot be installed.
        """
        target = folder / self.name
        python, stamp = target / "bin" / "python", target / "requirements.txt"
        wanted = "\n".join(self.requirements) + "\n"
        if python.exists() and stamp.exists() and stamp.read_text() == wanted:
            return python
        self._run(sys.executable, "-m", "venv", "--clear", str(target))
        pip = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        self._run(str(python), *pip, *self.requirements)
        stamp.write_text(wanted)
        return python

    def _run(self, *command: str) -> None:
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise Missing(f"does not install: {last_line(done.stderr)}")


ENVIRONMENTS = (
    Environment(
        "pinocchio4",
        (*PINOCCHIO_4, *CONDYN, *core()),
        ("with_pinocchio", "with_condyn", "with_condyn_core"),
    ),
    Environment("mujoco", (*PINOCCHIO_4, "numpy", "mujoco==4.0.0"), ("with_mujoco",)),
    # its own wheel asks for any Pinocchio, and takes 4.1, on which a contact of 6 rows crashes it
    Environment(
        "crocoddyl",
        ("crocoddyl==3.2.1", "pin==4.0.0", "libpinocchio==4.0.0", "numpy"),
        ("with_crocoddyl",),
    ),
    Environment("drake", (*PINOCCHIO_4, "numpy", "drake==1.51.1"), ("with_drake",)),
    Environment("exudyn", (*PINOCCHIO_4, "numpy", "exudyn==1.13.6"), ("with_exudyn",)),
    Environment(
        "pinocchio3",
        ("pin==3.9.0", "cmeel-urdfdom<5", "cmeel-tinyxml2<11", *CONDYN),
        ("with_pinocchio", "with_condyn"),
    ),
)

# What is not run, and why.
LEFT_OUT = {
    "placo": "an inverse problem: torques for wanted tasks, by a QP; `control.py peers` has it.",
    "tsid": "an inverse problem, as placo.",
    "pink": "kinematics only.",
    "DART": "its joints have no armature, so it would be another Talos; loops act over a step.",
    "aligator": "no Python module on PyPI; the package of that name is another project.",
    "MJX, MuJoCo Warp, Newton": "made for many robots at once on a GPU; this machine has none.",
}


def last_line(text: str) -> str:
    """Return the last line that tells an error, or else the last that says something."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()]
    return (errors or lines or ["no message"])[-1]
