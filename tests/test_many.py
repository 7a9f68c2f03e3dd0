"""Many states at once: their gaps are those of each alone."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from shared import all_scenes, each_scene

import condyn_pin as cp
from condyn_pin.constraints.rows.equations import MANY, BatchedGaps

ROUNDING = 1e-12  # of gaps and slips of a few units; measured: 2e-15


@each_scene
def test_gaps_of_many_states_are_those_of_each(label):
    scene = all_scenes()[label]
    model, rng = scene.robot.model, np.random.default_rng(4)
    equations = cp.Workspace(scene).equations
    many = BatchedGaps(equations)
    for count in (MANY, 3):  # what the first have left behind is not in the way of others
        home = pin.neutral(model)
        states = [
            (pin.integrate(model, home, rng.normal(size=model.nv)), rng.normal(size=model.nv))
            for _ in range(count)
        ]
        for i, state in enumerate(states):
            many.look(i, *state)
        found = many.gaps(count)
        wanted = np.array([equations.gaps(*state) for state in states]).swapaxes(0, 1)
        assert found.shape == (2, count, scene.rows)
        np.testing.assert_allclose(found, wanted, rtol=ROUNDING, atol=ROUNDING)
