"""What accuracy costs on Cassie's closed legs, and the cheapest solver for an error that you name.

python examples/03_the_trade.py
"""

import sys

import condyn_pin as cp

quick = "--quick" in sys.argv
cassie = cp.load_robot("cassie")
legs = cp.Scene(cassie, cassie.loops)

# One method with its two parameters turned, beside methods without any; time and error of each come
# from the same run, at closed states that are the same every time.
solvers = [
    *(cp.Proximal(mu=mu, max_iterations=k) for mu in (1e-2, 1e-5, 1e-8) for k in (1, 2, 4)),
    cp.dynamics.NullSpace(),
    cp.dynamics.GaussPrinciple(),
    cp.DenseKKT(),  # needs independent rows, and these are not: its row says so
    cp.DenseKKT(mu=1e-9),
]
effort = cp.study.TimingEffort(rounds=10 if quick else 60)
table = cp.Study({"legs": legs}, solvers, states=5 if quick else 20, effort=effort).run()

shown = ("mu", "max_iterations")
print(f"{'solver':<34} {'a [us]':>7} {'worst error':>12}  statuses")
for row in sorted(table.rows, key=lambda row: row.median_us or float("inf")):
    time = f"{row.median_us:7.1f}" if row.median_us else "      -"
    parameters = ", ".join(
        f"{key}={row.parameters[key]}" for key in shown if row.parameters.get(key)
    )
    print(f"{row.method + ' ' + parameters:<34} {time} {row.error_worst:12.0e}  {row.statuses}")

print("\nNothing else is both faster and more accurate than these:")
for row in table.pareto().rows:
    print(f"  {row.median_us:6.1f} us, error {row.error_worst:.0e}: {row.solver}")

# The choice is checked at states that the study did not see before it is returned.
choice = table.cheapest(error=1e-9)
print(f"\n{choice}")
print(f"worst error of a at fresh states: relative error {choice.fresh.error:.0e}")
