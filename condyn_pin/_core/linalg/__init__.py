"""Linear algebra of the two equations: saddle-point solves, numerical rank, exact residuals."""
