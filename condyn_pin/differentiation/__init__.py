"""Derivatives of accelerations and constraint forces."""
