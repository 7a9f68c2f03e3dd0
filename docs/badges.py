"""The badges of the README, from what `pyproject.toml` promises and `docs/versions.md` tested.

python docs/badges.py docs/pictures/badges.svg
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEIGHT, PAD, GAP, LETTER = 20, 8, 6, 6.6  # [px]
DARK, BLUE = "#555555", "#0072B2"


def facts() -> dict[str, str]:
    """Name and value of each badge."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    pythons = re.findall(r"Python :: (3\.\d+)", "\n".join(project["classifiers"]))
    versions = (ROOT / "docs" / "versions.md").read_text("utf-8")
    (tested,) = re.findall(r"^\| Pinocchio \| ([\d., ]+) \|", versions, flags=re.MULTILINE)
    pinocchios = sorted(each.rpartition(".")[0] for each in tested.split(", "))
    return {
        "python": f"{pythons[0]} - {pythons[-1]}",
        "pinocchio": ", ".join(pinocchios),
        "tested on": "linux x86_64",
        "licence": project["license"],
    }


def badges() -> str:
    """Picture of all badges in a row."""
    x, drawn = 0.0, []
    for pair in facts().items():
        for text, colour in zip(pair, (DARK, BLUE), strict=True):
            width = LETTER * len(text) + 2 * PAD
            drawn.append(f'<rect x="{x:g}" width="{width:g}" height="{HEIGHT}" fill="{colour}"/>')
            drawn.append(f'<text x="{x + 0.5 * width:g}" y="14">{text}</text>')
            x += width
        x += GAP
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{x - GAP:g}" height="{HEIGHT}" '
        'font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" fill="#fff" '
        f'text-anchor="middle">{"".join(drawn)}</svg>\n'
    )


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(badges(), encoding="utf-8")
