"""Orders of integrators: measured in q, v and lam, with every value of their parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from motions import G, bar, rod_pendulum, top
from scipy.special import ellipj, ellipk

import condyn_pin as cp

SAMPLES = 4

# How far a measured order may be from that of theory.
NEAR = 0.05

# Every step of this size: the tolerances ask for no smaller one.
LOOSE = {"relative_tolerance": 0.9, "absolute_tolerance": 0.9}

VARIANTS = [
    cp.simulation.ExplicitEuler(),
    cp.SemiImplicitEuler(),
    cp.SemiImplicitEuler(implicit=False),
    cp.simulation.Leapfrog(),
    cp.simulation.StormerVerlet(),
    cp.simulation.ImplicitMidpoint(),
    cp.simulation.LinearlyImplicitMidpoint(),
    cp.RungeKutta4(),
    cp.simulation.Rattle(),
    cp.simulation.Shake(),
    cp.simulation.CoordinatePartitioning(),
    *(cp.simulation.GeneralisedAlpha(rho=rho) for rho in (0.0, 0.5, 0.8, 0.9)),
    *(cp.simulation.RadauIIA(stages=s) for s in (1, 2, 3)),
    *(cp.simulation.GearGuptaLeimkuhler(stages=s) for s in (1, 2, 3)),
    *(cp.simulation.DormandPrince(**LOOSE, method=method) for method in (5, 8)),
    cp.StewartTrinkle(),
    cp.Moreau(),
    cp.stepping.Anitescu(),
    cp.stepping.SoftStep(),
    cp.stepping.EventDriven(),
    cp.stepping.EventDriven(cp.simulation.StormerVerlet()),
    cp.stepping.EventDriven(cp.simulation.ExplicitEuler()),
]

KINDS = [*{type(each): each for each in VARIANTS}.values()]  # the last of each


@dataclass(frozen=True)
class Motion:
    """A point mass of 1 kg on a rod of 1 m, at the angle psi(t) from the downward vertical."""

    angle: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # t -> psi, psi' [rad, rad/s]
    moment: float  # about the other end of the rod [N m]
    g: float  # [m/s^2]
    duration: float  # [s]

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and lam: the rod holds m psi'^2 + m g cos(psi)."""
        psi, rate = self.angle(t)
        along = np.stack([np.sin(psi), -np.cos(psi)], axis=1)
        across = np.stack([np.cos(psi), np.sin(psi)], axis=1)
        return along, rate[:, None] * across, (rate**2 + self.g * np.cos(psi))[:, None]

    def errors(
        self,
        integrator: cp.simulation.Integrator,
        steps: int,
        drift: cp.simulation.Drift | None = None,
    ) -> np.ndarray:
        """Return the root mean squares of the errors of q, v and lam in `steps` steps."""
        start = self.at(np.zeros(1))
        run = cp.simulate(
            rod_pendulum()[0], start[0][0], start[1][0],
            lambda t, q, v: self.moment * np.array([-q[1], q[0]]),
            duration=self.duration, dt=self.duration / steps, integrator=integrator,
            drift=drift or cp.simulation.NoDrift(), record=steps // SAMPLES, gravity=self.g > 0,
        )  # fmt: skip
        assert run.run.status.ok, run.run.reason  # coarse steps come open, as their order allows
        exact = self.at(run.t[1:])
        found = run.q[1:], run.v[1:], np.abs(run.lam[1:])
        return np.array([np.sqrt(np.mean((x - y) ** 2)) for x, y in zip(found, exact, strict=True)])


