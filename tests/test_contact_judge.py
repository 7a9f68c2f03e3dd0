"""Steps with contacts are judged by laws alone, without a formula of the library."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))

import contact_judge


@pytest.mark.parametrize("seed", [11, 12])
def test_no_step_is_wrong_without_a_word(seed, capsys):
    assert not contact_judge.judge_steps(seed, 200), capsys.readouterr().out


def test_no_derivative_is_wrong(capsys):
    assert not contact_judge.judge_derivatives(0, 60), capsys.readouterr().out
