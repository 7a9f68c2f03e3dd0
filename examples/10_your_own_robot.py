"""Your own robot with a loop: a URDF, which can only describe a tree, and a robot.toml.

python examples/10_your_own_robot.py
"""

import tempfile
from pathlib import Path

import numpy as np

import condyn_pin as cp


def link(name: str, length: float) -> str:
    """Return a rod along x as a link of a URDF."""
    across = 1.0 * length**2 / 12
    return f"""
  <link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="1.0"/>
    <inertia ixx="1e-4" iyy="{across}" izz="{across}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def hinge(name: str, parent: str, child: str, x: float) -> str:
    """Return a hinge about y as a joint of a URDF."""
    return f"""
  <joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{x} 0 0"/><axis xyz="0 1 0"/></joint>"""


# Five bars: two motors at the ground, and the tips of the two arms are one pin.
URDF = f"""<robot name="pantograph"><link name="ground"/>
{link("left_arm", 0.3)}{link("left_rod", 0.5)}{link("right_arm", 0.3)}{link("right_rod", 0.5)}
{hinge("left_motor", "ground", "left_arm", -0.1)}{hinge("right_motor", "ground", "right_arm", 0.1)}
{hinge("left_elbow", "left_arm", "left_rod", 0.3)}
{hinge("right_elbow", "right_arm", "right_rod", 0.3)}
</robot>"""

TOML = """
name = "pantograph"
source = "pantograph.urdf"
licence = "BSD-2-Clause"
actuated = ["left_motor", "right_motor"]
description = {file = "pantograph.urdf", root_joint = "fixed"}
frames = [
    {name = "left_tip", parent = "left_rod", translation = [0.5, 0.0, 0.0]},
    {name = "right_tip", parent = "right_rod", translation = [0.5, 0.0, 0.0]},
]
loops = [{frame_a = "left_tip", frame_b = "right_tip", kind = "planar", axis = "y", name = "pin"}]
postures.ready = {left_motor = -2.3, left_elbow = 1.2, right_motor = -0.85, right_elbow = -1.2}
"""

with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "pantograph.urdf").write_text(URDF)
    (Path(folder) / "robot.toml").write_text(TOML)
    robot = cp.load_robot(folder)

scene = cp.Scene(robot, robot.loops)
print(scene.summary(), "\n")  # mobility 2: as many as there are motors

guess = cp.dynamics.described_posture(scene, "ready")
print("as typed in:", scene.check(guess))
q, v = scene.state("ready")
print("closed:     ", scene.check(q), "\n")

swing = cp.simulate(scene, q, v, duration=0.5)
print(swing, "\n")
held = cp.control.gravity_compensation(scene, q)
error = np.abs(cp.solve(scene, q, v, held.tau).a).max() / 9.81
print(f"held by {held.torques} N m: error {error:.0e} of gravity")
