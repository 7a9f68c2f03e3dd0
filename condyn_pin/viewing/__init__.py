"""Pictures of robots, scenes, answers and motions, in meshcat's viewer.

A picture is a list of parts. A part is a shape that never changes, and a pose in the world that
depends on the instant: a triangle mesh with the pose of its joint, a segment that spans a gap, an
arrow as long as its force. One instant makes a still picture, many make an animation.

    descriptions, geoms, meshes    what the robot's description draws
    bodies                         that of each joint, or what stands for it where nothing is drawn
    marks, closures, arrows        what this library knows and shows
    balance_marks                  where a robot presses on the floor, and what it may fall over
    touching, touches              contacts that may let go: where they are, and how they are drawn
    labels                         words that do not cover one another
    part, instant, motion, drawing  parts, instants, and all parts of a scene
    three, page                    the words of meshcat's viewer, and a page that holds them
    viewer, server, chromium       who looks: a browser, or a headless one for a file
    plots_scene, plots_motion, plots_contact, plots_balance   diagrams
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
