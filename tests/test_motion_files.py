"""Motions, alone and of a batch, come back from files to the bit; bad files are refused."""

from __future__ import annotations

import csv
import dataclasses
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import bar, falling, hanging_cassie
from shared import robot
from test_simulate_batch import DURATION, N, assert_same, scene_of, states

import condyn_pin as cp
from condyn_pin.constraints.kinds import kind_named

NUMBERS = ("t", "q", "v", "a", "lam", "tau", "violation", "constraint_velocity", "momentum")


@pytest.fixture(scope="module")
def executor():
    with cp.Processes(2) as processes:
        yield processes


def assert_same_motion(found: cp.Trajectory, wanted: cp.Trajectory) -> None:
    """The same to the bit, but for the time that it took."""
    for name in NUMBERS:
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    for name, energy in vars(wanted.energy).items():
        np.testing.assert_array_equal(getattr(found.energy, name), energy, err_msg=name)
    assert found.forces.keys() == wanted.forces.keys()
    for name, force in wanted.forces.items():
        np.testing.assert_array_equal(found.forces[name], force, err_msg=name)
    assert found.scene == wanted.scene
    assert (found.row_names, found.notices) == (wanted.row_names, wanted.notices)
    assert dataclasses.replace(found.run, wall_time=wanted.run.wall_time) == wanted.run


def edit(path: Path, change: Callable[[dict, dict], object]) -> None:
    """Change header and arrays of a file."""
    with np.load(path) as file:
        content = dict(file)
    header = json.loads(str(content["header"]))
    change(header, content)
    np.savez(path, **{**content, "header": np.array(json.dumps(header))})


def entry(name: str, at: Any, value: Any) -> Callable[[dict, dict], object]:
    return lambda header, content: content[name].__setitem__(at, value)


CHOICES = [
    (
        "four_bar",
        {"integrator": cp.SemiImplicitEuler(), "drift": cp.simulation.PostStabilization()},
    ),
    ("four_bar", {"integrator": cp.simulation.Rattle(), "record": 7}),
    ("four_bar", {"integrator": cp.simulation.GeneralisedAlpha(), "record": 7}),
    ("cassie", {"integrator": cp.SemiImplicitEuler(), "drift": cp.simulation.Projection(every=3)}),
    ("talos feet", {"integrator": cp.RungeKutta4(), "record": 20}),
    ("talos feet", {"integrator": cp.SemiImplicitEuler(), "record": 10}),
]


@pytest.mark.parametrize(("label", "choices"), CHOICES)
def test_one_of_them_is_what_simulate_returns(label, choices, executor, tmp_path):
    scene, choices = scene_of(label), {"record": 1} | choices
    Q, V = states(scene)
    TAU = np.random.default_rng(1).normal(size=(N, scene.robot.nv))
    if label != "talos feet":  # which stands wherever it is
        Q[1, -1] += 0.4  # open
    V[3] *= 1e6  # faster than any step can follow
    batch = cp.simulate_batch(
        scene, Q, V, TAU, duration=DURATION, executor=executor, chunk=2, **choices
    )
    assert 3 in batch.failed
    batch.save(tmp_path / "batch.npz")
    again = cp.simulation.BatchTrajectory.load(tmp_path / "batch.npz")
    assert_same(again, batch)
    for i in range(N):
        if i == 1 and label != "talos feet":
            with pytest.raises(cp.errors.NotAssembled) as why:
                cp.simulate(scene, Q[i], V[i], TAU[i], duration=DURATION, **choices)
            for motions in (batch, again):
                assert motions.reasons[i] == str(why.value)
                with pytest.raises(
                    cp.errors.NotRecorded, match=r"motion 1 could not begin: .* is open"
                ):
                    motions[i]
            continue
        wanted = cp.simulate(scene, Q[i], V[i], TAU[i], duration=DURATION, **choices)
        assert bool(wanted.reason) == (i == 3)
        assert batch.violation[i] == wanted.violation.max()
        assert batch.energy_error[i] == np.abs(wanted.energy.error).max() or i == 3
        for motions in (batch, again):
            assert_same_motion(motions[i], wanted)
            assert motions[i].run.wall_time == batch.run_times[i] > 0
    assert_same_motion(pickle.loads(pickle.dumps(batch[-1])), batch[N - 1])


