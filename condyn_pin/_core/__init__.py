"""Foundations of every room.

Knows which Pinocchio is installed, and what it lacks; numbers and names as they come in; errors
and tolerances; linear algebra; files that appear whole or not at all; processes, shared memory and
threads; tables of text and the style of pictures.

Nothing here knows a robot, a constraint or a scene. Nothing here is public but the errors.
"""
