"""Partial derivatives by q and v of the rows of constraints, and of their forces."""
