"""The profiles: which cells are run, on how much data, and what each must reach."""

from __future__ import annotations

from physid.reproduce.cells import Cell, Fit, Observe, Recordings

FEW = {name: Recordings(name, 32) for name in ("push", "slide", "collide")}
FEW_FILMS = Recordings("push", 64, video=True)
ALL = {name: Recordings(name, 1000, video=True) for name in ("push", "slide", "collide")}
"""The paper's sets: 1000 trajectories of 300 frames."""
QUICK_MINUTES, PAPER_MINUTES = 2.5, 25.0


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
        Fit("sysid/collide_paper", collide),
    )


def quick_video() -> tuple[Cell, ...]:
    """Return both ways to learn from video, on reduced data, with the targets of the full profile."""
    return tuple(
        Fit(
            f"{method}/push_friction",
            FEW_FILMS,
            f"{method}/push_friction_quick",
            parameter=parameter,
            position=position,
            paper_position=paper,
            minutes=QUICK_MINUTES,
        )
        for method, parameter, position, paper in (("supervised", 0.5, 1.0, 2.0), ("self_supervised", 2.0, 2.0, 8.0))
    )


def paper_video() -> tuple[Cell, ...]:
    """Return the video cells of the paper's tables, and the incline without supervision, which the paper had not."""
    push, slide, collide = (ALL[name] for name in ("push", "slide", "collide"))
    supervised = (
        Fit("supervised/push_mass", push, parameter=0.5, position=1.0, paper_position=4.0, minutes=PAPER_MINUTES),
        Fit("supervised/push_friction", push, parameter=0.5, position=1.0, paper_position=2.0, minutes=PAPER_MINUTES),
        Fit("supervised/slide_friction", slide, parameter=0.5, position=1.0, paper_position=5.0, minutes=PAPER_MINUTES),
        Fit(
            "supervised/collide", collide, parameter=2.0, position=2.0, rotation=1.0, paper_position=8.0,
            paper_rotation=8.0, minutes=2 * PAPER_MINUTES,
        ),
        Fit(
            "supervised/push_without_physics", push, "supervised/push_friction",
            overrides=("model.alpha=0.0",), minutes=PAPER_MINUTES,
        ),
    )  # fmt: skip
    alone = (
        Fit("self_supervised/push_mass", push, parameter=2.0, position=2.0, paper_position=7.0, minutes=PAPER_MINUTES),
        Fit(
            "self_supervised/push_friction", push, parameter=2.0, position=2.0, paper_position=8.0,
            minutes=PAPER_MINUTES,
        ),
        Fit(
            "self_supervised/collide", collide, parameter=5.0, position=4.0, rotation=2.0, paper_position=12.0,
            paper_rotation=8.0, minutes=2 * PAPER_MINUTES,
        ),
        Fit("self_supervised/slide_friction", slide, parameter=2.0, position=5.0, minutes=PAPER_MINUTES),
    )  # fmt: skip
    return supervised + alone


OBSERVE: tuple[Cell, ...] = (
    Observe("observe/push", "push"),
    Observe("observe/push_constant_force", "push", ("constant_force=5.5",)),
    Observe("observe/slide", "slide"),
    Observe("observe/collide", "collide"),
)

QUICK = (*sysid(FEW), *OBSERVE, *quick_video())
PAPER = (*sysid(ALL), *OBSERVE, *paper_video())
PROFILES: dict[str, tuple[Cell, ...]] = {"quick": QUICK, "paper": PAPER}
