"""A picture without a screen: headless Chromium draws a page into a PNG."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from condyn_pin.errors import BrowserFailed, MissingExtra

_NAMES: Final = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome",
    "microsoft-edge", "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
)  # fmt: skip

# As without a graphics card: SwiftShader draws WebGL on the processor, and Chromium all else.
_SOFTWARE: Final = (
    "--use-gl=angle", "--use-angle=swiftshader-webgl", "--enable-unsafe-swiftshader"
)  # fmt: skip

_VIRTUAL: Final = 100  # [ms] of the page's own clock, which runs as fast as the work is done
_LIMIT: Final = 120.0  # [s]

SIZE: Final = (1280, 960)  # [px]


def find_chromium() -> str:
    """Return the path of Chromium or one of its relatives, or raise MissingExtra."""
    for name in _NAMES:
        if path := shutil.which(name):
            return path
    raise MissingExtra(
        "a PNG needs Chromium, and none is on the PATH: apt-get install chromium (Debian, Ubuntu "
        "from its own archive), or brew install --cask chromium; or write html=..., which any "
        "browser shows"
    )


def command(chromium: str, profile: str) -> list[str]:
    """Return the words that start Chromium without a screen, with a profile of its own."""
    words = [chromium, "--headless", *_SOFTWARE, "--hide-scrollbars", "--no-first-run",
             "--disable-extensions", "--disable-dev-shm-usage"]  # fmt: skip
    words.append(f"--user-data-dir={profile}")
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        words.append("--no-sandbox")  # as root it starts in no other way
    return words


def screenshot(html: str, png: Path) -> None:
    """Draw a page into a file.

    Raises
    ------
    MissingExtra
        If there is no Chromium.
    BrowserFailed
        If it made no picture; the text has its last words.
    """
    chromium = find_chromium()
    # a folder that is not empty when it is removed: Chromium's last processes still write there
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        page, picture = Path(folder, "page.html"), Path(folder, "picture.png")
        page.write_text(html, encoding="utf-8")
        words = [
            *command(chromium, str(Path(folder, "profile"))),
            f"--window-size={SIZE[0]},{SIZE[1]}",
            f"--virtual-time-budget={_VIRTUAL}",
            f"--screenshot={picture}",
            page.as_uri(),
        ]
        try:
            done = subprocess.run(words, capture_output=True, timeout=_LIMIT, check=False)
            said = done.stderr.decode(errors="replace").strip().splitlines()
        except subprocess.TimeoutExpired:
            said = [f"it did not end within {_LIMIT:g} s"]
        if not picture.is_file():
            raise BrowserFailed(f"{chromium} made no picture: {said[-1] if said else 'no reason'}")
        shutil.copyfile(picture, png)