def small(**options: Any) -> cp.simulation.BatchTrajectory:
    """Motions of a four-bar: the second cannot begin, the fourth breaks down."""
    scene = scene_of("four_bar")
    Q, V = states(scene)
    Q[1, 0] += 0.3
    V[3] *= 1e6
    return cp.simulate_batch(scene, Q, V, **{"duration": DURATION, "record": 10} | options)


def test_some_of_them_are_a_batch():
    batch = small()
    for some in (slice(2, 4), slice(None, None, -2), batch.statuses == 0, batch.failed, [4, 0], []):
        part = batch[some]
        assert len(part) == len(batch.t[some])
        for name in ("t", "q", "statuses", "reasons", "run_times"):
            np.testing.assert_array_equal(getattr(part, name), getattr(batch, name)[some])
        np.testing.assert_array_equal(part.samples.lam, batch.samples.lam[some])
        assert not part.samples.a.flags.writeable
    assert batch[batch.failed].reasons.tolist() == [batch.reasons[1], batch.reasons[3]]
    assert_same_motion(batch[2:][1], batch[3])
    assert [len(motion) for motion in batch[batch.statuses == 0]] == [6, 6, 6]
    for i in (N, -N - 1):
        with pytest.raises(IndexError):
            batch[i]
    assert small(record=None)[2:4].samples is None


def test_a_motion_without_samples_is_named():
    with pytest.raises(cp.errors.NotRecorded, match=r"motion 2: no samples were kept; .*record=1"):
        small(record=None)[2]
    assert small(record=None).reasons[3] == small().reasons[3]
    batch = small()
    lost = dataclasses.replace(batch, statuses=np.full(N, -1, np.int8))
    with pytest.raises(cp.errors.WorkersLost, match="no worker got to motion 2"):
        lost[2]


@pytest.mark.long
def test_one_of_them_is_judged_by_cones_and_drawn(tmp_path):
    pytest.importorskip("meshcat")
    scene = scene_of("talos feet")
    Q, V = states(scene, 2)
    batch = cp.simulate_batch(scene, Q, V, duration=0.01, record=2)
    cone = cp.contact.WrenchCone(0.7)
    whole, one = cp.contact.margins(batch, cone), cp.contact.margins(batch[1], cone)
    for name, margin in one.items():
        np.testing.assert_allclose(margin.least, whole[name].least[1], rtol=1e-9, atol=1e-9)
    cp.view(batch[1], html=tmp_path / "motion.html", light=True)
    assert (tmp_path / "motion.html").stat().st_size > 10**6


@pytest.mark.long
def test_a_batch_without_samples_or_motions_can_be_in_a_file(tmp_path):
    path = tmp_path / "batch.npz"
    for batch in (small(record=None), small()[[]], small(record=None)[[]]):
        batch.save(path)
        again = cp.simulation.BatchTrajectory.load(path)
        assert_same(again, batch)
        assert str(again) == str(batch)
        assert again.reasons.tolist() == batch.reasons.tolist()
        assert not again.q.flags.writeable


@pytest.mark.long
def test_what_was_done_before_workers_were_lost_can_be_in_a_file(tmp_path):
    batch = small()
    lost = {"statuses": batch.statuses.copy(), "t": batch.t.copy(), "q": batch.q.copy()}
    lost["statuses"][4], lost["t"][4], lost["q"][4] = -1, np.nan, np.nan
    samples = dataclasses.replace(
        batch.samples, **{name: array.copy() for name, array in batch.samples.arrays.items()}
    )
    for array in samples.arrays.values():
        array[4] = np.nan
    done = dataclasses.replace(batch, samples=samples, **lost)
    done.save(tmp_path / "done.npz")
    assert_same(cp.simulation.BatchTrajectory.load(tmp_path / "done.npz"), done)


