"""The profiles: which cells are run, on how much data, and what each must reach."""

from __future__ import annotations

from typing import Any

from physid.reproduce.cells import Cell, Fit, Identifiable, Recordings
from physid.reproduce.real import Tosses
from physid.reproduce.withheld import Withheld

FEW = {name: Recordings(name, 32) for name in ("push", "slide", "collide")}
FEW_FILMS = {name: Recordings(name, 64, video=True) for name in ("push", "slide", "collide")}
ALL = {name: Recordings(name, 1000, video=True) for name in ("push", "slide", "collide")}
"""The paper's sets: 1000 trajectories of 300 frames."""
ELSEWHERE = Recordings("push_elsewhere", 32)
"""Of a simulator that shares nothing with the model, at 60 frames per second, with noise, jitter and lost frames; the
noise alone is 0.13 % of the block's size."""
QUICK_MINUTES, PAPER_MINUTES, METHOD_MINUTES = 1.5, 180.0, 480.0
"""Of a video cell with one body, on one core: quick, of 1000 films, by the paper's losses alone."""


def sysid(sets: dict[str, Recordings]) -> tuple[Cell, ...]:
    """Return the identifications from recorded poses."""
    push, slide, collide = (sets[name] for name in ("push", "slide", "collide"))
    return (
        Fit("sysid/push_mass", push, parameter=0.1, position=0.1, evaluations=20, paper_position=0.7),
        Fit("sysid/push_friction", push, parameter=0.1, position=0.1, evaluations=20, paper_position=0.5),
        Fit("sysid/slide_friction", slide, parameter=0.1, position=0.1, evaluations=20, paper_position=0.7),
        Fit("sysid/collide_mass", collide, parameter=1.0, position=1.0, paper_position=1.2),
        Fit("sysid/collide_friction", collide, parameter=1.0, position=1.0),
        Fit("sysid/collide_both", collide, parameter=1.0, position=1.0),
        Fit("sysid/collide_paper", collide, paper_position=1.2),
        Fit("sysid/push_elsewhere", ELSEWHERE, parameter=0.1, position=0.2, minutes=0.3),
    )


def video(sets: dict[str, Recordings], minutes: float, suffix: str = "") -> tuple[Cell, ...]:
    """Return the video cells of the paper's tables, and the incline without supervision, which the paper had not.

    Mass and friction of the pushed block follow from the same films; with many of them, they share an encoder, and it
    has targets of its own.

    Args:
        sets: The recordings by scene.
        minutes: What a cell with one body costs.
        suffix: Of the configurations' names.
    """

    def cell(name: str, parameter: float, position: float, paper: float | None, alone: float, **rest: Any) -> Fit:
        cost, turned = rest.pop("cost", 1.0) * minutes, rest.pop("turned", None)
        scene = name.split("/")[1].split("_")[0]
        encoder = {} if suffix else {"encoder_position": alone, "encoder_rotation": turned}
        return Fit(
            name, sets[scene], name + suffix, parameter=parameter, position=position, paper_position=paper,
            minutes=cost, **encoder, **rest,
        )  # fmt: skip

    def same_films(encoder: str) -> dict[str, Any]:
        return {} if suffix else {"encoder": encoder, "cost": 0.15}

    collide: dict[str, Any] = {"paper_rotation": 8.0, "cost": 1.3}
    return (
        cell("supervised/push_friction", 0.5, 1.0, 2.0, 2.0),
        cell("supervised/push_mass", 0.5, 1.0, 4.0, 2.0, **same_films("supervised/push_friction")),
        cell("supervised/slide_friction", 0.5, 1.0, 5.0, 3.0),
        cell("supervised/collide", 2.0, 2.0, 8.0, 4.0, rotation=1.0, turned=3.0, **collide),
        cell("self_supervised/push_friction", 2.0, 2.0, 8.0, 3.0),
        cell("self_supervised/push_mass", 2.0, 2.0, 7.0, 3.0, **same_films("self_supervised/push_friction")),
        cell("self_supervised/collide", 5.0, 4.0, 12.0, 6.0, rotation=2.0, turned=4.0, **collide),
        cell("self_supervised/slide_friction", 2.0, 5.0, None, 8.0),
    )


def paper_method(sets: dict[str, Recordings], minutes: float, overrides: tuple[str, ...] = ()) -> tuple[Cell, ...]:
    """Return the cells of the paper's tables by the paper's losses alone, the encoder's targets being its figures.

    Args:
        sets: The recordings by scene.
        minutes: What a cell with one body costs.
        overrides: Further settings, key=value.
    """

    def cell(name: str, by_gradient: float, paper: float, rotation: float | None = None) -> Fit:
        scene = name.removeprefix("self_").split("_")[1]
        return Fit(
            f"paper_method/{name}", sets[scene], by_gradient=by_gradient, encoder_position=paper,
            encoder_rotation=rotation, paper_position=paper, paper_rotation=rotation, minutes=minutes,
            overrides=overrides,
        )  # fmt: skip

    return (
        cell("supervised_push_friction", 3.0, 2.0),
        cell("supervised_push_mass", 3.0, 4.0),
        cell("supervised_slide_friction", 3.0, 5.0),
        cell("supervised_collide", 3.0, 8.0, 8.0),
        cell("self_supervised_push_friction", 8.0, 8.0),
        cell("self_supervised_push_mass", 8.0, 7.0),
        cell("self_supervised_collide", 10.0, 12.0, 8.0),
    )


OBSERVE: tuple[Cell, ...] = (
    Identifiable("identifiability/push", "push"),
    Identifiable("identifiability/push_constant_force", "push", ("constant_force=5.5",)),
    Identifiable("identifiability/slide", "slide"),
    Identifiable("identifiability/collide", "collide"),
)

VIDEO = video(FEW_FILMS, QUICK_MINUTES, "_quick")
FILMED = tuple(cell for cell in VIDEO if cell.name.endswith("/push_friction"))
QUICK = (*sysid(FEW), *OBSERVE, Tosses(), *FILMED, Withheld())
REDUCED = (*sysid(FEW), *VIDEO)
WITHOUT_PHYSICS = Fit(
    "supervised/push_without_physics", ALL["push"], "supervised/push_friction",
    overrides=("model.objective.alpha=0.0",), minutes=PAPER_MINUTES,
)  # fmt: skip
PAPER = (*sysid(ALL), *OBSERVE, Tosses(), *video(ALL, PAPER_MINUTES), WITHOUT_PHYSICS, Withheld())
PAPER_METHOD = paper_method(
    ALL, METHOD_MINUTES,
    ("data.every=10", "data.batch_size=30", "data.preload=true", "trainer.max_epochs=300", "model.phases.warm_up=220"),
)  # fmt: skip
PAPER_METHOD_REDUCED = paper_method(FEW_FILMS, 18.0, ("trainer.max_epochs=200", "model.phases.warm_up=80"))
PROFILES: dict[str, tuple[Cell, ...]] = {
    "quick": QUICK,
    "reduced": REDUCED,
    "paper": PAPER,
    "paper_method": PAPER_METHOD,
    "paper_method_reduced": PAPER_METHOD_REDUCED,
}
