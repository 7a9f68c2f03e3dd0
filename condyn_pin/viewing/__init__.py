"""Pictures of robots, scenes, answers and motions, in meshcat's viewer.

A picture is a list of parts. A part is a shape that never changes, and a pose in the world that
depends on the instant: a triangle mesh with the pose of its joint, a segment that spans a gap, an
arrow as long as its force. One instant makes a still picture, many make an animation.

    bodies            shapes of each joint from `io.shapes`, skeletons without any, and contacts
    marks             marks of this library: arrows, closures, patches, balance; labels
    part, instant     parts, and the state they depend on; unilateral contacts, where they are
    motion, drawing   instants in turn, all parts of a scene, and a page that holds them
    viewer            the page in a browser, or in a headless one for a file
    plots             diagrams, by matplotlib
"""

import lazy_loader

from condyn_pin._core import forward

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
_PLOTS = ("plots_balance", "plots_contact", "plots_motion", "plots_scene")
__getattr__ = forward(__name__, _public, dict.fromkeys(_PLOTS, "viewing.plots"))
