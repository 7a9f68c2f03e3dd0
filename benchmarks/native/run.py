"""Export the standard scenes, build the C++ program, run it, and name its rows like the bench's.

python benchmarks/native/run.py --output native.json
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import condyn_pin as cp
from condyn_pin.dynamics.catalogue import motor_torque, standard_scenes

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from export import export_scene  # noqa: E402

ROBOTS = ("talos", "cassie", "solo12", "four_bar")


def export_all(folder: Path) -> dict[str, str]:
    """Write one closed, moving state of every scene; return label by directory name."""
    labels = {}
    for robot in ROBOTS:
        for label, scene in standard_scenes(cp.load_robot(robot)).items():
            rng = np.random.default_rng(0)
            q, v = scene.sample(rng)
            tau = motor_torque(scene.robot, rng)
            workspace = cp.Workspace(scene)
            name = label.replace(" ", "_")
            export_scene(folder, name, workspace.model, workspace.constraint_models, q, v, tau)
            labels[name] = label
    return labels


def build(folder: Path) -> Path:
    """Build the program against the Pinocchio of this interpreter."""
    configure = ["cmake", "-S", str(HERE), "-B", str(folder), f"-DPYTHON={sys.executable}"]
    subprocess.run(configure, check=True)
    subprocess.run(["cmake", "--build", str(folder)], check=True)
    return folder / "condyn_native"


def main() -> None:
    """Do all three."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True, help="json file to write")
    parser.add_argument("--build", type=Path, default=Path("build/native"), help="build folder")
    arguments = parser.parse_args()
    scenes = arguments.build / "scenes"
    labels = export_all(scenes)
    program = build(arguments.build)
    command = [str(program), "--output", str(arguments.output)]
    subprocess.run([*command, *(str(scenes / name) for name in labels)], check=True)
    result = json.loads(arguments.output.read_text())
    for row in (*result["rows"], *result["scenes"]):
        row["scene"] = labels[Path(row["scene"]).name]
    arguments.output.write_text(json.dumps(result, indent=1) + "\n")
    print(f"written: {arguments.output}")


if __name__ == "__main__":
    main()
