"""The SDF reader: any file at all gives a model or a CondynError."""

from __future__ import annotations

import re
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdf_texts import (
    ARM,
    frame_poses,
    joint,
)

from condyn_pin.errors import CondynError
from condyn_pin.io.sdf import read_sdf

VALID = (
    '<sdf version="1.9"><model name="m">'
    + ARM
    + joint("loop", "base", "finger", "ball")
    + "</model></sdf>"
)
# Cut so that every second piece is a value: a text or an attribute. XML stays well-formed.
PIECES = re.split(r'(?<=[>"])([^<>"=]+)(?=[<"])', VALID)
VALUES = PIECES[1::2]
WORDS = ("", "nan", "-inf", "1e999", "1e-320", "1e300", "-1", "0", "\x00", "<", "&x;")
NAMES = ("world", "universe", "__model__", "base", "link", "joint", "model", "fixed", "universal")
STRANGE = st.one_of(st.sampled_from(WORDS + NAMES), st.sampled_from(VALUES), st.text(max_size=5))


def only_a_model_or_a_condyn_error(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        robot = read_sdf(path)
    except CondynError:
        return
    at = frame_poses(robot.model, pin.neutral(robot.model))
    for placement in at.values():
        assert np.isfinite(placement).all()
    for closure in robot.closures:
        np.testing.assert_allclose(at[closure.frame_a], at[closure.frame_b], rtol=1e-12, atol=1e-12)


@pytest.fixture(scope="module")
def fuzz_file(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzz") / "fuzz.sdf"


def test_the_file_that_is_mutated_below_is_a_valid_one(fuzz_file):
    fuzz_file.write_text(VALID)
    assert [c.name for c in read_sdf(fuzz_file).closures] == ["loop"]


@settings(max_examples=50, deadline=None)
@given(end=st.integers(0, len(VALID) - 1), closed=st.booleans())
def test_a_truncated_file_gives_a_condyn_error(fuzz_file, end, closed):
    tail = "</model></sdf>" if closed else ""
    only_a_model_or_a_condyn_error(fuzz_file, (VALID[:end] + tail).encode())


@settings(max_examples=300, deadline=None)
@given(edits=st.lists(st.tuples(st.integers(0, len(VALUES) - 1), STRANGE), min_size=1, max_size=3))
def test_a_file_with_strange_values_gives_a_model_or_a_condyn_error(fuzz_file, edits):
    pieces = list(PIECES)
    for at, value in edits:
        pieces[2 * at + 1] = value
    text = "".join(pieces)
    only_a_model_or_a_condyn_error(fuzz_file, text.encode("utf-8", "surrogatepass"))


@settings(max_examples=300, deadline=None)
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
    only_a_model_or_a_condyn_error(fuzz_file, ElementTree.tostring(sdf))


@settings(max_examples=50, deadline=None)
@given(at=st.integers(0, len(VALID) - 1), byte=st.integers(0, 255))
def test_a_file_with_a_wrong_byte_gives_a_model_or_a_condyn_error(fuzz_file, at, byte):
    content = bytearray(VALID.encode())
    content[at] = byte
    only_a_model_or_a_condyn_error(fuzz_file, bytes(content))
