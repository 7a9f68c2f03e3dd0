"""The figures of the documentation, drawn from the library itself.

python docs/figures.py docs/_figures
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
import numpy as np
from matplotlib import pyplot as plt

import condyn_pin as cp
from condyn_pin._core.show import COLOURS, style

BLUE, ORANGE, GREEN, *_, GREY = COLOURS  # told apart by colour-blind eyes
STYLE = {"svg.hashsalt": "condyn_pin", "font.size": 9, "lines.linewidth": 1.6}


def cut() -> Any:
    """Draw a four-bar closed and cut open: what a loop says, and what the tree is."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    closed, _ = scene.state()
    opened = closed + np.array([0.0, 0.25, 0.2])
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 2.9), sharex=True, sharey=True)
    for ax, q, title in zip(
        axes, (closed, opened), ("closed: c(q) = 0", "cut: a tree"), strict=True
    ):
        chains = _chains(bar, q)
        for chain, colour in zip(chains, (BLUE, GREEN), strict=True):
            ax.plot(*chain.T, "-", color=colour, solid_capstyle="round", lw=4)
            ax.plot(*chain[:-1].T, "o", color="white", mec="black", ms=7)
        tips = np.array([chain[-1] for chain in chains])
        ax.plot(*tips.T, "--", color=ORANGE, lw=1.2)
        ax.plot(*tips.T, "s", color="white", mec=ORANGE, mew=1.8, ms=7)
        ax.set(title=title, aspect="equal", xticks=[], yticks=[])
        ax.margins(0.12)
    axes[1].annotate("coupler_tip", tips[0], (-72, 2), textcoords="offset points", color=BLUE)
    axes[1].annotate("rocker_tip", tips[1], (-66, -50), textcoords="offset points", color=GREEN)
    return figure


def _chains(bar: cp.Robot, q: Any) -> list[Any]:
    """Return the points of crank and coupler, and of the rocker, in the plane x z."""
    import pinocchio as pin

    data = bar.model.createData()
    pin.framesForwardKinematics(bar.model, data, q)

    def tip(name: str) -> Any:
        joint, placement = bar.frame(name)
        return (data.oMi[joint] * placement).translation[[0, 2]]

    def at(name: str) -> Any:
        return data.oMi[bar.model.getJointId(name)].translation[[0, 2]]

    names = bar.joints
    return [
        np.array([at(names[0]), at(names[1]), tip("coupler_tip")]),
        np.array([at(names[2]), tip("rocker_tip")]),
    ]


def loop() -> Any:
    """Draw the two frames of a loop, r between them, and on whom the force is."""
    figure, ax = plt.subplots(figsize=(6.4, 2.7))
    one, two, up = np.array([1.5, 0.6]), np.array([2.9, 1.1]), np.array([0.1, 0.85])
    _body(ax, np.array([0.2, 0.1]), one, BLUE, "body 1, of the first frame")
    _body(ax, np.array([4.3, 0.3]), two, GREEN, "body 2, of the second frame")
    _frame(ax, one, 0.25, "c1", (0.1, -0.22))
    _frame(ax, two, -0.35, "c2", (0.34, 0.02))
    _arrow(ax, one, two, GREY, "r = c2 in c1", (-0.75, 0.16))
    _arrow(ax, two, two + up, BLUE, "lam: on body 1, axes of c1", (0.08, -0.05))
    _arrow(ax, two, two - up, GREEN, "- lam: on body 2", (-0.6, -0.2))
    ax.set(xlim=(-0.1, 5.6), ylim=(-0.2, 2.1), aspect="equal")
    ax.axis("off")
    return figure


def contact() -> Any:
    """Draw a foot on the ground: the force is the one on the robot."""
    figure, ax = plt.subplots(figsize=(6.4, 2.3))
    ax.fill_between([-1.0, 4.6], -0.25, 0.0, color="0.9", lw=0)
    ax.plot([-1.0, 4.6], [0, 0], color="0.4", lw=1.2)
    ax.fill([0.2, 1.4, 1.2, 0.75, 0.6, 0.2], [0, 0, 0.2, 0.3, 0.9, 0.9], color=BLUE, alpha=0.25)
    ax.text(0.32, 0.95, "robot", color=BLUE)
    _frame(ax, np.array([0.8, 0.0]), 0.0, "frame of the contact", (0.42, -0.2))
    _arrow(
        ax,
        np.array([0.8, 0.0]),
        np.array([0.8, 1.5]),
        ORANGE,
        "lam: of the ground on the robot",
        (0.1, 0.0),
    )
    ax.text(
        1.6,
        0.85,
        "a foot that stands: lam_z > 0\na foot held down: lam_z < 0,\nand a notice names it",
    )
    ax.set(xlim=(-1.0, 4.6), ylim=(-0.3, 1.7), aspect="equal")
    ax.axis("off")
    return figure


