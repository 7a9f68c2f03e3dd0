"""One thread for the linear algebra, set before numpy is imported: answers to the bit need it."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# No deadline: the first call of a solver imports LAPACK. In CI the examples are always the same.
settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")


@pytest.fixture
def read(tmp_path):
    """Read an SDF model given as text."""
    from condyn_pin.io.sdf import read_sdf

    def read_text(body: str, version: str = "1.9", **options):
        path = tmp_path / "robot.sdf"
        path.write_text(f'<sdf version="{version}"><model name="robot">{body}</model></sdf>')
        return read_sdf(path, **options)

    return read_text
