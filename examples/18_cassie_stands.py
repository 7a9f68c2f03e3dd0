"""Cassie stands on its loops and springs, is pushed, lifts a foot and puts it down again.

    python examples/18_cassie_stands.py [--quick] [--no-view]

Needs the extra "control". The floor lets feet slide and lift; the controller does not know that.
Nor does it know the springs: with springs between motor and ground no motor can command the
instantaneous force, so it treats them as rigid. They start at rest, and sink until they carry the
robot.
"""

import argparse

import numpy as np

import condyn_pin as cp
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, Orientation, Posture, at_rate, balance

PUSH, START, END = 5.0, 0.5, 0.6  # [N s], [s], [s]


def pushed(t, q, v):
    """Return the force on the pelvis, to the left [N]."""
    return (0.0, PUSH / (END - START) if START <= t < END else 0.0, 0.0)


def main() -> None:
    """Stand, be pushed, and look at what the controller asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--no-view", action="store_true")
    arguments = parser.parse_args()

    cassie = cp.load_robot("cassie")
    floor = cp.Scene(cassie, cassie.loops, contacts=cassie.frictional_contacts(friction=0.7))
    closed = cp.Scene(cassie, [*cassie.loops, *cassie.contacts])
    q, v = closed.state("standing")
    q = cp.mechanism.place_on_ground(floor, q)

    still = balance(closed, q, v, 0 * v, np.zeros(closed.rows))
    feet = still.polygon.in_world.mean(axis=0)
    print("capture point", still.capture_point.round(3), f"{still.capture_margin:.3f} m inside")
    tasks = [
        CenterOfMass(reference=(*feet[:2], still.com[2]), kp=100, weight=100),
        Orientation("pelvis", kp=100, weight=50),
        Posture(weight=0.1),
    ]
    springs = [spring.joint for spring in cassie.springs]
    controller = Controller(closed, tasks, cones=FrictionCone(0.6, sides=8), rigid=springs)

    answers = []
    run = cp.simulate(
        floor,
        q,
        v,
        at_rate(controller, 1e-3, watch=answers.append),
        forces=[cp.AppliedForce("pelvis", pushed)],
        duration=0.8 if arguments.quick else 3.0,
        dt=5e-4,
    )
    print(run)
    missing = [np.abs(answer.rigid).max() for answer in answers]
    print(f"springs lack {missing[0]:.1f} N m at the start, and {missing[-1]:.1g} N m at the end")
    off = run.t[(run.modes["right-foot/toe"] == "open") & (run.t > START)]
    print(f"the right toe is off the floor from {off[0]:.3f} to {off[-1]:.3f} s")
    if not arguments.no_view:
        cp.view(run)
    least = min(float(m.least) for answer in answers for m in answer.margins.values())
    worst = max(answer.residuals.kkt for answer in answers)
    print(f"{len(answers)} ticks, margin of the feet at least {least:.0e} N")
    print(f"loops open by {run.violation.max():.0e} m; error of the program at most {worst:.0e}")


if __name__ == "__main__":
    main()