def stability_limit() -> Any:
    """Draw what semi-implicit Euler makes of critical Baumgarte gains: the limit at 0.828."""
    x = np.linspace(0.0, 1.2, 400)  # alpha dt
    radius = [_radius(value) for value in x]
    figure, ax = plt.subplots(figsize=(6.4, 2.7))
    ax.plot(x, radius, color=BLUE)
    ax.axhline(1.0, color=GREY, lw=0.9, ls="--")
    edge = 2.0 * (np.sqrt(2.0) - 1.0)
    ax.axvline(edge, color=ORANGE, lw=0.9, ls="--")
    ax.annotate(
        f"alpha dt = {edge:.3f}", (edge, 0.2), (6, 0), textcoords="offset points", color=ORANGE
    )
    ax.set(
        xlabel="alpha dt [1], with beta = alpha",
        ylabel="growth of a gap per step [1]",
        ylim=(0, 2.2),
    )
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def _radius(x: float) -> float:
    """Spectral radius of c'' = -2 alpha c' - alpha^2 c under semi-implicit Euler, dt = 1."""
    step = np.array([[1 - x**2, 1 - 2 * x], [-(x**2), 1 - 2 * x]])
    return float(np.abs(np.linalg.eigvals(step)).max())


def drift() -> Any:
    """Draw the gap of a four-bar over time, with stabilisation and without."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    figure, ax = plt.subplots(figsize=(6.4, 2.9))
    runs = {
        "semi-implicit Euler": (cp.SemiImplicitEuler(), cp.simulation.NoDrift(), ORANGE, "-"),
        "Runge-Kutta 4": (cp.RungeKutta4(), cp.simulation.NoDrift(), BLUE, "-"),
        "Runge-Kutta 4, Baumgarte": (cp.RungeKutta4(), cp.Baumgarte.critical(30.0), BLUE, "--"),
        "Runge-Kutta 4, projection": (cp.RungeKutta4(), cp.simulation.Projection(), GREEN, "--"),
    }
    for label, (integrator, scheme, colour, line) in runs.items():
        run = cp.simulate(scene, q, v, duration=5.0, dt=2e-3, integrator=integrator, drift=scheme)
        gap = np.maximum.accumulate(run.violation)
        ax.loglog(run.t[1:], np.maximum(gap[1:], 1e-17), line, color=colour, label=label)
    ax.set(xlabel="t [s]", ylabel="largest gap so far [m]", xlim=(2e-2, 5.0))
    ax.legend(frameon=False, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=8)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def _body(ax: Any, start: Any, end: Any, colour: str, text: str) -> None:
    ax.plot(*np.array([start, end]).T, color=colour, lw=12, alpha=0.25, solid_capstyle="round")
    ax.text(start[0] - 0.2, start[1] - 0.25, text, color=colour)


def _frame(ax: Any, origin: Any, turn: float, text: str, where: tuple[float, float]) -> None:
    for angle, colour in ((turn, "#CC0000"), (turn + np.pi / 2, "#2040CC")):
        _arrow(ax, origin, origin + 0.35 * np.array([np.cos(angle), np.sin(angle)]), colour)
    ax.plot(*origin, "ko", ms=3)
    ax.text(*(origin + where), text)


def _arrow(
    ax: Any, start: Any, end: Any, colour: str, text: str = "", where: tuple[float, float] = (0, 0)
) -> None:
    ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
    place = end if text.startswith(("lam", "-")) else (np.asarray(start) + end) / 2
    ax.text(*(place + where), text, color=colour)


FIGURES: tuple[Callable[[], Any], ...] = (cut, loop, contact, stability_limit, drift)


def draw(folder: Path) -> None:
    """Draw every figure as an svg of its name."""
    folder.mkdir(parents=True, exist_ok=True)
    with style("screen"), plt.rc_context(STYLE):
        for make in FIGURES:
            figure = make()
            figure.savefig(
                folder / f"{make.__name__}.svg", bbox_inches="tight", metadata={"Date": None}
            )
            plt.close(figure)


def setup(app: Any) -> dict[str, bool]:
    """Draw them before the pages are read."""
    app.connect("builder-inited", lambda app: draw(Path(app.srcdir) / "_figures"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
