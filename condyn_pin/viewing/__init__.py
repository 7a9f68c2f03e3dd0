"""Pictures of robots, scenes, answers and motions, in meshcat's viewer.

A picture is a list of parts. A part is a shape that never changes, and a pose in the world that
depends on the instant: a triangle mesh with the pose of its joint, a segment that spans a gap, an
arrow as long as its force. One instant makes a still picture, many make an animation.

    descriptions, geoms, meshes    what the robot's description draws
    bodies            that of each joint, what stands for it where nothing is drawn, and contacts
    marks             what this library knows and shows: arrows, closures, patches, balance
    labels            words that do not cover one another
    part, instant     parts, and what they depend on; contacts that may let go, where they are
    motion, drawing   instants in turn, all parts of a scene, and a page that holds them
    viewer            who looks: a browser, or a headless one for a file
    plots_scene, plots_motion, plots_contact, plots_balance   diagrams
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
