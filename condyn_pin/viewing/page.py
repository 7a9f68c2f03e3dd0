"""One page that holds everything: meshcat's viewer, and the commands that draw."""

from __future__ import annotations

import html
import importlib.util
from collections.abc import Iterable
from pathlib import Path

from condyn_pin._core.arrays import Array
from condyn_pin.errors import MissingExtra
from condyn_pin.viewing.three import Command, packed

# The commands are decoded at once, in order and without a request, so that a page that is loaded
# is drawn, also from a disk.
_PAGE = """<!DOCTYPE html>
<html>
<head><meta charset="utf-8"><title>{title}</title>
<style>
body {{ margin: 0; }}
#meshcat-pane {{ width: 100vw; height: 100vh; overflow: hidden; }}
#legend {{ position: absolute; left: 12px; top: 10px; font: 13px sans-serif; color: #222;
  background: rgba(255, 255, 255, 0.75); padding: 6px 10px; border-radius: 4px; }}
#legend b {{ display: inline-block; width: 11px; height: 11px; margin-right: 6px; }}
#labels {{ position: absolute; left: 0; top: 0; width: 100vw; height: 100vh;
  pointer-events: none; }}
#player {{ position: absolute; left: 12px; right: 12px; bottom: 10px; display: none; gap: 10px;
  align-items: center; font: 13px sans-serif; color: #222; background: rgba(255, 255, 255, 0.85);
  padding: 6px 10px; border-radius: 4px; }}
#player .play {{ width: 40px; }}
#player .time {{ flex: 1; }}
#player .clock, #player .times {{ width: 62px; font-variant-numeric: tabular-nums; }}
</style></head>
<body>
<div id="meshcat-pane"></div>
<canvas id="labels"></canvas>
<div id="legend">{legend}</div>
<div id="player" data-speed="{speed}"><button class="play" aria-label="play or pause"></button>
<input class="time" type="range" min="0" step="any" value="0" aria-label="time">
<span class="clock"></span><span>speed</span>
<input class="speed" type="range" min="-5" max="3" step="any" value="0" aria-label="speed">
<span class="times">1.0 x</span></div>
<script>{script}</script>
<script>
{lamp}
{viewer}
function draw(text) {{
  viewer.handle_command_bytearray(Uint8Array.from(atob(text), c => c.charCodeAt(0)));
}}
{commands}
viewer.renderer.setClearColor("white", 1);  // cheaper than a background that is drawn
viewer.camera.fov = 50;
viewer.camera.position.set(...{position});
viewer.controls.target.set(...{target});
viewer.controls.update();
{scripts}
</script>
</body>
</html>
"""

# Lambert's law for every face, with a lamp beside the eye:
#
#     colour = (0.6 + 0.4 n . l) diffuse
#
# with n the normal of the face and l towards the lamp. three.js knows this law for corners only,
# and its Phong, with the three lamps of meshcat, takes a processor three times as long.
_LAMP = """
MeshCat.THREE.ShaderLib.lambert.vertexShader = `
  varying vec3 point;
  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    point = seen.xyz;
    gl_Position = projectionMatrix * seen;
  }`;
MeshCat.THREE.ShaderLib.lambert.fragmentShader = `
  uniform vec3 diffuse;
  uniform float opacity;
  varying vec3 point;
  void main() {
    vec3 n = normalize(cross(dFdx(point), dFdy(point)));
    gl_FragColor = vec4((0.6 + 0.4 * dot(n, vec3(0.36, 0.48, 0.8))) * diffuse, opacity);
  }`;
"""

# A graphics card smooths edges for nothing. On a processor that is half of the time of a picture:
# there edges are smoothed by more pixels, of what rests.
_VIEWER = """
let pane = document.getElementById("meshcat-pane");
let probe = document.createElement("canvas").getContext("webgl2");
let known = probe && probe.getExtension("WEBGL_debug_renderer_info");
let card = known ? probe.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
var software = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(card);
let renderer = new MeshCat.THREE.WebGLRenderer({antialias: !software, alpha: true});
pane.appendChild(renderer.domElement);
var viewer = new MeshCat.Viewer(pane, false, renderer);
"""
_SCRIPTS = [Path(__file__).with_name(f"{name}.js") for name in ("labels", "player", "pace")]

_MISSING = (
    'pictures in a browser need meshcat and trimesh: python -m pip install "condyn_pin[view]"'
)


def page(
    title: str,
    legend: Iterable[tuple[str, str]],
    commands: Iterable[Command],
    *,
    camera: Array,
    target: Array,
    speed: float = 1.0,
) -> str:
    """Return the page.

    Parameters
    ----------
    title : str
    legend : iterable of (str, str)
        Colours, as CSS names them, and what they mean; a text without colour is a line alone.
    commands : iterable of Command
    camera, target : (3,) array
        Where the camera is, and what it looks at and turns about [m].
    speed : float
        Seconds of a motion that are played in one second.
    """
    lines = [_patch(colour) + html.escape(text) for colour, text in legend]
    return _PAGE.format(
        title=html.escape(title),
        legend="<br>".join(lines),
        script=_script(),
        lamp=_LAMP,
        viewer=_VIEWER,
        commands="\n".join(f'draw("{packed(command)}");' for command in commands),
        position=_y_up(camera),
        target=_y_up(target),
        speed=speed,
        scripts="\n".join(path.read_text(encoding="utf-8") for path in _SCRIPTS),
    )


def _y_up(point: Array) -> list[float]:
    """Return a point in the axes of three.js."""
    x, y, z = (float(each) for each in point)
    return [x, z, -y]


def _patch(colour: str) -> str:
    return f"<b style='background: {colour}'></b>" if colour else ""


def require_meshcat() -> Path:
    """Return the folder of meshcat, which is not imported, or raise MissingExtra."""
    found = importlib.util.find_spec("meshcat")
    if found is None or not found.submodule_search_locations:
        raise MissingExtra(_MISSING)
    for module in ("umsgpack", "PIL", "trimesh", "collada"):
        if importlib.util.find_spec(module) is None:
            raise MissingExtra(_MISSING)
    return Path(found.submodule_search_locations[0])


def _script() -> str:
    """Return meshcat's viewer, of which no text ends the element that it stands in."""
    path = require_meshcat() / "viewer" / "dist" / "main.min.js"
    return path.read_text(encoding="utf-8").replace("</script", "<\\/script")
