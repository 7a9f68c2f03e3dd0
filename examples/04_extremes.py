"""Where methods lose digits: a parallelogram that gets flat, a bar too heavy, a rod too light.

python examples/04_extremes.py
"""

import sys
from pathlib import Path

import condyn_pin as cp

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))  # cases that measure the library
import lab

quick = "--quick" in sys.argv
methods = {
    "Proximal": cp.Proximal(),
    "DenseKKT, mu 1e-9": cp.DenseKKT(mu=1e-9),
    "NullSpace": cp.dynamics.NullSpace(),
    "ConjugateGradient": cp.dynamics.ConjugateGradient(),
}


def ask(name: str, severity: float, solver: cp.dynamics.Solver) -> tuple[lab.Verdict, float]:
    """Return what a method makes of a case, and its error where there is an answer."""
    try:
        case = lab.EXTREMES[name].case(severity, seed=0)
        right = lab.right_answers(case)  # in closed form, or by Reference
        verdict, error, _ = lab.judge(case, solver, right)
    except cp.CondynError:  # no such machine, or rows that the method does not take
        return lab.Verdict.REFUSED, float("nan")
    return verdict, error


# A family is a hard case whose severity grows, from easy to absurd. Every answer is judged: right;
# reported as inaccurate or singular; refused; or wrong but reported as ok.
worst, wrong = 0.0, 0
for name in ("parallelogram", "mass_ratio", "light_rod", "near_points", "straight_knee"):
    severities = lab.EXTREMES[name].severities[:: 3 if quick else 1]
    print(f"\n{name}: {lab.EXTREMES[name].title}")
    print(f"{'':<18}" + "".join(f"{severity:>9.0e}" for severity in severities))
    for label, solver in methods.items():
        cells = []
        for severity in severities:
            verdict, error = ask(name, severity, solver)
            ok = verdict is lab.Verdict.OK
            worst = max(worst, error) if ok else worst
            wrong += verdict is lab.Verdict.WRONG
            cells.append(f"{error:.0e}" if ok else verdict.name.lower())
        print(f"{label:<18}" + "".join(f"{cell:>9}" for cell in cells))

print("\nsaid_so: inaccurate or singular, with a status that says so.")
print(f"{wrong} wrong; of all that said ok, the worst has a relative error {worst:.0e}")
