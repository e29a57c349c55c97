"""Settings of a fit to segments that are cut around impacts: phases of motion, events, and the fit itself."""

from __future__ import annotations

from physid.estimation.least_squares import FirstGuess, LeastSquaresSettings, StepChoice
from physid.estimation.measurement import NoiseSettings
from physid.estimation.prediction import CutRule
from physid.setting import Section, setting


class PhaseSettings(Section):
    """What a body is doing at each frame."""

    still_speed: float = setting(0.01, "m/s", "speed below which a body is at rest or sticks", gt=0)
    still_spin: float = setting(0.05, "rad/s", "spin below which it is", gt=0)
    slow: float = setting(0.3, "m/s", "speed that parts slow from fast sliding", gt=0)
    light: float = setting(0.02, "weights", "contact force below which a body flies", gt=0)
    hard: float = setting(
        2 * 9.81 / 240,
        "m/s",
        "that a contact changes a velocity by, beyond the weight, from which on it is an impact",
        gt=0,
    )
    impact_time: float = setting(2 / 240, "s", "that an impact or a contact between bodies lasts", ge=0)
    impact_frames: int = setting(
        2, "frames", "that poses show it at least: in the evidence, and where trajectories are cut", ge=0
    )
    switch: float = setting(0.3, "share", "of a trajectory's largest command; a larger change of it is a switch", gt=0)
    switch_time: float = setting(0.02, "s", "that a switch lasts in the map", gt=0)
    rare: float = setting(
        0.2, "share", "of a trajectory's frames; if more are switches, its command is noise and none is", gt=0, le=1
    )


class EventSettings(Section):
    """Frames at which small errors grow fast."""

    tilted: float = setting(
        0.05,
        "rad",
        "lean of a body that touches the ground with an edge",
        "decision 0011, calibration bank 607",
        gt=0,
    )
    reach: float = setting(0.025, "s", "before and after a frame, in which velocities are compared", gt=0)
    fewest: int = setting(3, "frames", "before and after a frame at least, however slow the camera", ge=2)
    jolt: float = setting(6.0, "standard deviations", "by which a velocity changes that was jolted", gt=0)
    jolt_spin: float = setting(1.5, "rad/s", "least change that is a jolt", gt=0)
    jolt_speed: float = setting(0.5, "m/s", "least change that is a jolt", gt=0)


class RoundSettings(Section):
    """How often trajectories are cut and steps are chosen, and how segments and frames are weighed."""

    first_rotation_noise: float = setting(5e-3, "rad", "noise of the first fit, before any is estimated", gt=0)
    first_position_noise: float = setting(2e-3, "m", "noise of the first fit, before any is estimated", gt=0)
    cuts: int = setting(3, "times", "most that trajectories are cut into segments around events", ge=1)
    step_choices: int = setting(2, "times", "that the steps of the engine are chosen; 0 keeps the longest", ge=0)
    new_states: bool = setting(True, "", "whether badly fitted segments are fitted from new guesses of their states")
    robust: bool = setting(True, "", "whether frames that stand alone off the motion count less")
    outlier_rounds: int = setting(
        2, "times", "that frames which stand alone off short segments are left out; decision 82", ge=0
    )
    own_weights: bool = setting(True, "", "whether contact segments count as little as their misfit says")


class AgreementSettings(Section):
    """When trajectories that disagree about the parameters count less, and how their deviations are sought."""

    chance: float = setting(
        1e-3,
        "probability",
        "of trajectories that disagree as much by chance, below which none counts more than they agree on; decision 79",
        ge=0,
        lt=1,
    )
    deviations: tuple[float, float] = setting((-6.0, 0.5), "decades", "of a parameter's deviations that are tried")
    tries: int = setting(40, "values", "in these decades, in equal ratios", ge=2)
    sweeps: int = setting(3, "times", "that the deviation of each parameter is sought beside the others", ge=1)


class OddSettings(Section):
    """When a trajectory is said to have parameters of its own."""

    misfit: float = setting(
        2.0, "-", "mean squared residual of a trajectory, in that of the noise, up to which it is explained", gt=1
    )
    beyond: float = setting(
        10.0, "-", "the same of an odd trajectory, with the parameters of the others, at least; decision 85", gt=1
    )
    share: float = setting(0.2, "share", "of the trajectories that may be odd, at least one", ge=0, lt=0.5)
    most: int = setting(3, "trajectories", "that may be odd, at most: each takes a few fits", ge=1)
    others: int = setting(3, "trajectories", "that the parameters of the others are fitted to, at least", ge=2)
    among: int = setting(
        200, "trajectories", "of a set, at most, for the same reason; larger ones are not inspected", ge=1
    )


class UnexplainedSettings(Section):
    """When it is said that the model does not explain what happens at events."""

    misfit: float = setting(
        2.0, "-", "mean squared residual of a segment with an event, in that of the noise, up to which it is explained",
        gt=1,
    )  # fmt: skip
    usual: float = setting(
        0.2,
        "share",
        "of these segments that are not explained although the model is right",
        "decision 91: at most 0.18 in recordings of MuJoCo without an effect, 0.45 and more where contact was another",
        ge=0,
        lt=1,
    )
    chance: float = setting(
        0.01, "probability", "of as many by chance, below which it is the model that fails", "by definition", gt=0, le=1
    )


class SegmentedFitSettings(Section):
    """All that decides in a fit to segments around impacts."""

    noise: NoiseSettings = NoiseSettings()
    least_squares: LeastSquaresSettings = LeastSquaresSettings()
    first_guess: FirstGuess = FirstGuess()
    phases: PhaseSettings = PhaseSettings()
    events: EventSettings = EventSettings()
    rounds: RoundSettings = RoundSettings()
    agreement: AgreementSettings = AgreementSettings()
    odd: OddSettings = OddSettings()
    unexplained: UnexplainedSettings = UnexplainedSettings()
    impacts: CutRule = CutRule()
    steps: StepChoice = StepChoice()
