"""What accuracy costs: time against error.

Nouns: `Study`, `Table`, `Row`, `Measure`; `bench` times the main job, `tune` chooses a solver, and
`mujoco/` has a robot beside the same in MuJoCo. It alone looks at a clock.
"""
