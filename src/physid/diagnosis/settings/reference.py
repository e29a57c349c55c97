"""Settings of segments, of reference simulators and of null simulations."""

from __future__ import annotations

from typing import Literal

from physid.diagnosis.settings.origins import AGREEMENT, IMPACTS
from physid.estimation.prediction import CutRule
from physid.setting import Section, setting


class SegmentSettings(Section):
    """How trajectories are cut for a fit of all frames, and for the search in contact-free segments.

    Contact-free segments are as long as they can be; overlaps of bodies are gone when they begin.
    """

    impacts: CutRule = CutRule()
    contact_free: CutRule = CutRule(lead=4 / 240, trail=16 / 240, longest=30 / 240, least=12 / 240)


class DiscrepancySettings(Section):
    """Fitting and replaying in turn."""

    follows: bool = setting(True, "", "whether the fit follows a reference simulator whose steps are known")
    lost: float = setting(
        1.5, "usual misfits", "of a contact segment, from which on it does not follow the reference simulator", gt=1
    )
    rounds: int = setting(5, "replays", "most of one fit", ge=1)
    settled: float = setting(0.1, "standard deviations", "of the loss; less change ends the rounds", gt=0)
    shorter: float = setting(0.4, "-", "factor of a step of an initial state that did not help", gt=0, lt=1)
    first_steps: int = setting(2, "steps", "most Gauss-Newton steps before the first replay", ge=0)
    last_steps: int = setting(6, "steps", "most Gauss-Newton steps after the last replay", ge=0)


class NullSimulationSettings(Section):
    """Recordings as the reference simulator makes them if a model is true."""

    replays: int = setting(4, "replays", "from other initial states and parameters", ge=1)
    draws: int = setting(75, "draws", "of the noise for each replay", ge=1)
    floor_replays: int = setting(4, "replays", "that tell where the numerics disturb; 0 takes no account of it", ge=0)
    sure: float = setting(3.0, "standard deviations", "by which a draw of initial states may fit worse", gt=0)
    halvings: int = setting(6, "times", "most that such a draw is shortened", ge=1)
    first_frames: int = setting(5, "frames", "least, whose line bounds a draw of initial states", ge=2)


class ReplaySettings(Section):
    """Reference simulators for recordings that do not say how they were integrated."""

    simulators: tuple[Literal["pybullet", "mujoco"], ...] = setting(
        ("pybullet", "mujoco"), "", "which are asked in turn, where they are installed", min_length=1
    )
    pybullet_step: float = setting(
        1e-3, "s", "longest step: PyBullet's scheme is of first order", "docs/simulators.md", gt=0
    )
    mujoco_step: float = setting(
        1 / 480, "s", "longest step: MuJoCo's here is of second order", "docs/simulators.md", gt=0
    )
    far: float = setting(
        1.0, "standard deviations", "of the noise, by which a reference that stands alone is left out", AGREEMENT, gt=0
    )
    farther: float = setting(
        3.0, "-", "times as far from all others as these are from each other, such a reference is", AGREEMENT, ge=1
    )
    jump: float = setting(5.0, "g h", "change of a velocity in a step h that an impact made", gt=0)
    gravity: float = setting(9.81, "m/s^2", "g in the line above", gt=0)


class NullDistributionSettings(Section):
    """What chance gives effects."""

    bad: float = setting(
        2.0, "noise variances", "mean squared residual that the numerics of an impact do not explain", IMPACTS, gt=0
    )
