"""How far reference simulators are apart on the same scenes and forces, and from the laws of rigid bodies.

    python benchmarks/references.py
    python benchmarks/references.py --draws 3

PyBullet, MuJoCo and closed forms; the number after a name is its steps per frame of 1/240 s. The first table has
the largest distance between the paths of any body within a second [mm]: the median, in brackets the largest, over all
draws. The second has the time, the third what each makes of three laws. The last is of MuJoCo as it comes, with its
own soft contact: how far a block turns that is pushed through its centre of mass, which no rigid one does.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import statistics
import time
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from physid.scenes import Body, Excitation, Ground, Scene, find_setup
from physid.scenes.setups.placing import on_ground
from physid.simulators import Motion, find_simulator

Array = NDArray[np.float64]
FRAMES, G = 241, 9.81
CASES = (
    ("push", "straight"),
    ("slide", "straight"),
    ("collide", "straight"),
    ("toss", "straight"),
    ("toss", "flight"),
    ("push", "rich"),
    ("slide", "rich"),
    ("collide", "rich"),
    ("toss", "rich"),
    ("push", "rich, 1 cm off centre"),
    ("push", "rich, 5 cm off centre"),
)
WAYS = (("closed_form", 1), ("mujoco", 5), ("mujoco", 20), ("pybullet", 16), ("pybullet", 1))
PAIRS = ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (1, 3))
OWN_CONTACT = {
    "defaults (pyramid, 2 ms)": "",
    "elliptic cone": 'cone="elliptic"',
    "elliptic cone, 0.5 ms": 'cone="elliptic" timestep="0.0005"',
    "elliptic cone, 0.5 ms, impratio 50": 'cone="elliptic" timestep="0.0005" impratio="50"',
}
SMALL = Body("box", (0.12, 0.08, 0.06), mass=0.65, friction=0.22)
SETTLED = 0.2  # [s] in which the block sinks into the ground
BLOCK = Body("block", (0.3, 0.25, 0.2), mass=2.0, friction=0.2)


def draw(scene: str, protocol: str, seed: int) -> Excitation:
    """Draw a motion; forces "off centre" have an arm, so that a block that they push turns as it slides."""
    setup, (name, _, arm) = find_setup(scene), protocol.partition(", ")
    drawn = setup.draw(setup.scene, name, np.random.default_rng([1, seed]), FRAMES)
    if not arm:
        return drawn
    wrench = drawn.wrench.copy()
    wrench[..., 2] = (-1) ** seed * 0.01 * float(arm.split()[0]) * np.linalg.norm(wrench[..., 3:], axis=-1)
    return dataclasses.replace(drawn, wrench=wrench)


def distance(one: Sequence[Motion], other: Sequence[Motion]) -> str:
    """Return median and largest distance of two sets of motions [mm]."""
    worst = [
        1e3 * float(np.linalg.norm(a.pose[..., :3] - b.pose[..., :3], axis=-1).max())
        for a, b in zip(one, other, strict=True)
    ]
    return f"{statistics.median(worst):.3f} ({max(worst):.3f})"


def compare(draws: int) -> None:
    """Print the distances and the times."""
    names = [f"{name} {substeps}" for name, substeps in WAYS]
    print("| scene | protocol |" + "".join(f" {names[a]} - {names[b]} |" for a, b in PAIRS))
    print("|" + "---|" * (2 + len(PAIRS)))
    times = []
    for scene_name, protocol in CASES:
        setup = find_setup(scene_name)
        drawn = [draw(scene_name, protocol, k) for k in range(draws)]
        motions: list[Sequence[Motion]] = []
        spent = []
        for name, substeps in WAYS:
            begin = time.perf_counter()
            try:
                motions.append(find_simulator(name).simulate(setup.scene, drawn, substeps=substeps))
            except ValueError:  # no closed form
                motions.append([])
            spent.append(1e3 * (time.perf_counter() - begin) / draws if motions[-1] else math.nan)
        cells = [distance(motions[a], motions[b]) if motions[a] and motions[b] else "" for a, b in PAIRS]
        print(f"| {scene_name} | {protocol} | " + " | ".join(cells) + " |", flush=True)
        times.append((f"{scene_name} {protocol}", spent))
    print("\n| ms per trajectory | " + " | ".join(names) + " |\n|" + "---|" * (1 + len(WAYS)))
    for label, spent in times:
        print(f"| {label} | " + " | ".join("" if math.isnan(each) else f"{each:.0f}" for each in spent) + " |")


def alone(way: tuple[str, int], body: Body, pose: Array, velocity: Sequence[float]) -> Motion:
    """Simulate a second of one body on flat ground."""
    scene = Scene("law", 1 / 240, Ground(), (body,))
    twist = np.array([[0.0, 0.0, 0.0, *velocity]])
    drawn = Excitation(pose[None], twist, np.zeros((FRAMES, 1, 6)))
    return find_simulator(way[0]).simulate(scene, [drawn], substeps=way[1])[0]


def laws() -> None:
    """Print what each makes of sliding, resting and bouncing."""
    print(
        "\n| simulator | deceleration / (mu g) - 1 | height at rest [mm] | apex / (e^2 drop) - 1, e = 0.3, 0.6, 0.9 |"
    )
    print("|---|---|---|---|")
    for way in WAYS:
        slide = alone(way, BLOCK, on_ground(Ground(), 0, 0, 0.3, 0.2), (2.0, 0.5, 0.0))
        way_of_slide = np.linalg.norm(slide.pose[120, 0, :2])
        speed = math.hypot(2.0, 0.5)
        deceleration = 2 * (speed * 0.5 - way_of_slide) / 0.25
        rest = alone(way, BLOCK, np.array([0, 0, 0.25, 0, 0, 0, 1.0]), (0.0, 0.0, 0.0)).pose[-1, 0, 2] - 0.1
        apexes = [apex(way, restitution) / (restitution**2 * 0.15) - 1 for restitution in (0.3, 0.6, 0.9)]
        print(
            f"| {way[0]} {way[1]} | {deceleration / (0.2 * G) - 1:.1e} | {1e3 * rest:.4f} | "
            + ", ".join(f"{each:.1e}" for each in apexes)
            + " |"
        )


def apex(way: tuple[str, int], restitution: float) -> float:
    """Return the height of the first apex after a fall of 15 cm, through the three highest frames [m]."""
    body = dataclasses.replace(BLOCK, restitution=restitution)
    height = alone(way, body, np.array([0, 0, 0.25, 0, 0, 0, 1.0]), (0.0, 0.0, 0.0)).pose[:, 0, 2] - 0.1
    low = int(np.argmax(np.diff(height) > 0))
    rising = height[low:]
    top = int(np.argmax(np.diff(rising) < 0))
    before, middle, after = rising[top - 1 : top + 2]
    return float(middle - (after - before) ** 2 / (8 * (after - 2 * middle + before)))


def own_contact(draws: int) -> None:
    """Print how far MuJoCo's own contact turns blocks that pushes through the centre leave unturned if all is rigid."""
    blocks = {"block of push": find_setup("push").scene.bodies[0], "12 x 8 x 6 cm, 0.65 kg": SMALL}
    print("\n| MuJoCo as it comes: largest turn within a second [mrad] | " + " | ".join(blocks) + " |")
    print("|---|" + "---|" * len(blocks))
    for name, options in OWN_CONTACT.items():
        turns = [[1e3 * turn(body, options, seed) for seed in range(draws)] for body in blocks.values()]
        print(f"| {name} | " + " | ".join(f"{statistics.median(some):.1f} ({max(some):.1f})" for some in turns) + " |")


