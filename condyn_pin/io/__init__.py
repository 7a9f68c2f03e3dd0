"""Descriptions on disk: URDF, SDF, MJCF and robot.toml are read, MJCF is written.

Verbs: `load_robot`, `available_robots`, and a reader for each format, all of which return a
`Description`. Files from strangers are checked before they are read, and refused by name.

It must not know scenes, nor solve anything.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
