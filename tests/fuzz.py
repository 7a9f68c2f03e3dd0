"""Files spoilt at random, and a reader that has to survive them."""

from __future__ import annotations

import random
import re
from pathlib import Path

import crash

JUNK = ("nan", "-1", "1e400", "1e308", "0", "", "x", '"', "<", ">", "&", "é", "1_0", "universe")

READ = """
import sys
from pathlib import Path
import condyn_pin as cp
path = Path({path!r})
loaded = 0
for text in eval(Path({texts!r}).read_text(encoding="utf-8")):
    path.write_text(text, encoding="utf-8")
    try:
        robot = cp.load_robot(path)
        loaded += 1
        cp.Scene(robot, robot.loops).summary()
    except cp.CondynError as error:
        assert len(str(error)) > 20, error
    except BaseException as error:
        print(repr(error), text)
        sys.exit(1)
print("loaded", loaded)
"""


def spoilt(text: str, rng: random.Random) -> str:
    """Return a text with up to three pieces cut, doubled, exchanged or made junk."""
    for _ in range(rng.randint(1, 3)):
        i, j = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        j = min(j, i + rng.choice([1, 10, 100, len(text)]))
        values = [match.span(1) for match in re.finditer(r'="([^"]*)"', text)]
        k, m = rng.choice(values) if values else (i, j)
        k2, m2 = rng.choice(values) if values else (i, j)
        text = rng.choice(
            [
                text[:i] + text[j:],
                text[:j] + text[i:],
                text[: max(i, len(text) // 2)],
                text[:k] + rng.choice(JUNK) + text[m:],
                text[:k] + text[k2:m2] + text[m:],
            ]
        )
    return text


def assert_survived(folder: Path, name: str, text: str, seed: int, count: int = 100) -> None:
    """Load spoilt texts in an interpreter that may die; it must not, and finish in time."""
    rng = random.Random(seed)
    texts = folder / "texts"
    texts.write_text(repr([spoilt(text, rng) for _ in range(count)]), encoding="utf-8")
    outcome = crash.run(READ.format(path=str(folder / name), texts=str(texts)))
    assert outcome.kind == "ok", (seed, outcome)
