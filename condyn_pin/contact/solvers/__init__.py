"""Contact solvers, one file each: values that answer a `ContactProblem`."""