WRONG = [
    (lambda header, content: content.pop("samples_lam"), "samples_lam"),
    (lambda header, content: content.update(q=content["q"][:-1]), "q has shape"),
    (lambda header, content: content.update(t=content["t"].astype("f4")), "of float32"),
    (lambda header, content: content.update(t=np.float64(1.0)), "len"),
    (lambda header, content: content.update(samples_t=content["samples_t"][:3]), "samples_t has"),
    (lambda header, content: content.update(samples_a=content["samples_a"][:, 1:]), "samples_a"),
    (entry("samples_t", (2, 3), np.nan), "samples_t goes back, or has a gap"),
    (entry("samples_t", (2, 3), 1e-9), "samples_t goes back"),
    (entry("samples_t", 2, np.nan), "no sample of a motion that went to its end"),
    (entry("samples_lam", (2, 3, 0), np.inf), "samples_lam: a sample is not finite"),
    (entry("q", (2, 1), 7.0), "samples_q do not lead to q"),
    (entry("v", (2, 1), np.nan), "v at the ends"),
    (entry("statuses", 2, 99), "99"),
    (lambda header, content: header.update(endings=["OK"]), "OK"),
    (lambda header, content: header["reasons"].update({"9": "late"}), "there are 5 motions"),
    (lambda header, content: header["reasons"].update({"x": "late"}), "'x'"),
    (lambda header, content: header["reasons"].update({"3": 4}), "reason 4"),
    (lambda header, content: header.update(dt="fast"), "dt = 'fast'"),
    (lambda header, content: header.update(steps=-1), "steps = -1"),
    (lambda header, content: header.update(drift=header["solver"]), "drift = "),
    (lambda header, content: header.update(constraints=[header["solver"]]), "Constraint"),
    (lambda header, content: header.update(format="condyn_pin batch trajectory 7"), "nothing here"),
    (lambda header, content: header.pop("format"), "format"),
]


def test_files_that_do_not_fit_together(tmp_path):
    good, bad = tmp_path / "good.npz", tmp_path / "bad.npz"
    small().save(good)
    for change, words in WRONG:
        bad.write_bytes(good.read_bytes())
        edit(bad, change)
        with pytest.raises(cp.InvalidArgument, match=f"no file of a batch of motions.*{words}"):
            cp.simulation.BatchTrajectory.load(bad)
    bad.write_bytes(good.read_bytes())
    edit(bad, lambda header, content: None)
    assert cp.simulation.BatchTrajectory.load(bad).ok is False


@pytest.mark.parametrize(
    ("load", "array", "words"),
    [
        (cp.Trajectory.load, "q", r"q\[1\] has a quaternion"),
        (cp.simulation.BatchTrajectory.load, "samples_q", "samples_q has a quaternion that is not"),
    ],
)
def test_a_loose_quaternion_is_refused(load, array, words, tmp_path):
    scene, path = cp.Scene(robot("talos")), tmp_path / "motion.npz"
    q, v = scene.state()
    batch = cp.simulate_batch(scene, [q], [v], duration=0.003, record=1)
    (batch[0] if array == "q" else batch).save(path)
    quaternion = (slice(1, 2), slice(3, 7)) if array == "q" else (0, 1, slice(3, 7))
    edit(path, entry(array, quaternion, 1.0))
    with pytest.raises(cp.InvalidArgument, match=words):
        load(path)


