"""Installed wheels of condyn_pin and its compiled core give the answers of Python.

`make wheels` runs it in a clean environment, outside the checkout.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import condyn_pin as cp
from condyn_pin._core.compiled import core_features
from condyn_pin.contact import FrictionCone, SemismoothNewton
from condyn_pin.control import Controller, Posture
from condyn_pin.simulation import derivatives_batch, sample_batch


def near(one: np.ndarray, two: np.ndarray, share: float = 1e-9) -> bool:
    """True if two arrays agree relative to the largest number, or to 1."""
    return bool(np.abs(one - two).max() <= share * max(1.0, float(np.abs(two).max())))


def main() -> None:
    """Compare solves, derivatives, motions, contact steps, a tick and a recursion."""
    installed = Path(cp.__file__).parents[1]
    assert installed.name == "site-packages", f"condyn_pin is that of {installed}"
    for name, is_there in core_features().items():
        assert is_there.startswith("yes"), f"{name}: {is_there}"
    core = cp.Native(threads=2)

    cassie = cp.load_robot("cassie")
    legs = cp.Scene(cassie, cassie.loops)
    Q, V = sample_batch(legs, 20, np.random.default_rng(0))
    for verb, names in ((cp.solve_batch, ("a", "lam")), (derivatives_batch, ("da_dq", "dlam_dv"))):
        found, wanted = verb(legs, Q, V, 0, executor=core), verb(legs, Q, V, 0)
        assert all(near(getattr(found, name), getattr(wanted, name)) for name in names)
    one = cp.Workspace(legs, engine="core").solve(Q[0], V[0], 0)
    assert near(one.a, cp.Workspace(legs).solve(Q[0], V[0], 0).a)

    solo = cp.load_robot("solo12")
    floor = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
    q, v = (np.tile(each, (4, 1)) for each in floor.state())
    by = cp.StewartTrinkle(contact=SemismoothNewton())
    about = {"duration": 0.05, "dt": 1e-3, "integrator": by}
    found = cp.simulate_batch(floor, q, v, executor=core, **about)
    wanted = cp.simulate_batch(floor, q[:1], v[:1], **about)
    assert found.ok
    assert near(found.q, wanted.q)

    stands = cp.Scene(solo, solo.contacts)
    ticks = [
        Controller(stands, [Posture()], cones=FrictionCone(0.6, sides=8), engine=engine)
        for engine in ("core", "python")
    ]
    found, wanted = (tick.solve(*stands.state()) for tick in ticks)
    assert near(found.tau, wanted.tau, 1e-7)

    feet, state = cp.Scene(solo, solo.contacts), stands.state()
    found = cp.solve(feet, *state, 0, solver=cp.dynamics.ConstrainedABA())
    assert near(found.a, cp.Workspace(feet).solve(*state, 0).a, 1e-7)


if __name__ == "__main__":
    main()
