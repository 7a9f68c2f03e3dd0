"""The same everywhere: one thread for the linear algebra, a plain terminal, the same examples."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: answers to the bit need it

import pytest
from hypothesis import HealthCheck, settings

# Pages are as wide and as plain as they are without a terminal, and no window opens.
_COLOURS = ("FORCE_COLOR", "CLICOLOR_FORCE", "TTY_COMPATIBLE", "TTY_INTERACTIVE")
for _name in ("COLUMNS", "TERMINAL_WIDTH", "DISPLAY", "WAYLAND_DISPLAY", *_COLOURS):
    os.environ.pop(_name, None)
os.environ |= {"MPLBACKEND": "agg", "no_proxy": "127.0.0.1"}

# The examples are the same every time, and nobody looks at the clock: machines may be slow.
# pytest --hypothesis-profile=search looks for new ones.
_slow = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("same", derandomize=True, **_slow)
settings.register_profile("search", max_examples=1000, **_slow)
settings.load_profile("same")


@pytest.fixture(autouse=True)
def seeded():
    """Let Pinocchio's random numbers not depend on the tests that ran before."""
    from condyn_pin._pin import pin

    pin.seed(0)


@pytest.fixture
def read(tmp_path):
    """Read an SDF model given as text."""
    from condyn_pin.io.sdf import read_sdf

    def read_text(body: str, version: str = "1.9", **options):
        path = tmp_path / "robot.sdf"
        path.write_text(f'<sdf version="{version}"><model name="robot">{body}</model></sdf>')
        return read_sdf(path, **options)

    return read_text
