"""A box slides, slows down and sticks: three schemes compared with Coulomb's law.

python examples/14_slide_a_box.py
"""

import sys

import numpy as np

import condyn_pin as cp
from condyn_pin.constraints import Box
from condyn_pin.contact import ADMM

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv
size, friction, g = (0.2, 0.12, 0.08), 0.5, 9.81
box = cp.model.free_box(mass=1.0, size=size)
corners = cp.FrictionalContact("box", Box(*(edge / 2 for edge in size)), friction=friction)
scene = cp.Scene(box, contacts=[corners])

# At 1 m/s in the direction of 0.3 rad: it stops after v / (mu g), v^2 / (2 mu g) further on.
q, v = scene.state()
speed, angle = 1.0, 0.3
along = np.array([np.cos(angle), np.sin(angle)])
v[:2] = speed * along
rest, way = speed / (friction * g), speed**2 / (2 * friction * g)
print(f"it has to stop after {rest:.6f} s and {way:.6f} m")

exact = ADMM(polish=True)
schemes = (cp.StewartTrinkle(exact), cp.Moreau(exact), cp.stepping.Anitescu(exact))
for scheme in schemes[1:2] if quick else schemes:
    run = cp.simulate(scene, q, v, duration=0.3, dt=1e-3, integrator=scheme)
    slid = run.q[-1, :2] - q[:2]
    jumped = max(float(run.gaps[name].max()) for name in run.gaps if run.gaps[name][0] < 1e-9)
    print(
        f"{scheme.title:<16} {np.hypot(*slid):.6f} m at {np.arctan2(*slid[::-1]):.4f} rad, "
        f"lifts off by {1e3 * jumped:.3f} mm"
    )

# The four corners share the load in many ways: lam is one of them, the motion is the same.
now = cp.step(scene, q, v, dt=1e-3, integrator=schemes[1])
print(now)
print(f"lam unique: {now.contact.unique_forces}; sum of the forces on the box [N]:", end=" ")
print(sum(now.forces.values()).round(4))

# While it slides Moreau's scheme is exact: x = v t - mu g t^2 / 2.
run = cp.simulate(scene, q, v, duration=0.2, dt=1e-3, integrator=schemes[1])
t = run.t
x = speed * t - friction * g * t**2 / 2
off = run.q[:, :2] - q[:2] - x[:, None] * along
if show:
    cp.view(run)
print(f"way of the box while it slides: error {np.abs(off).max():.0e} m")
