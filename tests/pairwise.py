"""Few cases of a product of parameters: of any two parameters, every pair of values.

Most defects show where two values meet, few only where three do: of solvers, scenes and properties
1/6 of the product does. A product of two parameters is all pairs: of it, every value comes twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from itertools import combinations

Case = tuple[Hashable, ...]  # a value of each parameter


def cover(cases: Sequence[Case]) -> set[Case]:
    """Cases with every value twice; of three parameters or more, with every pair of values too.

    Pairs come in the order of how few cases they have. Each takes the case with most that is still
    missing; of equal ones that with the values used least; then the first.
    """
    columns = [tuple(map(column.index, column)) for column in zip(*cases, strict=True)]
    several = [i for i, column in enumerate(columns) if column not in columns[:i]]

    def values(case: Case) -> list:
        return [((i, case[i]),) for i in several]

    def parts(case: Case) -> list:
        pairs = combinations(((i, case[i]) for i in several), 2)
        return [*values(case), *(pairs if len(several) > 2 else ())]

    having: dict[tuple, list[Case]] = {}
    for case in cases:
        for part in parts(case):
            having.setdefault(part, []).append(case)
    missing = Counter({part: min(3 - len(part), len(of)) for part, of in having.items()})
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
