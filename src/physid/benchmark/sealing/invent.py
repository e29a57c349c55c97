"""Draw recording sets, and what is hidden in each, at a size at which it shows as much as is wanted."""

from __future__ import annotations

from collections.abc import Iterator

from physid.benchmark.films import SCENES
from physid.benchmark.plan import Plan, Task
from physid.benchmark.sealing.configurations import in_view
from physid.benchmark.sealing.hidden import ROLES, build, candidates, cells
from physid.benchmark.sealing.labelled import Invention, label_of
from physid.benchmark.sealing.sizes import draw_sizes

TRIES = 240  # draws of effects and sizes before a set is given up
SAME = 20  # of them, for which a configuration stays the same: where nothing shows, no effect helps


def inventions(plan: Plan, task: Task) -> Iterator[Invention]:
    """Draw a recording set, and what is hidden in it, of a severity that is drawn as well.

    Yields:
        Its configuration without effects, the effects, and the label; then the next choices: other effects, then other
        configurations too.
    """
    generator = plan.generator(1, int(task.name))
    simulator = task.recorded.simulator
    able = [
        cell
        for cell in cells(simulator)
        if candidates(task.role, *cell, simulator) and (cell[0] in SCENES or not task.film)
    ]
    turn = task.turn + int(plan.generator(2, ROLES.index(task.role)).integers(len(able)))
    scene, protocol = able[turn % len(able)]
    menu = candidates(task.role, scene, protocol, simulator)
    order = plan.generator(3, ROLES.index(task.role)).permutation(len(menu))
    for attempt in range(TRIES):
        if attempt % SAME == 0:
            config = in_view(plan.size, scene, protocol, generator, task.recorded, film=task.film)
        hidden = menu[order[(task.turn + attempt) % len(menu)]]
        parts = draw_sizes(config, hidden, generator, plan.least)
        if parts is None:
            continue
        effects = tuple(build(kind, part.parameters) for kind, part in zip(hidden.kinds, parts, strict=True))
        yield config, effects, label_of(config, hidden, parts, effects)
