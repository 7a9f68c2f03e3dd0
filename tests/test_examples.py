"""Every example runs as it is, fits two screens, and ends by printing its own error."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def test_there_are_examples():
    assert len(EXAMPLES) >= 10


def test_the_documentation_lists_them_all():
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `examples/(\w+)\.py`", page, re.MULTILINE) == [p.stem for p in EXAMPLES]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path):
    assert len(path.read_text().splitlines()) <= 80
    result = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", str(path), "--no-view", "--quick"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    last = result.stdout.splitlines()[-1]
    assert "error" in last
    value = re.search(r"error.*?(\d\S*)", last)
    assert value
    assert float(value.group(1)) < 1e-8