def turn(body: Body, options: str, seed: int) -> float:
    """Return the largest change of the heading of a block [rad], from rest, under as strong pushes as in `rich`."""
    own, drawn = find_setup("push").scene.bodies[0], draw("push", "rich", seed)
    strength = body.mass * body.friction / (own.mass * own.friction)
    half = " ".join(f"{edge / 2}" for edge in body.size)
    same = f'friction="{body.friction} 0 0" condim="3"'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option {options}/><worldbody><geom type="plane" size="9 9 1" {same}/>'
        f'<body pos="0 0 {body.size[2] / 2}"><freejoint/><geom type="box" size="{half}" mass="{body.mass}" {same}/>'
        "</body></worldbody></mujoco>"
    )
    data, step = mujoco.MjData(model), model.opt.timestep
    data.qpos[3:] = np.roll(drawn.pose[0, 3:], 1)
    headings = []
    for count in range(round((SETTLED + FRAMES / 240) / step)):
        frame = int((count * step - SETTLED) * 240)
        data.xfrc_applied[1, :3] = strength * drawn.wrench[frame, 0, 3:] if frame >= 0 else 0.0
        mujoco.mj_step(model, data)
        if frame >= 0:
            headings.append(2 * math.atan2(data.qpos[6], data.qpos[3]))
    return float(np.abs(np.unwrap(headings) - headings[0]).max())


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=8, help="trajectories of each scene and protocol")
    draws = parser.parse_args().draws
    compare(draws)
    laws()
    own_contact(draws)


if __name__ == "__main__":
    main()
