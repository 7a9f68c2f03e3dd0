"""The laboratory: hard questions, benchmark problems, model hierarchies, drift.

`extremes/` asks what breaks methods, `problems/` has answers from the literature, `ladders/` scenes
that become smaller rung by rung. Asked for by name; only `cli` and tests import it.
"""
