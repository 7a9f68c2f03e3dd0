"""The SDF reader: any file at all gives a model or a CondynError."""

from __future__ import annotations

import re
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from fuzz import assert_survived
from hypothesis import given
from hypothesis import strategies as st
from sdf_texts import ARM, INERTIAL, closures, couplings, frame_poses, joint, link, pose

from condyn_pin.errors import CondynError
from condyn_pin.io.description import Description
from condyn_pin.io.sdf import read_sdf

pytestmark = pytest.mark.once

GEARS = (
    "<gearbox_ratio>0.1</gearbox_ratio><gearbox_reference_body>finger</gearbox_reference_body>"
    "<axis><xyz>0 0 1</xyz></axis><axis2><xyz>0 0 -1</xyz></axis2>"
)
UPRIGHT = '<axis><xyz expressed_in="__model__">0 0 1</xyz></axis>'
CROSS = "<axis><xyz>0 0 1</xyz></axis><axis2><xyz>1 0 0</xyz></axis2>"
MIMIC = (
    '<axis><xyz>0 0 1</xyz><mimic joint="screw" axis="axis"><multiplier>2</multiplier>'
    "<offset>0.1</offset><reference>0.2</reference></mimic></axis>"
)
THREAD = "<screw_thread_pitch>0.1</screw_thread_pitch><axis><xyz>0 0 1</xyz></axis>"
# A model in the model, at the pose of its frame, with a screw that a claw follows.
HAND = (
    '<model name="hand" placement_frame="grip" canonical_link="palm">'
    + pose("0.1 0 0 0 0 90", degrees="true", relative_to="tool")
    + link("palm")
    + link("thumb", pose("0 0 0 0 0 0.6 0.8", rotation_format="quat_xyzw") + INERTIAL)
    + link("claw", "<gravity>true</gravity>" + INERTIAL)
    + '<frame name="grip" attached_to="palm">'
    + pose("0 0 0.1 0 0 0")
    + "</frame>"
    + joint("screw", "palm", "thumb", "screw", THREAD)
    + joint("follows", "palm", "claw", inside=MIMIC)
    + "</model>"
)
VALID = (
    '<sdf version="1.9"><world name="w"><gravity>0 0 -9.7</gravity>'
    '<model name="ground"><static>true</static><link name="floor"/></model><model name="m">'
    + HAND
    + joint("holds", "upper", "hand::palm", "fixed", "")
    + ARM.replace("</link>", INERTIAL + "</link>", 1)  # the base may move here
    + joint("loop", "base", "finger", "ball")
    + link("rotor")
    + joint("rotor_in", "finger", "rotor")
    + link("wheel")
    + joint(
        "wheel_out",
        "wheel",
        "finger",
        "revolute",
        '<axis><xyz expressed_in="__model__">0 0 1</xyz></axis>',
    )
    + joint("gears", "rotor", "wheel", "gearbox", GEARS)
    + joint("hooke", "upper", "rotor", "universal", CROSS)
    + "</model></world></sdf>"
)
# Ways to read it; the root is needed, for only the wheel is no joint's child.
WAYS = (
    {"root": "base"},
    {"root": "base", "as_file": True},
    {"root": "wheel", "actuated": ["shoulder", "rail"]},
    {"root": "finger", "cut": ["shoulder"]},
)
# Cut so that every second piece is a value: a text or an attribute. XML stays well-formed.
PIECES = re.split(r'(?<=[>"])([^<>"=]+)(?=[<"])', VALID)
VALUES = PIECES[1::2]
WORDS = ("", "nan", "-inf", "1e999", "1e-320", "1e300", "-1", "0", "\x00", "<", "&x;")
NAMES = ("world", "universe", "__model__", "base", "link", "joint", "model", "fixed", "universal")
STRANGE = st.one_of(st.sampled_from(WORDS + NAMES), st.sampled_from(VALUES), st.text(max_size=5))


def assert_a_model_or_a_condyn_error(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    for options in WAYS:
        try:
            robot = read_sdf(path, **options)
        except CondynError:
            continue
        assert_sound(robot)


def assert_sound(robot: Description) -> None:
    for coupling in couplings(robot):
        for name in (coupling.joint_a, coupling.joint_b):
            assert robot.model.joints[robot.model.getJointId(name)].nv == 1
    at = frame_poses(robot.model, pin.neutral(robot.model))
    for placement in at.values():
        assert np.isfinite(placement).all()
    for closure in closures(robot):
        np.testing.assert_allclose(at[closure.frame_a], at[closure.frame_b], rtol=1e-12, atol=1e-12)


@pytest.fixture(scope="module")
def fuzz_file(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "fuzz.sdf"


def test_the_file_that_is_mutated_below_is_a_valid_one(fuzz_file):
    fuzz_file.write_text(VALID)
    whole, split, back, cut = (read_sdf(fuzz_file, **options) for options in WAYS)
    assert [c.name for c in closures(whole)] == ["socket", "loop"]
    assert len(couplings(whole)) == len(couplings(back)) == len(couplings(cut)) == 2
    assert [c.kind for c in closures(split)] == ["weld"] * 3
    assert [c.name for c in closures(cut)] == ["shoulder", "socket"]


@given(edits=st.lists(st.tuples(st.integers(0, len(VALUES) - 1), STRANGE), min_size=1, max_size=3))
def test_a_file_with_strange_values_gives_a_model_or_a_condyn_error(fuzz_file, edits):
    pieces = list(PIECES)
    for at, value in edits:
        pieces[2 * at + 1] = value
    text = "".join(pieces)
    assert_a_model_or_a_condyn_error(fuzz_file, text.encode("utf-8", "surrogatepass"))


@given(data=st.data())
def test_a_file_with_elements_lost_or_moved_gives_a_model_or_a_condyn_error(fuzz_file, data):
    sdf = ElementTree.fromstring(VALID)
    for _ in range(data.draw(st.integers(1, 3))):
        places = [(owner, element) for owner in sdf.iter() for element in owner]
        if not places:
            break
        owner, element = data.draw(st.sampled_from(places))
        if data.draw(st.booleans(), label="keep the element"):
            to = data.draw(st.sampled_from([sdf, *(place[1] for place in places)]))
            to.append(deepcopy(element))
        else:
            owner.remove(element)
    assert_a_model_or_a_condyn_error(fuzz_file, ElementTree.tostring(sdf))


def test_a_spoilt_sdf_is_refused_or_read(tmp_path):
    """Cut, doubled, exchanged: in a process of its own, which has to survive."""
    assert_survived(tmp_path, "robot.sdf", VALID, seed=1)
