"""Steering by sinusoids: a unicycle and a car with a trailer park sideways, and the DAE follows.

python examples/31_steer_by_sinusoids.py
"""

import sys

import numpy as np

import condyn_pin as cp
from condyn_pin.nonholonomic import ChainedForm, steer_by_polynomials, steer_by_sinusoids

exact = cp.simulation.DormandPrince(1e-8 if "--quick" in sys.argv else 1e-10, 1e-11)


def driven(plan):
    """Return the motion of the vehicle if two of its joints are driven along a plan."""
    return cp.simulate(plan.driven(), *plan.state(), duration=plan.duration, dt=0.2,
                       integrator=exact)  # fmt: skip


# A period of u_1 = A sin(2 pi s), u_2 = B cos(2 pi k s) moves z_(k+2), and none of those before.
disc = cp.model.unicycle()
unicycle = ChainedForm(cp.Scene(disc, disc.contacts))
parked = driven(steer_by_sinusoids(unicycle, np.zeros(4), [0, 1, 0, 0], ahead=4.0))

car = cp.model.car(trailers=1)
truck = ChainedForm(cp.Scene(car, car.contacts))
goal = np.array([0.0, 1.0, 0.1, 0.0, -0.05])  # x, y, heading, steering, hitch
ahead = goal + np.array([9.0, 0.0, 0.0, 0.0, 0.0])
backed = driven(steer_by_sinusoids(truck, np.zeros(5), goal, ahead=8.0))

# Polynomials do it at once, where the goal is further ahead or back.
passed = driven(steer_by_polynomials(truck, np.zeros(5), ahead))

if "--no-view" not in sys.argv:
    import matplotlib.pyplot as plt

    for name, run in (("unicycle", parked), ("car", backed), ("car, polynomials", passed)):
        plt.plot(run.q[:, 0], run.q[:, 1], label=name)
    plt.xlabel("x [m]")
    plt.ylabel("y [m]")
    plt.legend()
    plt.savefig("parking.png")

ends = (parked.q[-1], [0, 1, 0, 0]), (backed.q[-1], goal), (passed.q[-1], ahead)
off = max(float(np.abs(end - place).max()) for end, place in ends)
print(f"parked a metre to the side, three times: error {off:.0e} m, rad")
