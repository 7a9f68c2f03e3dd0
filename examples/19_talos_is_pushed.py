"""Talos shifts its weight to one foot and is pushed there: soles must neither tip nor slip.

    python examples/19_talos_is_pushed.py [--quick] [--no-view]

Needs the extra "control". The controller has one wrench for each sole, within its cone; the floor
has four corners for each, which may open and slide. An impulse of m omega d moves the capture point
by d, so it is known beforehand which push a robot can withstand without a step.
"""

import argparse

import numpy as np

import condyn_pin as cp
from condyn_pin.contact import WrenchCone
from condyn_pin.control import (
    CenterOfMass,
    Controller,
    Orientation,
    Posture,
    at_rate,
    balance,
    minimum_jerk,
)

SHIFT = np.array([0.0, 0.05, 0.0])  # [m]
PUSHED, SHARE = 0.1, 0.6  # [s], [1]


def main() -> None:
    """Shift the weight, be pushed, and look at what held it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--no-view", action="store_true")
    arguments = parser.parse_args()
    T = 0.5 if arguments.quick else 1.0  # [s]

    talos = cp.load_robot("talos")
    closed = cp.Scene(talos, talos.contacts)
    floor = cp.Scene(talos, contacts=talos.frictional_contacts(friction=0.7))
    q, v = closed.state()
    q = cp.mechanism.place_on_ground(floor, q)

    def balanced(q, v):
        return balance(closed, q, v, 0 * v, np.zeros(closed.rows))

    com = balanced(q, v).com
    tasks = [
        CenterOfMass(reference=minimum_jerk(com, com + SHIFT, T), kp=100, weight=100),
        Orientation("base_link", kp=100, weight=50),
        Posture(weight=0.1),
    ]
    controller = Controller(closed, tasks, cones=WrenchCone(0.5))

    forward = balanced(q, v).polygon.in_world[:, 0].max() - com[0]
    bound = talos.mass * np.sqrt(9.81 / com[2]) * forward
    print(f"a push of {SHARE * bound:.1f} N s; {bound:.1f} take the capture point to the toes")

    def pushed(t, q, v):
        return (SHARE * bound / PUSHED if T <= t < T + PUSHED else 0.0, 0.0, 0.0)

    answers = []
    torque = at_rate(controller, 1e-3, watch=answers.append)
    force = cp.AppliedForce("base_link", pushed)
    run = cp.simulate(floor, q, v, torque, forces=[force], duration=2 * T)
    print(run)
    margins = [balanced(q, v).capture_margin for q, v in zip(run.q, run.v, strict=True)]
    print(f"capture point within the soles by {min(margins):.3f} m at least")
    off = balanced(run.q[-1], run.v[-1]).com - com
    print(f"the weight is {off[1]:.4f} m to the left, and {off[0]:.4f} m before where it was")
    if not arguments.no_view:
        cp.view(run)
    least = min(float(m.least) for answer in answers for m in answer.margins.values())
    worst = max(answer.residuals.kkt for answer in answers)
    print(f"{len(answers)} ticks, least margin {least:.0e} N; error of the program {worst:.0e}")


if __name__ == "__main__":
    main()
