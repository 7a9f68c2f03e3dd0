"""Solo12 leans over three feet and lifts the fourth: tasks, a switch, and an impossible demand.

    python examples/17_lift_a_foot.py [--quick] [--no-view]

Needs the extra "control". The simulation holds the feet whatever their forces are; the controller
keeps them from pulling.
"""

import argparse

import numpy as np

import condyn_pin as cp
from condyn_pin.contact import FrictionCone
from condyn_pin.control import (
    CenterOfMass,
    Controller,
    FrameTask,
    Orientation,
    Posture,
    at_rate,
    balance,
    minimum_jerk,
)


def main() -> None:
    """Lean, lift a foot, and ask for what cannot be done."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--no-view", action="store_true")
    arguments = parser.parse_args()

    solo = cp.load_robot("solo12")
    four = cp.Scene(solo, solo.contacts)
    three = cp.mechanism.without(four, ["FL_FOOT"])
    q, v = four.state()
    com = solo.center_of_mass(q)
    inside = cp.control.support_polygon(three, q).in_world.mean(axis=0)
    target = np.append(inside[:2], com[2])
    T = 0.3 if arguments.quick else 0.6  # [s]

    base = [Orientation("base_link", weight=50), Posture(weight=0.1)]
    lean = CenterOfMass(reference=minimum_jerk(com, target, T), kp=200, weight=100)
    stand = Controller(four, [lean, *base], cones=FrictionCone(0.6, sides=8))
    stay = CenterOfMass(reference=target, kp=200, weight=100)
    lift = stand.use(three, [stay, *base, FrameTask("FL_FOOT", a=(0.0, 0.0, 1.0), weight=20)])

    first = cp.simulate(four, q, v, at_rate(stand, 2e-3), duration=T, dt=2e-3)
    q, v = first.q[-1], first.v[-1]
    print("over three feet:", balance(three, q, v, 0 * v, np.zeros(9)))
    second = cp.simulate(three, q, v, at_rate(lift, 2e-3), duration=0.2, dt=2e-3)
    print(f"FL_FOOT is {lifted(second):.3f} m higher, on {len(three.constraints)} feet")

    down = stand.use(four, [CenterOfMass(a=(0, 0, -11.0), weight=np.inf), *base])
    print("to pull the mass down at 11 m/s^2:", down.solve(*four.state()).infeasible, sep="\n")
    if not arguments.no_view:
        cp.view(second)
    out = lift.solve(second.q[-1], second.v[-1])
    least = min(float(margin.least) for margin in out.margins.values())
    print(f"least margin {least:.3g} N; error of the program {out.residuals.kkt:.0e}")


def lifted(motion):
    """Return how far the foot rises in a motion [m]."""
    foot = cp.Scene(motion.scene.robot, motion.scene.robot.contacts[:1])
    start, end = (cp.control.support_polygon(foot, q).in_world[0] for q in motion.q[[0, -1]])
    return end[2] - start[2]


if __name__ == "__main__":
    main()
