"""Smaller scenes: what may be left out, and what it costs."""
