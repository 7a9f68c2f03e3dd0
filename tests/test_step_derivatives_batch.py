"""Derivatives of one step from many states: those of `step(...).derivatives(...)`."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from shared import robot

import condyn_pin as cp
from condyn_pin.errors import InvalidArgument, SolveFailed
from condyn_pin.gradients import BatchStepDerivatives, Kappa, Softened, step_derivatives_batch
from condyn_pin.stepping import step_batch

DT = 1e-3


def solo() -> tuple[cp.Scene, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Solo12 0.1 mm in the floor, pushed about: the scene, and five states."""
    its = robot("solo12")
    scene = cp.Scene(its, contacts=its.frictional_contacts(0.7))
    q = scene.state()[0].copy()
    q[2] -= max(cp.dynamics.contact_gaps(scene, q).values()) + 1e-4
    rng = np.random.default_rng(0)
    V = rng.normal(scale=0.3, size=(5, its.nv))
    return scene, (np.tile(q, (5, 1)), V, rng.normal(size=(5, its.nv)))


BLOCKS = ("dq_dq", "dq_dv", "dq_dtau", "dv_dq", "dv_dv", "dv_dtau")


@pytest.mark.parametrize("about", [{}, {"route": Kappa(1e-6)}, {"wrt": ["inertias"]}])
def test_they_are_those_of_each_step(about: dict) -> None:
    scene, states = solo()
    found = step_derivatives_batch(scene, *states, dt=DT, **about)
    assert found.ok
    assert len(found) == 5
    for i, (one, q, v, tau) in enumerate(zip(found, *states, strict=True)):
        taken = cp.step(scene, q, v, tau, dt=DT)
        wanted = taken.derivatives(**about)
        assert_array_equal(found.step.v[i], taken.v)
        assert_array_equal(one.v, wanted.v)
        for block in BLOCKS:
            assert_array_equal(getattr(one, block), getattr(wanted, block))
            assert_array_equal(getattr(found, block)[i], getattr(wanted, block))
        assert one.parameters == found.parameters == wanted.parameters
        for parameter in wanted.parameters:
            assert_array_equal(one.by(parameter), wanted.by(parameter))
            assert_array_equal(found.by(parameter)[i], wanted.by(parameter))
        assert (one.modes, one.margin) == (wanted.modes, wanted.margin)
        assert {name: modes[i] for name, modes in found.modes.items()} == wanted.modes
    assert_array_equal(found.one_sided, [each.one_sided for each in found])


@pytest.mark.long
@pytest.mark.parametrize("verb", [step_batch, step_derivatives_batch])
def test_arrays_of_the_caller_stay_his_own(verb) -> None:
    scene, states = solo()
    found = verb(scene, *states, dt=DT)
    before = found.q.copy()
    for array in states:
        array += 1.0  # not read-only, and nobody else's
    assert_array_equal(found.q, before)
    kept = found if verb is step_batch else found.step
    assert np.abs(kept.q0 - states[0]).min() == 1.0
    assert np.abs(kept.v0 - states[1]).min() > 0.9


@pytest.mark.long
def test_processes_return_the_same_bits() -> None:
    scene, states = solo()
    here = step_derivatives_batch(scene, *states, dt=DT)
    with cp.Processes(2) as workers:
        there = step_derivatives_batch(scene, *states, dt=DT, executor=workers, chunk=2)
    for name in ("q", "v", "dq", "dv", "codes", "margins"):
        assert_array_equal(getattr(there, name), getattr(here, name))


def test_a_part_of_a_batch() -> None:
    scene, states = solo()
    found = step_derivatives_batch(scene, *states, dt=DT, route=Softened())
    some = found[1:3]
    assert isinstance(some, BatchStepDerivatives)
    assert_array_equal(some.dv_dq, found.dv_dq[1:3])
    assert_array_equal(some.step.q0, found.step.q0[1:3])
    assert repr(some) == f"BatchStepDerivatives({Softened()!r}: 2 states)"
    with pytest.raises(ValueError, match="read-only"):
        some.dv[0, 0, 0] = 1.0


def test_a_step_without_derivatives_says_why() -> None:
    scene, (Q, V, tau) = solo()
    V = V.copy()
    V[2] = 1e200
    found = step_derivatives_batch(scene, Q, V, tau, dt=DT)
    assert_array_equal(found.failed, [2])
    assert not found.ok
    assert np.isnan(found.dv[2]).all()
    assert np.isfinite(found.dv[[0, 1, 3, 4]]).all()
    assert found.reasons[2]
    assert not any(found.reasons[[0, 1, 3, 4]])
    with pytest.raises(SolveFailed, match="state 2"):
        found[2]
    assert "1 without" in repr(found)


def test_no_states_and_no_contacts() -> None:
    scene, (Q, V, tau) = solo()
    none = step_derivatives_batch(scene, Q[:0], V[:0], tau[:0], dt=DT)
    assert len(none) == 0
    assert none.ok
    free = cp.Scene(scene.robot)
    found = step_derivatives_batch(free, Q, V, dt=DT)
    assert found.ok
    assert not found.modes
    assert not found.one_sided.any()


def test_what_cannot_be_used_is_named() -> None:
    scene, states = solo()
    for about, words in (
        ({"route": "kappa"}, "route = 'kappa'"),
        ({"wrt": "friction"}, "a list of names"),
        ({"wrt": ["solref"]}, "solref"),
        ({"dt": -1.0}, "dt"),
    ):
        with pytest.raises(InvalidArgument, match=words):
            step_derivatives_batch(scene, *states, **({"dt": DT} | about))
