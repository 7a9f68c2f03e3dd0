"""What a thread has made last: once for each of a few objects in turn, and gone with them."""

from __future__ import annotations

import gc
import pickle
import threading
from collections import Counter
from weakref import ref

import numpy as np
import pytest
from shared import all_scenes, robot

import condyn_pin as cp
from condyn_pin._core.threads import ThreadCache
from condyn_pin.constraints import Driven, HeldJoint, Sine
from condyn_pin.dynamics.compiled import CompiledCore
from condyn_pin.stepping.single_step import ProvedSteps

FOUR_BAR, SOLO = "four_bar loops", "solo12 contacts"


class Thing:
    """Something that may own what was made for it."""


class Made:
    """What refers to whom it was made for, as a workspace to its scene."""

    def __init__(self, owner: Thing) -> None:
        self.owner = owner


def test_each_of_a_few_is_made_once_and_the_oldest_goes_first():
    kept, things = ThreadCache[Made](most=2), [Thing() for _ in range(3)]
    one, two, three = things
    first, second = (kept.of(x, 0, lambda x=x: Made(x)) for x in (one, two))
    for _ in range(3):
        assert kept.of(one, 0, Thing) is first
        assert kept.of(two, 0, Thing) is second
    assert kept.of(one, 0, Thing) is first  # so that the other one is the oldest
    kept.of(three, 0, lambda: Made(three))
    assert kept.of(one, 0, Thing) is first
    gone = ref(second)
    del second
    assert gone() is None  # at once: not when somebody collects garbage
    assert kept.of(two, 0, lambda: Made(two)).owner is two
    assert kept.of(two, 1, lambda: None) is None


def test_it_goes_with_its_owner_although_it_refers_to_it():
    kept, owners = ThreadCache[Made](), [Thing()]
    gone = ref(owners[0])
    made = ref(kept.of(owners[0], "like this", lambda: Made(owners[0])))
    assert made() is not None
    owners.clear()
    gc.collect()
    assert gone() is None
    assert made() is None


def test_each_thread_has_its_own_and_takes_it_along():
    kept, thing = ThreadCache[Made](), Thing()
    mine = kept.of(thing, 0, lambda: Made(thing))
    theirs: list[ref[Made]] = []

    def work() -> None:
        made = kept.of(thing, 0, lambda: Made(thing))
        assert made is not mine
        assert kept.of(thing, 0, Thing) is made
        theirs.append(ref(made))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    gc.collect()
    assert [each() for each in theirs] == [None]
    assert kept.of(thing, 0, Thing) is mine


@pytest.mark.long
def test_what_fails_is_not_kept():
    kept, thing = ThreadCache[Thing](), Thing()
    with pytest.raises(ZeroDivisionError):
        kept.of(thing, 0, lambda: 1 / 0)
    assert isinstance(kept.of(thing, 0, Thing), Thing)


@pytest.fixture
def built(monkeypatch) -> Counter[str]:
    """How many of each were made."""
    counted: Counter[str] = Counter()

    def count(kind: type) -> None:
        begin = kind.__init__

        def wrapper(self, *args, **options):
            counted[kind.__name__] += 1
            begin(self, *args, **options)

        monkeypatch.setattr(kind, "__init__", wrapper)

    for kind in (cp.Workspace, CompiledCore, ProvedSteps):
        count(kind)
    return counted


def fresh(label: str) -> cp.Scene:
    scene = all_scenes()[label]
    return cp.Scene(scene.robot, scene.constraints)


def at_rest(scene: cp.Scene) -> tuple[np.ndarray, ...]:
    return (*scene.state(), np.zeros(scene.robot.nv))


@pytest.mark.long
def test_verbs_that_take_turns_build_a_workspace_for_each_scene(built):
    scenes = [fresh(FOUR_BAR), fresh(SOLO)]
    for _ in range(3):
        for scene in scenes:
            q, v, tau = at_rest(scene)
            cp.solve(scene, q, v, tau)
            cp.derivatives(scene, q, v, tau)
            cp.solve_batch(scene, q[None], v[None], tau)
            cp.solve(scene, q, v, tau, solver=cp.DenseKKT(mu=1e-9))
    assert built["Workspace"] == 4
    again = pickle.loads(pickle.dumps(scenes[0]))
    assert again == scenes[0]
    assert "_kept" not in vars(again)


def test_steps_that_take_turns_have_a_memory_each(built):
    robots = robot("solo12"), robot("go2")
    bodies = [cp.Scene(its, contacts=its.frictional_contacts(0.7)) for its in robots]
    for _ in range(3):
        for scene in bodies:
            q, v = scene.state()
            cp.step(scene, q, v, dt=1e-3)
    assert built["ProvedSteps"] == 2
    for _ in range(3):
        for scene in bodies:
            q, v = scene.state()
            cp.stepping.step_batch(scene, q[None], v[None], dt=1e-3)
    assert built["ProvedSteps"] == 4


@pytest.mark.long
@pytest.mark.native
def test_batches_of_the_core_that_take_turns_build_a_core_for_each_scene(built):
    scenes, executor = [fresh(FOUR_BAR), fresh(SOLO)], cp.Native(threads=1)
    for _ in range(3):
        for scene in scenes:
            q, v, tau = at_rest(scene)
            cp.solve_batch(scene, q[None], v[None], tau, executor=executor)
            cp.simulate_batch(scene, q[None], v[None], duration=2e-3, executor=executor)
    assert built["CompiledCore"] == 4  # motions have gains
    assert built["Workspace"] <= 6
    bar = cp.model.four_bar()
    crank = HeldJoint("crank", bar.postures["open"][0])
    driven = cp.Scene(bar, [*bar.loops, Driven(crank, Sine(0.3, 0.7))])
    q, v, _ = at_rest(driven.at(0.0))
    for _ in range(3):
        cp.simulate_batch(driven, q[None], v[None], duration=2e-3, executor=executor)
    assert built["CompiledCore"] == 5


@pytest.mark.long
def test_the_workspace_of_a_scene_that_was_dropped_is_released(monkeypatch):
    made: list[ref[cp.Workspace]] = []
    begin = cp.Workspace.__init__

    def wrapper(self, *args, **options):
        made.append(ref(self))
        begin(self, *args, **options)

    monkeypatch.setattr(cp.Workspace, "__init__", wrapper)
    scene = fresh(FOUR_BAR)
    cp.solve(scene, *at_rest(scene))
    gc.collect()
    assert made[-1]() is not None
    del scene
    gc.collect()
    assert [each() for each in made] == [None] * len(made)
