"""Simulation: a scene in motion."""