def test_files_that_are_cut_short_or_of_something_else(tmp_path):
    batch, bad = tmp_path / "batch.npz", tmp_path / "bad.npz"
    small().save(batch)
    whole = batch.read_bytes()
    for size in range(0, len(whole), len(whole) // 20):
        bad.write_bytes(whole[:size])
        with pytest.raises(cp.InvalidArgument, match="no file of a batch of motions"):
            cp.simulation.BatchTrajectory.load(bad)
    np.savez(bad, x=np.zeros(3))
    with pytest.raises(cp.InvalidArgument, match="no file of a batch"):
        cp.simulation.BatchTrajectory.load(bad)
    np.savez(bad, header=np.array([{"format": "x"}], object))  # a pickle, which nobody opens
    with pytest.raises(
        cp.InvalidArgument, match=r"ValueError on reading it: header is not an array.*Batch.*\.save"
    ):
        cp.simulation.BatchTrajectory.load(bad)
    with pytest.raises(cp.InvalidArgument, match=r"no\.npz: .*No such file"):
        cp.simulation.BatchTrajectory.load(tmp_path / "no.npz")
    small()[2].save(bad)
    assert_same_motion(cp.Trajectory.load(bad), small()[2])
    with pytest.raises(cp.InvalidArgument, match=r"Trajectory\.load reads it"):
        cp.simulation.BatchTrajectory.load(bad)
    with pytest.raises(cp.InvalidArgument, match=r"BatchTrajectory\.load reads it"):
        cp.Trajectory.load(batch)


@pytest.mark.long
def test_a_file_that_is_compressed_is_read(tmp_path):
    """As those of trajectories were, and as users may make them."""
    motion, path = small()[0], tmp_path / "run.npz"
    motion.save(path)
    with np.load(path) as file:
        content = dict(file)
    np.savez_compressed(path, **content)
    assert_same_motion(cp.Trajectory.load(path), motion)


@pytest.mark.long
def test_there_is_no_pickle_in_a_file(tmp_path):
    small().save(tmp_path / "batch.npz")
    with np.load(tmp_path / "batch.npz", allow_pickle=False) as file:
        kinds = {file[name].dtype.kind for name in file.files}
    assert kinds <= set("fiU")


# --- of one motion


def save_bar(path: Path, **options: Any) -> cp.Trajectory:
    """Write a motion of 11 samples of a four-bar."""
    found = cp.simulate(*bar(), **{"duration": 0.01} | options)
    found.save(path)
    return found


@pytest.mark.long
def test_one_motion_is_saved_and_loaded(tmp_path):
    air, _ = falling()
    stop = cp.Event(
        name="stop", at=0.01, scene=cp.Scene(air.robot, [cp.constraints.PlanarContact("origin")])
    )
    for start, events in (((air, [0.0], [0.0]), [stop]), (hanging_cassie(), [])):
        found = cp.simulate(*start, duration=0.02, events=events)
        found.save(tmp_path / "run.npz")
        again = cp.Trajectory.load(tmp_path / "run.npz")
        assert_same_motion(again, found)
        assert again.run == found.run
        assert [p.scene for p in again.phases] == [p.scene for p in found.phases]
        assert str(again) == str(found)


@pytest.mark.long
def test_files_of_something_else(tmp_path):
    text, other, array = (tmp_path / name for name in ("text.npz", "other.npz", "array.npy"))
    text.write_text("no archive")
    np.savez(other, x=np.zeros(3))
    np.save(array, np.zeros(3))
    for path in (text, other, array, tmp_path / "missing.npz"):
        with pytest.raises(cp.InvalidArgument, match=rf"{path.name}: no file of a trajectory"):
            cp.Trajectory.load(path)


@pytest.mark.long
def test_files_with_a_damaged_byte(tmp_path):
    good, bad = tmp_path / "good.npz", tmp_path / "bad.npz"
    save_bar(good)
    whole, refused = good.read_bytes(), 0
    for i in range(0, len(whole), len(whole) // 60):
        bad.write_bytes(whole[:i] + bytes([whole[i] ^ 0xFF]) + whole[i + 1 :])
        try:
            cp.Trajectory.load(bad)  # a byte that says nothing, such as a date, may be any
        except cp.InvalidArgument:
            refused += 1
    assert refused > 30


def test_values_of_ones_own_and_of_numpy_can_be_in_a_file(tmp_path):
    @dataclasses.dataclass(frozen=True)
    class Mine(cp.dynamics.NullSpace):
        pass

    drift = cp.simulation.Projection(every=np.int64(2), tolerance=np.float32(1e-6))
    path = tmp_path / "run.npz"
    try:
        save_bar(path, solver=Mine(), drift=drift, duration=np.float32(0.01))
        run = cp.Trajectory.load(path).run
        assert (run.solver, run.drift) == (Mine(), drift)
    finally:
        del cp.dynamics.SOLVERS["mine"]
    with pytest.raises(cp.InvalidArgument, match="Mine is unknown: import the module"):
        cp.Trajectory.load(path)


def phase(**changes: Any) -> Callable[[dict, dict], object]:
    return lambda header, content: header["phases"][0].update(changes)


def run(**changes: Any) -> Callable[[dict, dict], object]:
    return lambda header, content: header["run"].update(changes)


def happened(**changes: Any) -> Callable[[dict, dict], object]:
    return lambda header, content: header["run"]["happened"][0].update(changes)


def array(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict, dict], object]:
    return lambda header, content: content.update({name: change(content[name])})


WRONG_OF_ONE = [
    (array("q", lambda q: q[:-1]), "q"),
    (array("t", lambda t: t[:-1]), "t"),
    (array("lam", lambda lam: lam[:, :1]), "lam"),
    (array("v", lambda v: np.nan * v), "v"),
    (array("a", lambda a: a.astype(str)), "a"),
    (array("tau", lambda tau: np.zeros(3)), "tau"),
    (array("t", lambda t: t[::-1]), "t goes back"),
    (phase(samples=[0, 3]), "do not follow 3"),
    (phase(samples=[0.5, 6]), "do not follow 0"),
    (phase(samples=[0, 0]), "do not follow 0"),
    (phase(columns=[0, 0, 1]), "3 different ones"),
    (phase(columns=[-1, 0, 1]), "3 different ones"),
    (run(dt="fast"), "dt = 'fast'"),
    (run(wall_time=None), "wall_time"),
    (lambda header, content: run(integrator=header["run"]["drift"])(header, content), "integrator"),
    (happened(sample=99), "of 12 samples"),
    (happened(sample="a"), "of 12 samples"),
    (
        lambda header, content: run(happened=[header["run"]["drift"]])(header, content),
        "of 12 samples",
    ),
]


def test_what_is_in_a_file_fits_together(tmp_path):
    """Else it breaks later on."""
    good, bad = tmp_path / "good.npz", tmp_path / "bad.npz"
    let_go = cp.Event(name="let go", at=0.005, scene=cp.Scene(robot("four_bar")))
    save_bar(good, events=[let_go])
    for change, words in WRONG_OF_ONE:
        bad.write_bytes(good.read_bytes())
        edit(bad, change)
        with pytest.raises(cp.InvalidArgument, match=f"no file of a trajectory.*{words}"):
            cp.Trajectory.load(bad)
    assert len(cp.Trajectory.load(good)) == 12


def kinds_below(kind: type) -> set[type]:
    return {kind}.union(*(kinds_below(each) for each in kind.__subclasses__()))


def test_every_kind_of_constraint_can_be_in_a_file():
    kinds = {k for k in kinds_below(cp.constraints.Constraint) if not k.__abstractmethods__}
    ours = {k for k in kinds if k.__module__.startswith("condyn_pin")}
    assert {kind_named(kind.__name__) for kind in ours} == ours


def test_energies_are_shown_in_a_line():
    energy = cp.simulate(*bar(), duration=0.01).energy
    assert repr(energy).startswith(f"Energy(11 samples, {energy.total[0]:.6g} J to ")
    assert "\n" not in repr(energy)


def test_csv(tmp_path):
    found = cp.simulate(*bar(), duration=0.01)
    found.to_csv(tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found)
    second = found.scene.robot.model.names[2]
    assert float(rows[5][f"q {second}"]) == found.q[5, 1]
    assert float(rows[5]["kinetic [J]"]) == found.energy.kinetic[5]
