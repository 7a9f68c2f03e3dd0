"""Steps with contacts are judged by laws alone, without a formula of the library.

``hard_states.json`` keeps states in which something went wrong once, or is hard: many paths, long
chains of solvers, several answers, impulses that are just legal. Each runs in every build.
"""

from __future__ import annotations

import json
from pathlib import Path

import contact_judge as judge
import numpy as np
import pytest

import condyn_pin as cp

HARD = json.loads((Path(__file__).parent / "hard_states.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("seed", [11, 12])
def test_no_step_is_wrong_without_a_word(seed, capsys):
    assert not judge.judge_steps(seed, 200), capsys.readouterr().out


def test_no_derivative_is_wrong(capsys):
    assert not judge.judge_derivatives(0, 60), capsys.readouterr().out


@pytest.mark.parametrize("i", range(len(HARD)), ids=lambda i: f"{HARD[i]['why']} {i}")
def test_hard_states_are_right_or_told(i):
    kept = HARD[i]
    solids = [judge.Solid(*s[:3], np.array(s[3:])) for s in kept["solids"]]
    planes = [(np.array(plane[:3]), plane[3]) for plane in kept["planes"]]
    world = judge.made(solids, planes, [tuple(pair) for pair in kept["pairs"]])
    q, v, dt = np.array(kept["q"]), np.array(kept["v"]), kept["dt"]
    step = cp.step(world.scene, q, v, dt=dt)
    assert step.status.ok or step.notices
    if step.status.ok:
        closed, law, loose = judge.faults(world, q, v, step.q, step.v, dt)
        assert closed <= judge.MISSES or step.notices
        assert law <= 1e-6 + loose
    else:
        assert kept["why"] == "not ok"
