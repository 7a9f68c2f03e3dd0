"""Where convex models of contact differ from Coulomb's law: a box that slides, rests and sticks.

    python benchmarks/contact_models.py [--from-json]

writes benchmarks/results/contact_models.json and the tables of docs/contact-models.md; with
--from-json the tables alone, from the committed results. Nothing here is timed. MuJoCo is measured
itself: its plane, its box, elliptic cones, and solref and solimp as they are by default.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin.constraints import Box
from condyn_pin.contact import ADMM, SAP
from condyn_pin.stepping import Anitescu, SoftStep

RESULTS = Path(__file__).resolve().parent / "results" / "contact_models.json"
PAGE = "docs/contact-models.md"

HALF = (0.1, 0.06, 0.04)  # half of the edges of the box [m]
MASS, GRAVITY = 1.0, 9.81  # [kg], [m/s^2]
STEPS = (1e-2, 1e-3, 1e-4)  # [s]
SLIDE, SPEED, ANGLE = 0.5, 1.0, 0.3  # friction, [m/s], [rad]
SLOPE, STICK = 0.3, 0.7  # [rad], friction: tan(0.3) = 0.309


def stiffest(dt: float) -> SoftStep:
    """Return the stiffest contacts that MuJoCo allows: a timeconst of two steps."""
    return SoftStep(SAP(), solref=(2 * dt, 1.0), solimp=(0.99, 0.999, 1e-3, 0.5, 2.0))


SCHEMES: dict[str, Callable[[float], cp.simulation.Integrator]] = {
    "`StewartTrinkle`": lambda dt: cp.StewartTrinkle(ADMM(polish=True)),
    "`Moreau`": lambda dt: cp.Moreau(ADMM(polish=True)),
    "`Anitescu`": lambda dt: Anitescu(ADMM(polish=True)),
    "`SoftStep`": lambda dt: SoftStep(SAP()),
    "`SoftStep`, stiffest": stiffest,
}
MUJOCO = "MuJoCo"


@dataclass(frozen=True)
class Found:
    """What one model makes of both questions with one step.

    Attributes
    ----------
    model : str
    dt : float
        [s]
    way, heading : float
        Of the box that slides until it stops [m], [rad].
    hop : float
        How far its lowest corner comes off the floor [m].
    deep : float
        How far its deepest corner comes below it, in either question [m].
    creep : float
        What the box that friction holds comes down the slope in a second [m].
    """

    model: str
    dt: float
    way: float
    heading: float
    hop: float
    deep: float
    creep: float


Run = Callable[[np.ndarray, np.ndarray, float, float, float], tuple[np.ndarray, np.ndarray]]


def ours(scheme: Callable[[float], cp.simulation.Integrator]) -> Run:
    """Return what simulates a box on a floor by a scheme."""

    def run(
        gravity: np.ndarray, v: np.ndarray, friction: float, dt: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray]:
        box = cp.model.free_box(mass=MASS, size=tuple(2 * x for x in HALF))
        box.model.gravity.linear = gravity
        box = cp.Robot("box", box.model, postures=box.postures)
        scene = cp.Scene(box, contacts=[cp.FrictionalContact("box", Box(*HALF), friction=friction)])
        motion = cp.simulate(
            scene, scene.state()[0], v, duration=duration, dt=dt, integrator=scheme(dt)
        )
        lowest = np.min(list(motion.gaps.values()), axis=0)
        return motion.q[:, :2], lowest

    return run


def mujoco_run(
    gravity: np.ndarray, v: np.ndarray, friction: float, dt: float, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate the same by MuJoCo."""
    import mujoco

    x, y, z = HALF
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco>
      <option timestep="{dt!r}" cone="elliptic" gravity="{gravity[0]} {gravity[1]} {gravity[2]}"/>
      <worldbody>
        <geom type="plane" size="5 5 1" friction="{friction} 0 0" condim="3"/>
        <body pos="0 0 {z}"><freejoint/>
          <geom type="box" size="{x} {y} {z}" mass="{MASS}" friction="{friction} 0 0" condim="3"/>
        </body>
      </worldbody>
    </mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:] = v
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1) * np.array(HALF)[:, None]
    places, lowest = [data.qpos[:2].copy()], [0.0]
    for _ in range(round(duration / dt)):
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        places.append(data.qpos[:2].copy())
        corners = data.xmat[1].reshape(3, 3) @ signs + data.xpos[1][:, None]
        lowest.append(float(corners[2].min()))
    return np.array(places), np.array(lowest)


def measured() -> Iterator[Found]:
    """Yield what every model makes of both questions, with every step."""
    runs = {name: ours(scheme) for name, scheme in SCHEMES.items()} | {MUJOCO: mujoco_run}
    down, still = np.array([0.0, 0.0, -GRAVITY]), np.zeros(6)
    along = GRAVITY * np.array([np.sin(SLOPE), 0.0, -np.cos(SLOPE)])
    push = np.array([SPEED * np.cos(ANGLE), SPEED * np.sin(ANGLE), 0, 0, 0, 0])
    for title, run in runs.items():
        for dt in STEPS:
            places, lowest = run(down, push, SLIDE, dt, 0.4)
            x, y = places[-1] - places[0]
            rested, under = run(along, still, STICK, dt, 1.0)
            yield Found(
                title, dt, float(np.hypot(x, y)), float(np.arctan2(y, x)),
                float(max(lowest.max(), 0.0)), float(-min(lowest.min(), under.min(), 0.0)),
                float(rested[-1, 0] - rested[0, 0]),
            )  # fmt: skip


def pages(found: list[Found], where: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the tables, by page and block."""
    way = SPEED**2 / (2 * SLIDE * GRAVITY)
    lines = [
        "| model | dt [s] | stops after [m] | at [rad] | hop [mm] | deepest [mm] | creep [mm/s] |",
        "|---|---|---|---|---|---|---|",
        f"| Coulomb's law | | {way:.6f} | {ANGLE:.4f} | 0 | 0 | 0 |",
        *(
            f"| {one.model} | {one.dt:g} | {one.way:.6f} | {one.heading:.4f} | {_mm(one.hop)} | "
            f"{_mm(one.deep)} | {_mm(one.creep)} |"
            for one in found
        ),
        "",
        f"`python benchmarks/contact_models.py` with Pinocchio {where['pinocchio']}, MuJoCo "
        f"{where['mujoco']}; no figure is a time.",
    ]
    return {PAGE: {"contact_models": "\n".join(lines)}}


def _mm(length: float) -> str:
    """Return a length in mm, as zero what is rounding."""
    return f"{1e3 * length:.3g}" if abs(length) > 1e-9 else "0"


def read() -> tuple[list[Found], dict[str, str]]:
    """Return the committed results."""
    kept = json.loads(RESULTS.read_text(encoding="utf-8"))
    return [Found(**row) for row in kept["rows"]], kept["machine"]


def main() -> None:
    """Measure, or read, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--from-json", action="store_true", help="write the page alone")
    if not parser.parse_args().from_json:
        import mujoco

        where = {**machine(), "mujoco": mujoco.__version__}
        rows = [asdict(one) for one in measured()]
        RESULTS.write_text(
            json.dumps({"machine": where, "rows": rows}, indent=1) + "\n", encoding="utf-8"
        )
    marks.write(pages(*read()))


if __name__ == "__main__":
    main()
