"""condyn_pin: every time step with contacts, and the tolerance of its solver."""

from __future__ import annotations

from time import process_time

import numpy as np

import condyn_pin as cp
from condyn_pin.contact import ADMM
from condyn_pin.simulation.motion_status import Effects
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import follow
from condyn_pin.stepping import Anitescu, SoftStep
from peers.contact import export
from peers.contact.harness import Played, Way, main
from peers.contact.scene import ContactScene

SCHEMES = {
    "Stewart-Trinkle": cp.StewartTrinkle(),
    "Stewart-Trinkle, ADMM 1e-4": cp.StewartTrinkle(contact=ADMM(tolerance=1e-4)),
    "Moreau": cp.Moreau(),
    "Anitescu": Anitescu(),
    "soft step": SoftStep(),
    "soft step, solref .01, solimp .99": SoftStep(
        solref=(0.01, 1.0), solimp=(0.99, 0.99, 1e-3, 0.5, 2.0)
    ),
}


def ways(scene: ContactScene) -> list[Way]:
    """Return all schemes that take the scene, at all steps."""
    motion = next(m for m in export.motions() if m.name == scene.name)
    return [
        way(motion, scene, title, scheme, dt)
        for title, scheme in SCHEMES.items()
        if scheme.takes_restitution or not scene.restitution
        for dt in scene.steps
        if not isinstance(scheme, SoftStep) or dt <= scheme.solref[0] / 2  # as MuJoCo wants it
    ]


def way(
    motion: export.Motion,
    scene: ContactScene,
    title: str,
    scheme: cp.simulation.ContactScheme,
    dt: float,
) -> Way:
    """Return a scheme."""
    planned = plan(
        motion.scene, 0.0, duration=scene.duration, dt=dt, integrator=scheme, drift=None,
        solver=None, record=scene.counts(dt)[0], effects=Effects(),
    )  # fmt: skip
    phase = None

    def play() -> Played:
        nonlocal phase
        begun = process_time()
        run, phase = follow(planned, motion.q, motion.v, phase=phase)
        took = process_time() - begun
        centres = np.full(np.shape(scene.truth), np.nan)
        for i, q in enumerate(run.q[1:][: len(centres)]):
            centres[i] = motion.centres(q)
        return centres, took

    return Way(title, dt, play)


if __name__ == "__main__":
    main("condyn_pin", cp.__version__, ways)
