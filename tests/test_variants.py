"""Variants of a robot: pieces of a config merged over it; and joints that are locked."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from sdf_texts import joint, link, pose
from shared import HAS_LCABA, each_row, robot

import condyn_pin as cp
from condyn_pin._core.models import indices
from condyn_pin.io.robot_toml import chosen_config
from condyn_pin.model.smaller import lock_joints

FREE, LOCKED = {"springs": "free"}, {"springs": "locked"}
BALL, HINGE = {"achilles": "ball"}, {"achilles": "as_file"}
SPRINGS = [
    f"{s}-{name}" for s in ("left", "right") for name in ("knee-shin-joint", "tarsus-spring-joint")
]

# nv, rows, rank, mobility; the first and the third were measured with other programs as well
CASSIES = {
    "free ball": (FREE | BALL, (32, 12, 10, 22)),
    "locked ball": (LOCKED | BALL, (28, 12, 10, 18)),
    "free hinge": (FREE | HINGE, (32, 16, 14, 18)),
    "locked hinge": (LOCKED | HINGE, (28, 16, 14, 14)),
}


@pytest.fixture(scope="module")
def cassies() -> dict[str, cp.Robot]:
    return {label: cp.load_robot("cassie", variant=v) for label, (v, _) in CASSIES.items()}


@pytest.mark.parametrize("label", CASSIES)
def test_cassies_variants_have_the_freedoms_of_their_joints_and_stand_closed(cassies, label):
    cassie = cassies[label]
    scene = cp.Scene(cassie, cassie.loops)
    rank = scene.nominal.rank
    assert (cassie.nv, scene.rows, rank, cassie.nv - rank) == CASSIES[label][1]
    assert cassie.mass == pytest.approx(32.94, abs=5e-5)
    q, v = scene.state("standing")
    moved = np.abs(q - cassie.postures["standing"]).max()
    assert moved < 1e-9 if "ball" in label else 0.01 < moved < 0.5
    tau = cassie.passive_torque(q, v)
    for solver in (cp.dynamics.Reference(), *([cp.LCABA()] if HAS_LCABA else [])):
        assert cp.solve(scene, q, v, tau, solver=solver).status.ok


def test_cassie_on_lines_is_cassie_on_points():
    points, lines = robot("cassie"), cp.load_robot("cassie", variant={"feet": "lines"})
    scenes = [cp.Scene(r, (*r.loops, *r.contacts)) for r in (points, lines)]
    assert [scene.rows for scene in scenes] == [24, 22]
    assert [scene.nominal.rank for scene in scenes] == [20, 20]
    assert lines.name == "cassie, feet lines"
    q, v = scenes[0].state("standing")
    tau = points.passive_torque(q, v)
    one, other = (cp.solve(scene, q, v, tau, solver=cp.dynamics.Reference()).a for scene in scenes)
    assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()
    for line in lines.contacts:
        for end, point in zip(line.ends(), ("toe", "heel"), strict=True):
            joint, placement = lines.frame(end.frame)
            foot = line.frame.removesuffix("/edge")
            contact = next(c for c in points.contacts if c.name == f"{foot}/{point}")
            there, edge = points.frame(contact.frame)
            assert joint == there
            np.testing.assert_allclose(
                placement.act(np.array(end.offset)), edge.act(np.array(contact.offset)), atol=1e-6
            )


@pytest.mark.long
@pytest.mark.parametrize(("name", "count"), [("panda", 1), ("talos_full", 12)])
def test_fingers_are_coupled_if_asked_for(name, count):
    coupled = cp.load_robot(name, variant={"fingers": "coupled"})
    assert len(coupled.loops) == count
    assert all(isinstance(loop, cp.constraints.Coupling) for loop in coupled.loops)
    assert robot(name).loops == ()
    scene = cp.Scene(coupled, coupled.loops)
    assert scene.nominal.mobility == coupled.nv - count
    q, v = scene.state()
    assert cp.solve(scene, q, v, np.zeros(coupled.nv), solver=cp.DenseKKT()).status.ok


@pytest.mark.long
def test_the_default_variant_is_the_first_value_of_each_option():
    cassie = robot("cassie")
    assert cassie == cp.load_robot("cassie", variant={})
    assert cassie == cp.load_robot("cassie", variant=FREE | BALL)
    assert cassie.name == "cassie"
    assert cp.load_robot("cassie", variant=LOCKED).name == "cassie, springs locked"


def test_with_springs_locked_cassie_has_neither_springs_nor_their_coordinates(cassies):
    free, locked = cassies["free ball"], cassies["locked ball"]
    assert set(free.joints) - set(locked.joints) == set(SPRINGS)
    assert locked.springs == ()
    assert locked.actuated == free.actuated
    assert locked.loops == free.loops
    assert any("joints that are locked" in said and SPRINGS[0] in said for said in locked.unused)
    at = {}
    for cassie in (free, locked):
        data = cassie.model.createData()
        pin.framesForwardKinematics(cassie.model, data, cassie.postures["standing"])
        at[cassie] = {f.name: data.oMf[i] for i, f in enumerate(cassie.model.frames)}
    assert at[free].keys() == at[locked].keys()
    for name, place in at[free].items():
        np.testing.assert_allclose(place.homogeneous, at[locked][name].homogeneous, atol=1e-14)


@pytest.mark.long
def test_the_mass_matrix_with_springs_locked_is_a_block_of_the_free_one(cassies):
    free, locked = cassies["free ball"], cassies["locked ball"]
    full, part = (
        pin.crba(c.model, c.model.createData(), c.postures["standing"]) for c in (free, locked)
    )
    _, rows = indices(free.model, locked.joints)
    np.testing.assert_allclose(np.triu(part), np.triu(full)[np.ix_(rows, rows)], atol=1e-13)


@pytest.mark.long
def test_cassie_as_the_file_has_a_hinge_at_the_heel_spring(cassies):
    kinds = {loop.name: loop.kind for loop in cassies["free hinge"].loops}
    assert {n: k for n, k in kinds.items() if "achilles" in n} == {
        f"{side}-achilles-spring-joint": "hinge" for side in ("left", "right")
    }
    assert {k for n, k in kinds.items() if "plantar" in n} == {"ball"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("variant", "says"),
    [
        ({"spring": "free"}, "no variant named 'spring'; did you mean 'springs'"),
        (
            {"springs": "lock"},
            "robot.toml: no value of the variant 'springs' named 'lock'; did you mean 'locked'",
        ),
    ],
)
def test_an_unknown_variant_is_answered_with_the_near_ones(variant, says):
    with pytest.raises(cp.errors.UnknownName, match=says):
        cp.load_robot("cassie", variant=variant)


@each_row("variant", ["springs", {"springs": 3}, {1: "free"}, ["springs"], 3])
def test_a_variant_that_is_no_mapping_of_names_is_refused(variant):
    for name in ("cassie", "four_bar"):
        with pytest.raises(cp.InvalidArgument, match="variant = "):
            cp.load_robot(name, variant=variant)


@pytest.mark.long
def test_robots_without_variants_say_so(tmp_path):
    for name in ("four_bar", "talos"):
        with pytest.raises(cp.errors.UnknownName, match="no variant named 'springs'; known: none"):
            cp.load_robot(name, variant=LOCKED)
    (tmp_path / "arm.urdf").write_text("<robot name='arm'><link name='a'/></robot>")
    with pytest.raises(cp.errors.UnknownName, match="no variant named 'springs'"):
        cp.load_robot(tmp_path / "arm.urdf", variant=LOCKED)
    with pytest.raises(cp.errors.UnknownName, match="no robot named 'cassi'"):
        cp.load_robot("cassi", variant=LOCKED)


# Configs ------------------------------------------------------------------------------------------


def test_tables_are_merged_lists_grow_and_the_rest_is_replaced():
    config = {
        "name": "x",
        "description": {"file": "a.sdf", "drop": ["j"], "kinds": {"j": "ball", "k": "ball"}},
        "postures": {"home": {"j": 1.0, "base": [0.0, 0.0, 1.0]}},
        "variants": {
            "one": {"a": {}, "b": {"description": {"drop": ["k"], "kinds": {"k": "fixed"}}}},
            "two": {
                "c": {"licence": "l"},
                "d": {"description": {"drop": ["m"], "file": "b.sdf"}},
                "e": {"postures": {"home": {"base": [0.0, 0.0, 2.0]}}},
            },
        },
    }
    assert chosen_config(config, {}) == {
        "name": "x",
        "licence": "l",
        "description": config["description"],
        "postures": config["postures"],
    }
    both = chosen_config(config, {"one": "b", "two": "d"})
    assert both["description"] == {
        "file": "b.sdf", "drop": ["j", "k", "m"], "kinds": {"j": "ball", "k": "fixed"}
    }  # fmt: skip
    assert both["name"] == "x, one b, two d"
    higher = chosen_config(config, {"two": "e"})["postures"]["home"]
    assert higher == {"j": 1.0, "base": [0.0, 0.0, 2.0]}
    assert config["description"]["drop"] == ["j"]  # the config itself stays as it is


CONFIG = 'name = "x"\nsource = "s"\nlicence = "l"\n[description]\nfile = "arm.urdf"\n'
CONFIGS = {
    "variants is a number": ("variants = 3\n" + CONFIG, "the entry variants = 3"),
    "an option is a number": (CONFIG + "[variants]\nspeed = 3", "variants.speed"),
    "an option without values": (CONFIG + "[variants.speed]", "variants.speed"),
    "a value is a number": (CONFIG + "[variants.speed]\nfast = 3", "variants.speed"),
    "a table in place of a value": (
        CONFIG + "[variants.speed.fast.description]\nfile = { a = 1 }",
        r"variants.speed.fast.description.file = \{'a': 1\} does not fit",
    ),
    "a number in place of a table": (
        CONFIG + "[variants.speed.fast]\ndescription = 3",
        "variants.speed.fast.description = 3",
    ),
    "an unknown entry": (CONFIG + "[variants.speed.fast]\nweight = 3", "no entry named 'weight'"),
    "a joint to lock that is not there": (CONFIG + 'lock = ["k"]', "no joint named 'k'"),
    "a word in place of joints to lock": (CONFIG + 'lock = "j"', "lock = 'j': a list"),
    "numbers to lock": (CONFIG + "lock = [1]", r"description.lock = .1.: a list of texts"),
    "all joints to lock": (CONFIG + 'lock = ["j"]', "leave one that moves"),
    "as_file for a URDF": (CONFIG + "as_file = true", "description.as_file is for an SDF"),
}


@each_row(("text", "says"), CONFIGS)
def test_a_wrong_config_is_refused_with_the_entry(tmp_path, text, says):
    inertial = (
        "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/>"
        "</inertial>"
    )
    (tmp_path / "robot.toml").write_text(text)
    (tmp_path / "arm.urdf").write_text(
        f"<robot name='arm'><link name='a'/><link name='b'>{inertial}</link>"
        "<joint name='j' type='continuous'><parent link='a'/><child link='b'/></joint></robot>"
    )
    with pytest.raises(cp.CondynError, match=rf"robot\.toml: .*{says}"):
        cp.load_robot(tmp_path)


@pytest.mark.parametrize(
    ("name", "says"),
    [("", "the entry 'name' is missing"), ("name = 3\n", "the entry name = 3: a text is needed")],
)
def test_a_variant_is_added_to_no_name_that_is_none(tmp_path, name, says):
    text = name + CONFIG.partition("\n")[2] + "[variants.speed.slow]\n[variants.speed.fast]"
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(cp.errors.InvalidModel, match=rf"robot\.toml: {says}"):
        cp.load_robot(tmp_path, variant={"speed": "fast"})


# What a config says about an SDF -----------------------------------------------------------------


def ring_config(folder, description: str = "") -> None:
    """Write a robot whose three links are in a ring, the last joint from c to b."""
    body = "".join(map(link, "abc")) + joint("ab", "a", "b") + joint("cb", "c", "b", "ball")
    body += joint("ac", "a", "c")
    (folder / "ring.sdf").write_text(f'<sdf version="1.9"><model name="m">{body}</model></sdf>')
    (folder / "robot.toml").write_text(
        'name = "ring"\nsource = "s"\nlicence = "l"\nactuated = ["ab"]\n'
        f'[description]\nfile = "ring.sdf"\nsrdf = "ring.srdf"\n{description}'
    )
    (folder / "ring.srdf").write_text(
        "<robot name='ring'><group_state name='home' group='all'><joint name='ab' value='0.5'/>"
        f"<joint name='cb' value='{' '.join(map(str, QUATERNION))}'/></group_state></robot>"
    )


QUATERNION = [0.1, 0.7, -0.5, 0.5]  # x y z w, of norm 1


def test_a_config_may_open_every_loop_as_pinocchio_s_parser_does(tmp_path):
    ring_config(tmp_path, "as_file = true")
    ring = cp.load_robot(tmp_path)
    assert (ring.nv, [(loop.name, loop.kind) for loop in ring.loops]) == (5, [("cb", "weld")])
    assert ring.mass == 6.0
    ring_config(tmp_path, "as_file = 3")
    with pytest.raises(cp.errors.InvalidModel, match=r"description\.as_file = 3: true or false"):
        cp.load_robot(tmp_path)
    ring_config(tmp_path, 'as_file = true\ncut = ["cb"]')
    with pytest.raises(cp.InvalidArgument, match=r"robot\.toml: cut = \['cb'\]: with as_file"):
        cp.load_robot(tmp_path)


def test_a_config_may_name_the_joint_to_cut_a_motor_too(tmp_path):
    ring_config(tmp_path, 'cut = ["ac"]')
    assert [loop.name for loop in cp.load_robot(tmp_path).loops] == ["ac"]
    ring_config(tmp_path, 'cut = ["ab"]')
    whole = cp.load_robot(tmp_path)
    assert [loop.name for loop in whole.loops] == ["ab_weld"]
    assert "ab" in whole.actuated
    q = whole.postures["home"]
    np.testing.assert_array_equal(whole.model.referenceConfigurations["home"], q)
    assert len(q) == whole.nq


@pytest.mark.long
def test_the_quaternion_of_a_ball_that_is_reversed_is_inverted_in_postures_of_an_srdf(tmp_path):
    ring_config(tmp_path, 'root = "a"\ncut = ["ac"]')  # a, b, and c below b
    q = cp.load_robot(tmp_path).postures["home"]
    np.testing.assert_allclose(q, [0.5, -0.1, -0.7, 0.5, 0.5], atol=1e-15)
    ring_config(tmp_path, 'root = "c"\ncut = ["ac"]')  # c, b, and a below b
    q = cp.load_robot(tmp_path).postures["home"]
    np.testing.assert_allclose(q, [*QUATERNION, 0.5], atol=1e-15)


# Locked joints ----------------------------------------------------------------------------------


@pytest.mark.long
def test_a_joint_is_locked_where_its_spring_rests():
    cassie = robot("cassie")
    spring = dataclasses.replace(cassie.springs[0], reference=0.3)
    bent = dataclasses.replace(cassie, springs=[spring, *cassie.springs[1:]])
    locked = lock_joints(bent, [spring.joint, "left-foot-op"])
    q = pin.neutral(cassie.model)
    q[indices(cassie.model, [spring.joint])[0]] = 0.3
    for name in ("left-foot", "left-tarsus", "right-foot"):
        at = []
        for model, where in ((cassie.model, q), (locked.model, pin.neutral(locked.model))):
            data = model.createData()
            pin.framesForwardKinematics(model, data, where)
            at.append(data.oMf[model.getFrameId(name)].homogeneous)
        np.testing.assert_allclose(at[1], at[0], atol=1e-14)
    assert "left-foot-op" not in locked.actuated
    assert len(locked.springs) == 3


@pytest.mark.long
def test_rotors_of_the_joints_that_are_left_stay():
    talos = robot("talos")
    locked = lock_joints(talos, ["arm_left_1_joint"])
    _, knee = indices(locked.model, ["leg_left_4_joint"])
    assert locked.model.armature[knee] == pytest.approx(0.1)
    assert locked.nv == talos.nv - 1


def test_coupled_joints_are_locked_together():
    talos = robot("talos")
    arms = [f"arm_{side}_1_joint" for side in ("left", "right")]
    coupled = dataclasses.replace(talos, loops=[cp.constraints.Coupling(*arms, name="both arms")])
    with pytest.raises(cp.errors.InvalidModel, match="'both arms'; lock both"):
        lock_joints(coupled, arms[:1])
    assert lock_joints(coupled, arms).loops == ()
    assert lock_joints(coupled, ["torso_1_joint"]).loops == coupled.loops


def test_a_loop_of_locked_joints_is_gone_if_closed_and_refused_if_open(read):
    # a, b, c and d in a row, a ball from a to c one metre off the axes, and c held by the world
    row = "".join(map(link, "abcd"))
    row += joint("ab", "a", "b") + joint("bc", "b", "c") + joint("cd", "c", "d")
    said = read(row + joint("ac", "a", "c", "ball", pose("1 0 0 0 0 0")))
    loops = [cp.Loop("ac_a", "ac_b", name="ac"), cp.Loop("world", "c")]
    whole = cp.Robot("row", said.model, loops=loops)
    locked = lock_joints(whole, ["ab", "bc"])
    assert (locked.joints, locked.loops) == (("cd",), ())
    assert lock_joints(whole, ["ab"]).loops == whole.loops
    bent = dataclasses.replace(whole, springs=[cp.model.Spring("ab", 1.0, 0.1)])
    with pytest.raises(cp.errors.InvalidModel, match=r"'ac' would be held open by .* mm"):
        lock_joints(bent, ["ab", "bc"])


@pytest.mark.long
def test_a_model_without_frames_of_its_joints_is_locked_too():
    model = pin.Model()
    for name in "ab":
        joint = model.addJoint(model.njoints - 1, pin.JointModelRY(), pin.SE3.Random(), name)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    locked = lock_joints(cp.Robot("bare", model), ["b"])
    assert locked.joints == ("a",)
    assert locked.mass == pytest.approx(sum(inertia.mass for inertia in model.inertias))


@pytest.mark.long
def test_contacts_of_a_body_that_is_locked_to_the_world_are_gone():
    talos = robot("talos")
    leg = [name for name in talos.joints if name.startswith("leg_left_")]
    locked = lock_joints(talos, ["root_joint", *leg])
    assert locked.contacts == talos.contacts[1:]
    assert cp.Scene(locked, locked.contacts).names == ("right_sole_link",)
    assert lock_joints(talos, []) is talos
