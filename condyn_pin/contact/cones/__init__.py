"""Friction cones: whether a floor can give the forces of contacts, which stay bilateral."""
