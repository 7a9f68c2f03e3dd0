"""Few cases of a product of parameters: of any two parameters, every pair of values.

Most defects show where two values meet, few only where three do: of solvers, scenes and properties
1/6 of the product has every pair. A product of two parameters is all pairs: where their values have
nothing to do with each other, cases with every value once are enough.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from itertools import combinations

Case = tuple[Hashable, ...]  # a value of each parameter


def cover(cases: Sequence[Case], together: int = 2) -> set[Case]:
    """Cases with every pair of values, and with every value twice; or with every value once.

    Pairs come in the order of how few cases they have. Each takes the case with most that is still
    missing; of equal ones that with the values used least; then the first.
    """

    def values(case: Case) -> list:
        return [*combinations(enumerate(case), 1)]

    def parts(case: Case) -> list:
        return [*values(case), *(combinations(enumerate(case), 2) if together == 2 else ())]

    having: dict[tuple, list[Case]] = {}
    for case in cases:
        for part in parts(case):
            having.setdefault(part, []).append(case)
    missing = Counter({part: min(together + 1 - len(part), len(of)) for part, of in having.items()})
    used, chosen = Counter(), set()
    for part in sorted(having, key=lambda part: len(having[part])):
        while missing[part] > 0:
            best = max(
                (case for case in having[part] if case not in chosen),
                key=lambda case: (
                    sum(missing[p] > 0 for p in parts(case)),
                    -sum(used[value] for value in values(case)),
                ),
            )
            chosen.add(best)
            used.update(values(best))
            missing.subtract(parts(best))
    return chosen
