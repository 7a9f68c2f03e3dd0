"""Steps, derivatives and motions with contacts, by the compiled core beside those of Python."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from test_native_contact import CORE, DT, EXACT, MOVED, ROUNDED
from test_native_step_derivatives import ROUNDED as OF_SLOPES

import condyn_pin as cp
from condyn_pin.gradients import step_derivatives_batch
from condyn_pin.gradients.routes import batch
from condyn_pin.simulation.batch import motions
from condyn_pin.stepping import BatchStep, step_batch
from condyn_pin.stepping import batch as steps


class Start(NamedTuple):
    """Where a motion begins, and what acts on it."""

    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


def at_rest(scene: cp.Scene, q: object, v: object = None, tau: object = None) -> Start:
    nv = scene.robot.nv
    v, tau = (np.zeros(nv) if x is None else np.array(x, float) for x in (v, tau))
    return Start(scene, np.array(q, float), v, tau)


def along(start: Start, duration: float) -> list[Start]:
    """States along a motion of Python and beside it, a group for each time that a scene has."""
    scene = start.scene
    run = cp.simulate(*start, duration=duration, dt=DT, integrator=EXACT)
    assert run.status.ok, run.reason
    places = np.linspace(0, len(run.t) - 1, 40).astype(int)
    V = run.v[places] + np.random.default_rng(0).normal(scale=0.02, size=(40, scene.robot.nv))
    V[::2] = run.v[places[::2]]
    if not scene.is_driven:
        return [Start(scene, run.q[places], V, start.tau)]
    return [
        Start(scene.at(run.t[k]), run.q[k][None], v[None], start.tau)
        for k, v in zip(places, V, strict=True)
    ]


@contextmanager
def by_python(monkeypatch: pytest.MonkeyPatch, owner: object, name: str) -> Iterator[list[object]]:
    """What is asked of a function of Python."""
    asked: list[object] = []
    function = getattr(owner, name)

    def counted(*args: object, **kwargs: object) -> object:
        asked.append(args)
        return function(*args, **kwargs)

    with monkeypatch.context() as held:
        held.setattr(owner, name, counted)
        yield asked


def assert_steps_of_python(
    groups: list[Start], monkeypatch: pytest.MonkeyPatch, *, unique: bool = True, left: int = 0
) -> set[int]:
    """The modes that there are. Forces are looked at if they are `unique`."""
    about, modes = {"dt": DT, "integrator": EXACT}, set()
    with by_python(monkeypatch, steps, "step") as asked:
        for group in groups:
            before = len(asked)
            found = step_batch(*group, **about, **CORE)
            of_core = len(asked)
            wanted = step_batch(*group, **about)
            del asked[of_core:]
            assert wanted.ok
            assert len(asked) - before <= len(group.q)
            assert_same_steps(found, wanted, unique=unique)
            modes |= set(np.unique(found.codes).tolist())
    assert len(asked) <= left
    return modes


def assert_same_steps(found: BatchStep, wanted: BatchStep, *, unique: bool) -> None:
    assert_array_equal(found.statuses, wanted.statuses)
    assert_array_equal(found.codes, wanted.codes)
    for name in ("q", "v", "lam") if unique else ("q", "v"):
        one, two = getattr(found, name), getattr(wanted, name)
        assert_allclose(one, two, rtol=0, atol=ROUNDED * max(1.0, np.abs(two).max()), err_msg=name)
    natural, momentum, *others = found.errors.T
    assert max(natural.max(), momentum.max()) <= 1e-12
    others = np.array(others).T[:, : None if unique else 3]
    of_python = wanted.errors[:, 2 : 2 + others.shape[1]]
    assert_allclose(others, of_python, rtol=0, atol=ROUNDED)


def assert_derivatives_of_python(
    groups: list[Start], monkeypatch: pytest.MonkeyPatch, *, left: int = 0
) -> None:
    """Relative to how much v+ changes with v; `left` states at most are Python's."""
    about, rows = {"dt": DT, "integrator": EXACT}, 0
    for group in groups:
        wanted = step_derivatives_batch(*group, **about)
        assert wanted.ok
        with by_python(monkeypatch, batch.DifferentiatedRows, "row") as asked:
            found = step_derivatives_batch(*group, **about, **CORE)
        rows += len(asked)
        assert_array_equal(found.codes, wanted.codes)
        assert_array_equal(found.one_sided, wanted.one_sided)
        assert_allclose(found.margins, wanted.margins, rtol=1e-6, atol=1e-12)
        for name in ("dq", "dv"):
            for one, two in zip(getattr(found, name), getattr(wanted, name), strict=True):
                for part in (found.columns.q, found.columns.v, found.columns.tau):
                    size = max(1.0 if part != found.columns.tau else DT, np.abs(two[:, part]).max())
                    assert_allclose(one[:, part], two[:, part], rtol=0, atol=OF_SLOPES * size)
                one, two = one[:, found.columns.friction], two[:, found.columns.friction]
                assert_allclose(
                    one, two, rtol=0, atol=OF_SLOPES * max(1.0, np.abs(two).max(initial=0))
                )
    assert rows <= left


def assert_motions_of_python(
    start: Start, duration: float, monkeypatch: pytest.MonkeyPatch, *, record: int = 7,
    unique: bool = True, left: int = 0,
) -> None:  # fmt: skip
    """Three at once; the last sample is that of a step that is not taken."""
    scene, q, v, tau = start
    about = {"duration": duration, "dt": DT, "integrator": EXACT, "record": record}
    V = np.tile(v, (3, 1)) * np.array([[1.0], [0.99], [1.02]])
    if scene.is_driven:  # they begin as the path does: Python moves one, for all
        V = np.tile(v, (3, 1))
    state = np.tile(q, (3, 1)), V, tau
    first = slice(1 if scene.is_driven else None)
    wanted = cp.simulate_batch(scene, state[0][first], V[first], tau, **about)
    assert wanted.ok
    with by_python(monkeypatch, motions.ContactSteps, "step") as asked:
        found = cp.simulate_batch(scene, *state, **about, **CORE)
    assert len(asked) <= left
    assert (found.statuses == wanted.statuses).all()
    for name in ("t", "q", "v", "lam", "contact") if unique else ("t", "q", "v"):
        one, two = np.broadcast_arrays(*(getattr(x.samples, name) for x in (found, wanted)))
        assert_allclose(one, two, rtol=0, atol=MOVED * max(1.0, np.abs(two).max()), err_msg=name)
    one, two = np.broadcast_arrays(found.samples.a, wanted.samples.a)
    assert_allclose(one, two, rtol=0, atol=MOVED / DT)
    for name in ("violation", "constraint_velocity", "energy_error"):
        one, two = np.broadcast_arrays(getattr(found, name), getattr(wanted, name))
        assert_allclose(one, two, rtol=0, atol=MOVED, err_msg=name)
