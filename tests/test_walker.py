"""The compass walker: its equations of the literature, its step by the DAE, its limit cycle."""

from __future__ import annotations

import numpy as np
import pytest

import condyn_pin as cp

# Behind heel strike, at a slope of 3 degrees: half the angle between the legs, and two rates.
# Goswami, Thuilot and Espiau's gait has 0.2711 rad, 1.0918 and 0.3772 rad/s (four digits).
CYCLE = np.array([0.27102868, 1.09238359, 0.37737395])
STEP = 0.7343463912  # [s]
EIGENVALUES = np.array([-0.199726 - 0.544476j, -0.199726 + 0.544476j, 0.131573])


@pytest.fixture(scope="module")
def walker():
    return cp.model.compass_walker(slope=np.deg2rad(3.0))


def on_left(z):
    """Return q and v on the left foot, at the origin."""
    a, u, w = z
    s, c = -np.sin(a), np.cos(a)
    return np.array([s, c, -a, a]), np.array([c * u, -s * u, u, w])


def step(walker, z, dt=1e-3):
    """A step by the DAE: an event that is the landing of the other foot."""
    left, right = (cp.Scene(walker, [foot]) for foot in walker.contacts)

    def apart(m):
        # the swing foot returns from beyond; before that the legs pass each other
        return max(0.4 - m.t, -(m.q[2] + m.q[3]))

    landing = cp.Event(name="landing", when=apart, scene=right)
    run = cp.simulate(left, *on_left(z), duration=0.9, dt=dt, events=[landing])
    event = run.run.happened[0]
    after = run.v[event.sample]
    q = run.q[event.sample]
    return event.t, np.array([-q[3], after[3], after[2]]), run


def test_it_is_that_of_the_literature(walker):
    """M of Goswami, Thuilot and Espiau with a = b = 1/2, l = 1, in stance and swing."""
    m, m_H = 5.0, 10.0
    rng = np.random.default_rng(0)
    left = cp.Scene(walker, [walker.contacts[0]])
    for _ in range(3):
        a, b, u, w = rng.uniform(-0.5, 0.5, 4)
        s, c = np.sin(a), np.cos(a)
        q, v = np.array([s, c, a, b]), np.array([c * u, -s * u, u, w])
        M = np.array([[m_H + m + m / 4, -m / 2 * np.cos(a - b)], [-m / 2 * np.cos(a - b), m / 4]])
        N = np.array([-m / 2 * np.sin(a - b) * w**2, m / 2 * np.sin(a - b) * u**2])
        tilt = np.deg2rad(3.0)
        pull = 9.81 * np.array([(m_H + m + m / 2) * np.sin(a + tilt), -m / 2 * np.sin(b + tilt)])
        expected = np.linalg.solve(M, pull - N)
        found = cp.solve(left, q, v, np.zeros(4)).a[2:]
        assert found == pytest.approx(expected, abs=1e-10)


def test_the_cycle_comes_back_by_the_dae(walker):
    T, z, run = step(walker, CYCLE)
    assert pytest.approx(STEP, abs=1e-8) == T
    assert z == pytest.approx(CYCLE, abs=2e-8)  # eight digits are written above
    assert run.violation.max() < 1e-10
    assert run.run.happened[0].energy_lost > 1.0


def test_its_eigenvalues_by_differences_of_the_dae(walker):
    h = 1e-4
    columns = [
        (step(walker, CYCLE + h * e)[1] - step(walker, CYCLE - h * e)[1]) / (2 * h)
        for e in np.eye(3)
    ]
    found = np.sort_complex(np.linalg.eigvals(np.array(columns).T))
    assert found == pytest.approx(EIGENVALUES, abs=2e-5)


@pytest.mark.long
def test_it_walks_on_from_beside_the_cycle(walker):
    z = CYCLE + np.array([0.005, 0.02, -0.02])
    for _ in range(8):
        z = step(walker, z, dt=4e-3)[1]
    assert z == pytest.approx(CYCLE, abs=1e-3)


@pytest.mark.long
def test_sizes_are_refused():
    with pytest.raises(cp.InvalidArgument, match="hip"):
        cp.model.compass_walker(hip=0.0)
    with pytest.raises(cp.InvalidArgument, match="slope"):
        cp.model.compass_walker(slope=np.nan)
