"""A picture without a screen: headless Chromium draws a page into a PNG."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from condyn_pin._core.files import written_beside
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
# A picture takes some seconds. On a machine with other work Chromium hangs once in 25 starts, and
# the next one does not.
_LIMIT: Final = 60.0  # [s]
_STARTS: Final = 2

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
    chromium, said = find_chromium(), ""
    for _ in range(_STARTS):
        # a folder that is not empty when it is removed: Chromium's last processes still write there
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            picture, said, hung = _start(chromium, html, Path(folder))
            if picture.is_file():
                with written_beside(png) as new:
                    shutil.copyfile(picture, new)
                return
        if not hung:
            break
    raise BrowserFailed(f"{chromium} made no picture: {said or 'no reason'}")


def _start(chromium: str, html: str, folder: Path) -> tuple[Path, str, bool]:
    """Return where the picture should be, the last words of Chromium, and whether it hung."""
    page, picture = folder / "page.html", folder / "picture.png"
    page.write_text(html, encoding="utf-8")
    words = [
        *command(chromium, str(folder / "profile")),
        f"--window-size={SIZE[0]},{SIZE[1]}",
        f"--virtual-time-budget={_VIRTUAL}",
        f"--screenshot={picture}",
        page.as_uri(),
    ]
    try:
        done = subprocess.run(words, capture_output=True, timeout=_LIMIT, check=False)
    except subprocess.TimeoutExpired:
        return picture, f"it did not end within {_LIMIT:g} s", True
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return picture, lines[-1] if lines else "", False
