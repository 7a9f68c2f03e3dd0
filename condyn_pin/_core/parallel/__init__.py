"""Processes, shared memory, and work in chunks."""
