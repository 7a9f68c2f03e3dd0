"""Constraints as rows: bound to a model, and the two equations that they make."""
