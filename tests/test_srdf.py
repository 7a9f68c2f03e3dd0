"""SRDF as Pinocchio reads it, and without its end of the process."""

from __future__ import annotations

import random
from pathlib import Path

import crash
import fuzz
import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, robot
from urdf_texts import SWING

import condyn_pin as cp
from condyn_pin.io.urdf import read_srdf, read_urdf

STATE = '<group_state name="home" group="all">{}</group_state>'
GOOD = (
    '<robot name="r">'
    + STATE.format('<joint name="crank" value="0.5"/><joint name="elsewhere" value="1 2"/>')
    + '<rotor_params><joint name="crank" mass="0.1" gear_ratio="10"/></rotor_params></robot>'
)


def shipped() -> list[Path]:
    folder = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
    return sorted(folder.rglob("*.srdf"))


@each_row("path", shipped())
def test_those_that_are_shipped_are_read_as_pinocchio_reads_them(path):
    for urdf in sorted(path.parents[1].rglob("*.urdf"))[:2]:
        for root_joint in ("fixed", "free_flyer"):
            try:
                model = read_urdf(urdf, root_joint, mimic=False).model
            except cp.errors.InvalidModel:
                continue
            theirs, rotors = pin.Model(model), "<rotor_params" in path.read_text(encoding="utf-8")
            pin.loadReferenceConfigurations(theirs, str(path), False)
            if rotors:
                pin.loadRotorParameters(theirs, str(path), False)
            found = read_srdf(model, path, rotors=rotors)
            wanted = {
                entry.key(): np.array(entry.data()) for entry in theirs.referenceConfigurations
            }
            assert found.keys() == wanted.keys()
            for name, q in wanted.items():
                np.testing.assert_array_equal(found[name], q)
            np.testing.assert_array_equal(model.rotorInertia, theirs.rotorInertia)
            np.testing.assert_array_equal(model.rotorGearRatio, theirs.rotorGearRatio)


def read(text: str, folder: Path, *, rotors: bool = False) -> dict[str, np.ndarray]:
    path = folder / "a.srdf"
    path.write_text(text, encoding="utf-8")
    return read_srdf(pin.Model(robot("four_bar").model), path, rotors=rotors)


@pytest.mark.long
def test_joints_that_are_not_there_are_left_out(tmp_path):
    np.testing.assert_array_equal(read(GOOD, tmp_path, rotors=True)["home"], [0.5, 0.0, 0.0])
    # one that Pinocchio's reader took for a joint that moves
    text = STATE.format('<joint name="universe" value="1"/>')
    assert not read(f"<robot>{text}</robot>", tmp_path)["home"].any()


@each_row(
    ("text", "words"),
    [
        (GOOD.replace("0.5", "half"), r"<group_state> 'home': <joint> 'crank': value is 'half'"),
        (GOOD.replace("0.5", "0.5 0.5"), r"value is '0\.5 0\.5'; 1 number"),
        (GOOD.replace("0.5", "nan"), "finite numbers are needed"),
        (GOOD.replace('mass="0.1"', ""), r"<joint> 'crank': mass is None"),
        (GOOD.replace("rotor_params", "rotors"), "no <rotor_params>; leave out rotors = true"),
        ("<srdf/>", "its root element is <srdf>"),
        ("<robot>", "cannot be read as XML"),
    ],
)
def test_what_cannot_be_read_is_named(text, words, tmp_path):
    with pytest.raises(cp.errors.InvalidModel, match=rf"a\.srdf: .*{words}"):
        read(text, tmp_path, rotors=True)


def test_spoilt_ones_do_no_harm(tmp_path):
    rng = random.Random(3)
    texts = tmp_path / "texts"
    texts.write_text(repr([fuzz.spoilt(GOOD, rng) for _ in range(200)]), encoding="utf-8")
    outcome = crash.run(
        f"""
        from pathlib import Path
        import condyn_pin as cp
        import pinocchio as pin
        from condyn_pin.io.urdf import read_srdf
        path, read = Path({str(tmp_path / "a.srdf")!r}), 0
        for text in eval(Path({str(texts)!r}).read_text(encoding="utf-8")):
            path.write_text(text, encoding="utf-8")
            try:
                read_srdf(pin.Model(cp.model.four_bar().model), path, rotors=True)
                read += 1
            except cp.errors.InvalidModel as error:
                assert len(str(error)) > 20
        print(read)
        """
    )
    assert outcome.kind == "ok", outcome
    assert 0 < int(outcome.text) < 150


def with_srdf(folder: Path, *lines: str) -> cp.Robot:
    """A bar on two hinges, with the links beam, a, b and c, beside these lines of an SRDF."""
    (folder / "r.urdf").write_text(f'<robot name="r">{"".join(SWING[:7])}</robot>')
    (folder / "r.srdf").write_text(f'<robot name="r">{"".join(lines)}</robot>')
    (folder / "robot.toml").write_text(
        'name = "r"\n[description]\nfile = "r.urdf"\nsrdf = "r.srdf"\n'
    )
    return cp.load_robot(folder)


@pytest.mark.long
def test_pairs_that_do_not_collide_are_exclusions(tmp_path):
    pairs = (("a", "b"), ("b", "a"), ("a", "elsewhere"), ("a", "a"))
    lines = [f'<disable_collisions link1="{one}" link2="{two}"/>' for one, two in pairs]
    swing = with_srdf(tmp_path, *lines, '<disable_collisions link1="x"/>')
    assert swing.exclusions == {frozenset("ab")}
    (said,) = (text for text in swing.unused if "r.srdf" in text)
    assert said.endswith("does not have: elsewhere, x")


@pytest.mark.long
def test_a_link_may_collide_with_those_that_are_enabled_alone(tmp_path):
    swing = with_srdf(
        tmp_path,
        '<disable_default_collisions link="a"/>',
        '<enable_collisions link1="b" link2="a"/>',
        '<disable_collisions link1="b" link2="c"/>',
    )
    assert swing.exclusions == {frozenset(("a", "beam")), frozenset("ac"), frozenset("bc")}
    assert not [text for text in swing.unused if "srdf" in text]


@pytest.mark.long
def test_a_robot_has_the_exclusions_of_its_srdf():
    apart = cp.load_robot("talos").exclusions
    assert frozenset({"arm_left_1_link", "arm_left_2_link"}) in apart
    assert all(len(pair) == 2 for pair in apart)
