"""Files of motions come back to the bit with either Pinocchio; those of strangers do no harm."""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from pathlib import Path

import fuzz_files
import numpy as np
import pinocchio as pin
import pytest
from shared import each_robot, robot

import condyn_pin as cp
from condyn_pin.io.model_words import model_of, model_words

PLAIN = ("RX", "RY", "RZ", "RUBX", "RUBY", "RUBZ", "PX", "PY", "PZ", "Translation", "Spherical",
         "SphericalZYX", "Planar", "FreeFlyer")  # fmt: skip


def unit(rng: np.random.Generator) -> np.ndarray:
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def any_angle(rng: np.random.Generator) -> object:
    """A continuous joint of a URDF: Pinocchio makes it in no other way."""
    xyz = " ".join(map(repr, unit(rng).tolist()))
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="{xyz}"/></joint></robot>'
    )
    return pin.buildModelFromXML(text).joints[1].extract()


def every_joint(rng: np.random.Generator) -> dict[str, object]:
    x, y = unit(rng), unit(rng)
    y -= x * (x @ y)
    joints = {kind: getattr(pin, f"JointModel{kind}")() for kind in PLAIN}
    joints |= {f"H{x}": getattr(pin, f"JointModelH{x}")(rng.normal()) for x in "XYZ"}
    composite = pin.JointModelComposite()
    for joint in (pin.JointModelPX(), any_angle(rng), pin.JointModelUniversal(x, unit(rng))):
        composite.addJoint(joint, pin.SE3.Random())
    return joints | {
        "HelicalUnaligned": pin.JointModelHelicalUnaligned(x, 0.3),
        "RevoluteUnaligned": pin.JointModelRevoluteUnaligned(x),
        "RevoluteUnboundedUnaligned": any_angle(rng),
        "PrismaticUnaligned": pin.JointModelPrismaticUnaligned(x),
        "Universal": pin.JointModelUniversal(x, y / np.linalg.norm(y)),
        "Ellipsoid": pin.JointModelEllipsoid(0.1, 0.2, 0.3),
        "Composite": composite,
    }


def random_model(seed: int) -> pin.Model:
    """A tree of every joint, each with limits, rotors, friction, frames of every type."""
    rng = np.random.default_rng(seed)
    model, parent = pin.Model(), 0
    for name, joint in every_joint(rng).items():
        parent = model.addJoint(parent, joint, pin.SE3.Random(), name)
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Random())
        for kind in pin.FrameType.values.values():
            frame = (f"{name} {kind}", parent, model.nframes - 1, pin.SE3.Random(), kind)
            model.addFrame(pin.Frame(*frame, pin.Inertia.Random()), False)
    model.inertias[0], model.gravity = pin.Inertia.Random(), pin.Motion.Random()
    for name in ("armature", "damping", "friction", "rotorInertia", "effortLimit", "velocityLimit"):
        setattr(model, name, rng.uniform(0, 1, model.nv))
    model.lowerPositionLimit = rng.normal(size=model.nq)
    model.referenceConfigurations["home"] = rng.normal(size=model.nq)
    model.name = "every joint \u2713"
    return model


def test_every_joint_comes_back_to_the_bit():
    known = {name for name in dir(pin) if name.startswith("JointModel")}
    found = {joint.shortname() for joint in every_joint(np.random.default_rng(0)).values()}
    assert known - found == {"JointModel", "JointModelMimic"}
    for seed in range(5):
        model = random_model(seed)
        words, arrays = model_words(model)
        again, lost = model_of(json.loads(json.dumps(words)), arrays)
        assert again == model
        assert again.saveToString() == model.saveToString()  # ellipsoids are equal to others for ==
        assert not lost


@each_robot
def test_every_robot_comes_back_to_the_bit(name):
    model = robot(name).model
    again, _ = model_of(*model_words(model))
    assert again == model
    assert again.saveToString() == model.saveToString()


@pytest.mark.long
def test_motions_of_the_sample_humanoid_come_back(tmp_path):
    """Pinocchio gives it limits of acceleration and jerk, for which Python has no names."""
    model = pin.buildSampleModelHumanoidRandom()
    scene = cp.Scene(cp.Robot("humanoid", model))
    motion = cp.simulate(scene, pin.neutral(model), np.zeros(model.nv), duration=0.01)
    motion.save(tmp_path / "m.npz")
    again = cp.Trajectory.load(tmp_path / "m.npz")
    assert np.array_equal(again.q, motion.q)
    words, numbers = model_words(again.scene.robot.model)
    assert words == model_words(model)[0]
    assert all(np.array_equal(x, numbers[name]) for name, x in model_words(model)[1].items())


def test_models_that_would_come_back_changed_are_not_saved():
    model = pin.Model(robot("four_bar").model)
    model.frames[1].name = model.frames[2].name
    model.frames[1].type = model.frames[2].type
    with pytest.raises(cp.errors.InvalidModel, match="cannot be saved"):
        model_words(model)


LIMITS = ("DryFriction", "Effort", "Velocity")


def test_a_model_of_the_other_pinocchio_is_read():
    """3.9 has one limit where 4 has two; what has no place is told."""
    words, arrays = model_words(robot("cassie").model)
    old = {k: x for k, x in arrays.items() if "ower" not in k or "Position" in k}
    old.pop("positionLimitMargin", None)
    model, lost = model_of(words, old)
    assert not lost
    assert model.saveToString() == robot("cassie").model.saveToString()
    for name in ("friction", "effortLimit", "velocityLimit", "armature", "upperPositionLimit"):
        np.testing.assert_array_equal(getattr(model, name), arrays[name])
    new = dict(arrays)
    for name, upper in zip(LIMITS, ("friction", "effortLimit", "velocityLimit"), strict=True):
        new[f"lower{name}Limit"] = -arrays[upper]
    new["lowerEffortLimit"] = np.full(len(arrays["armature"]), -3.0)
    model, lost = model_of(words, new)
    if hasattr(model, "lowerEffortLimit"):
        np.testing.assert_array_equal(model.lowerEffortLimit, -3.0)
        assert not lost
    else:
        assert [text.split()[0] for text in lost] == ["lowerEffortLimit"]