def swinging(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From rest at 1.5 rad: sin(psi / 2) = k sn(K - w t | k^2), psi' = -2 k w cn."""
    k, w = np.sin(0.75), np.sqrt(G)
    sn, cn, _, _ = ellipj(ellipk(k * k) - w * t, k * k)
    return 2 * np.arcsin(k * sn), -2 * k * w * cn


def spun_up(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At 1 rad/s first, and faster by 0.5 rad/s every second."""
    return t + 0.25 * t**2, 1 + 0.5 * t


SWING = Motion(swinging, moment=0.0, g=G, duration=0.5)
LONG_SWING = Motion(swinging, moment=0.0, g=G, duration=2.0)
SPIN = Motion(spun_up, moment=0.5, g=0.0, duration=4.0)

# How many steps of a motion show an order, by that of q: fewer are too long, more end in rounding.
SHOWN = {
    1: (SWING, 200, 400),
    2: (SWING, 192, 384),
    3: (SWING, 64, 128),
    4: (SWING, 96, 192),
    5: (SWING, 32, 64),
}
SHOWN_ADAPTIVE = {5: (LONG_SWING, 128, 256), 8: (SPIN, 32, 48)}


# The same of a four-bar or a top: how long [s], and how many steps.
SHOWN_ELSEWHERE = {
    1: (0.25, 400, 800),
    2: (0.25, 144, 288),
    3: (0.25, 64, 128),
    4: (0.25, 48, 96),
    5: (0.5, 64, 128),
}


def order(coarse: np.ndarray, fine: np.ndarray, ratio: float) -> np.ndarray:
    return np.log(coarse / fine) / np.log(ratio)


def measured(
    integrator: cp.simulation.Integrator, drift: cp.simulation.Drift | None = None
) -> np.ndarray:
    shown = SHOWN_ADAPTIVE if integrator.is_adaptive else SHOWN
    motion, few, many = shown[integrator.order.q]
    coarse, fine = (motion.errors(integrator, steps, drift) for steps in (few, many))
    return order(coarse, fine, many / few)


def check(integrator, found):
    """Those of q are met; schemes with contacts may do better in v, where nothing touches."""
    apart = found - integrator.order
    assert abs(apart[0]) < NEAR, found
    assert apart.min() > -NEAR, found
    assert integrator.takes_contacts or apart.max() < NEAR, found


@pytest.mark.once  # an order is one of the scheme; those on a group and a loop are measured on both
@pytest.mark.parametrize("integrator", VARIANTS, ids=repr)
def test_orders_are_those_of_theory(integrator):
    """Of the multiplier too, by closed forms."""
    check(integrator, measured(integrator))


@pytest.mark.once  # as above
@pytest.mark.parametrize(
    "integrator", [x for x in VARIANTS if not x.keeps_constraints and x.order.q < 8], ids=repr
)
def test_the_default_drift_control_keeps_the_orders(integrator):
    found = measured(integrator, cp.simulation.PostStabilization())
    assert np.abs(found - integrator.order).max() < NEAR, found


def test_the_orders_of_all_integrators_are_measured():
    missing = set(cp.simulation.INTEGRATORS.values()) - {type(each) for each in VARIANTS}
    assert not missing, f"VARIANTS needs {missing}, with every value of their parameters"


def run(make, duration, steps, integrator):
    scene, q, v = make()
    return cp.simulate(
        scene, q, v, duration=duration, dt=duration / steps, integrator=integrator,
        drift=cp.simulation.NoDrift(), record=steps // SAMPLES,
    )  # fmt: skip


@cache
def exact(make, duration):
    """Return a motion that is good to 1e-13."""
    return run(make, duration, 40, cp.simulation.DormandPrince(1e-13, 1e-13))


def order_on(make, integrator):
    duration, few, many = SHOWN_ELSEWHERE[integrator.order.q]
    wanted, errors = exact(make, duration), []
    for steps in (few, many):
        found = run(make, duration, steps, integrator)
        pairs = zip(wanted.q[1:], found.q[1:], strict=True)
        apart = [pin.difference(found.scene.robot.model, *pair) for pair in pairs]
        ways = (apart, found.v[1:] - wanted.v[1:], found.lam[1:] - wanted.lam[1:])
        errors.append(np.array([np.sqrt(np.mean(np.square(way))) for way in ways]))
    return order(*errors, many / few)


@pytest.mark.parametrize("integrator", [each for each in KINDS if each.order.q < 8], ids=repr)
def test_orders_on_a_group(integrator):
    """A spinning top, where velocities are no derivatives of coordinates.

    Its J does not change, and there the methods for constraints do better in v and lam.
    """
    found = order_on(top, integrator)
    assert abs(found[0] - integrator.order.q) < NEAR, found
    assert np.min(found - integrator.order) > -NEAR, found


@pytest.mark.parametrize("integrator", [each for each in KINDS if each.order.q < 5], ids=repr)
def test_orders_on_a_loop(integrator):
    """A four-bar, with redundant rows."""
    check(integrator, order_on(bar, integrator))


@pytest.mark.parametrize("method", [5, 8])
def test_the_error_of_adaptive_steps_falls_with_the_tolerance(method):
    motion, tolerances = replace(SWING, duration=8.0), 10.0 ** -np.arange(6, 11)
    errors = [motion.errors(cp.simulation.DormandPrince(x, x, method), SAMPLES) for x in tolerances]
    powers = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert np.abs(powers - 1).max() < 0.1, powers


@pytest.mark.long
def test_the_first_forces_of_implicit_euler_mean_nothing():
    """Order s - 1 = 0 for lam in the first step, as its docstring says, and 1 behind it."""
    q, v = np.array([0.0, -1.0]), np.array([3.0, 0.0])
    first, second = [], []
    for dt in (1e-3, 5e-4):
        run = cp.simulate(
            rod_pendulum()[0],
            q,
            v,
            duration=4 * dt,
            dt=dt,
            integrator=cp.simulation.RadauIIA(stages=1),
        )
        exact = run.v[:, 0] ** 2 + run.v[:, 1] ** 2 - G * run.q[:, 1]
        error = np.abs(np.abs(run.lam[:, 0]) - exact)
        first.append(error[1])
        second.append(error[2])
    assert min(first) > 4.0  # [N], of 19
    assert second[1] < 0.6 * second[0] < 0.1
