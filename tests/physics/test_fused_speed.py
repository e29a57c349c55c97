"""The compiled rollout stays as fast as it is: ratios within one run, never seconds."""

import statistics
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from peers import FRICTION, MASS, Physid, PyBullet, cases, cpu_time


@pytest.mark.parametrize(("name", "largest"), [("push", 0.2), ("slide", 0.25), ("collide", 0.35)])
@pytest.mark.slow
def test_a_gradient_costs_a_fraction_of_the_rollout_alone_in_pybullet(name: str, largest: float) -> None:
    case = next(case for case in cases(64) if case.name == name)
    ours, theirs = Physid(case), PyBullet(case)
    ours.gradient(MASS, FRICTION, ours.width)
    times = [
        (cpu_time(lambda: ours.gradient(MASS, FRICTION, ours.width)), cpu_time(lambda: theirs.last_x(MASS, FRICTION)))
        for _ in range(3)
    ]
    assert statistics.median(mine for mine, _ in times) < largest * statistics.median(other for _, other in times)