def saved(path: Path, name: str = "four_bar", *, batch: bool = False) -> bytes:
    scene = cp.Scene(robot(name), robot(name).loops)
    q, v = scene.state()
    if batch:
        cp.simulate_batch(scene, [q, q], [v, v], duration=0.005, record=1).save(path)
    else:
        cp.simulate(scene, q, v, duration=0.005).save(path)
    return path.read_bytes()


KINDS = {"motion": cp.Trajectory, "batch": cp.simulation.BatchTrajectory}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["four_bar", "stewart"])
def test_spoilt_files_do_no_harm(kind, name, tmp_path):
    whole = saved(tmp_path / "x.npz", name, batch=kind == "batch")
    reader = f"cp.{KINDS[kind].__name__}"
    loaded, memory = fuzz_files.survivors(tmp_path, reader, whole, seed=7, count=100)
    assert 0 < loaded < 60
    assert memory < 1e6  # [kB]


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_digit_of_the_model_is_no_crash(kind, tmp_path):
    """In the words of a model every number is exchanged once for each of some others."""
    path = tmp_path / "x.npz"
    whole = saved(path, batch=kind == "batch")
    members = fuzz_files.members_of(path)
    header = json.loads(str(np.load(io.BytesIO(members["header.npy"]))))
    words, files = header["robot"]["model"], 0
    for table in (*words["joints"], *words["frames"], words):
        for key in ("parent", "joint", "in", "bodies"):
            for value in (-1, 10**6, 2**63, 10**30, 1.5, True, None, "1", []):
                if key in table:
                    old, table[key] = table[key], value
                    text = np.array(json.dumps(header))
                    members["header.npy"] = fuzz_files.npy(text)
                    packed = fuzz_files.zipped(members, zipfile.ZIP_STORED)
                    (tmp_path / f"bad{files:05}.npz").write_bytes(packed)
                    files, table[key] = files + 1, old
    assert files > 50
    reader = f"cp.{KINDS[kind].__name__}"
    read, _ = fuzz_files.survivors(tmp_path, reader, whole, seed=1, count=0)
    assert read == 0


@pytest.mark.long
def test_what_nobody_asks_for_is_not_expanded(tmp_path):
    path = tmp_path / "x.npz"
    members = fuzz_files.members_of(path) if saved(path) else {}
    members["unused.npy"] = bytes(3 * 10**8)
    path.write_bytes(fuzz_files.zipped(members, zipfile.ZIP_DEFLATED))
    outcome = fuzz_files.crash.run(
        f"""
        import resource
        import condyn_pin as cp
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        cp.Trajectory.load({str(path)!r})
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        """
    )
    assert outcome.kind == "ok", outcome
    assert int(outcome.text) < 1e5  # [kB]


def test_a_file_that_becomes_too_large_is_refused_before_it_does(tmp_path):
    path = tmp_path / "x.npz"
    saved(path)
    members = fuzz_files.members_of(path)
    members["lam.npy"] += bytes(3 * 10**8)
    path.write_bytes(fuzz_files.zipped(members, zipfile.ZIP_DEFLATED))
    with pytest.raises(cp.InvalidArgument, match=r"it would take 0\.3 GB"):
        cp.Trajectory.load(path)


@pytest.mark.parametrize("kind", KINDS)
def test_files_of_before_are_refused_by_name(kind, tmp_path):
    path = tmp_path / "x.npz"
    saved(path, batch=kind == "batch")
    members = fuzz_files.members_of(path)
    header = json.loads(str(np.load(io.BytesIO(members["header.npy"]))))
    header["format"] = header["format"].replace("2", "1")
    members["header.npy"] = fuzz_files.npy(np.array(json.dumps(header)))
    path.write_bytes(fuzz_files.zipped(members, zipfile.ZIP_STORED))
    with pytest.raises(cp.InvalidArgument, match=r"an older condyn_pin.*simulate again"):
        KINDS[kind].load(path)


@pytest.mark.long
def test_a_loop_of_before_has_an_axis_that_its_kind_has_not(tmp_path):
    path = tmp_path / "x.npz"
    bar = robot("four_bar")
    scene = cp.Scene(bar, bar.loops)
    cp.simulate(scene, *scene.state(), duration=0.002).save(path)
    members = fuzz_files.members_of(path)
    header = str(np.load(io.BytesIO(members["header.npy"])))
    assert '"axis": null' in header
    older = header.replace('"axis": null', '"axis": "z"')
    members["header.npy"] = fuzz_files.npy(np.array(older))
    path.write_bytes(fuzz_files.zipped(members, zipfile.ZIP_STORED))
    assert cp.Trajectory.load(path).scene.constraints == bar.loops


@pytest.mark.long
def test_a_robot_comes_back_whole(tmp_path):
    wanted = dataclasses.replace(
        robot("cassie"), postures={"one": robot("cassie").postures["standing"]}
    )
    scene = cp.Scene(wanted, wanted.loops)
    cp.simulate(scene, *scene.state(), duration=0.002).save(tmp_path / "x.npz")
    found = cp.Trajectory.load(tmp_path / "x.npz").scene.robot
    assert found == wanted
    assert found.model.saveToString() == wanted.model.saveToString()
