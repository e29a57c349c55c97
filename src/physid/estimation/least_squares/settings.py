"""What decides in a fit by least squares."""

from __future__ import annotations

from physid.setting import Section, setting


class DifferenceSettings(Section):
    """Steps of the differences that stand for derivatives."""

    turn: float = setting(1e-5, "rad", "of an initial attitude", gt=0)
    shift: float = setting(1e-5, "m", "of an initial position", gt=0)
    spin: float = setting(1e-4, "rad/s", "of an initial angular velocity", gt=0)
    speed: float = setting(1e-4, "m/s", "of an initial velocity", gt=0)
    still: float = setting(
        1e-6, "rad/s, m/s", "velocity in a segment's second frame below which friction has stopped a body", ge=0
    )
    nominal: float = setting(1e-4, "-", "of an unknown parameter, in the coordinates of the fit", gt=0)
    effect: float = setting(1e-3, "typical sizes", "of a parameter of an effect", gt=0)
    force: float = setting(1e-3, "share", "of a wrench whose amplitude is a column", gt=0)


class GuessSettings(Section):
    """First guesses of initial states."""

    spans: tuple[float, ...] = setting(
        (0.06, 0.035, 0.02), "s", "first frames that may give the velocity; short ones end before an impact"
    )
    fewest: int = setting(5, "frames", "of these at least", ge=3)
    flat: float = setting(0.03, "rad", "lean of a face beyond which it does not lie on the ground", gt=0)
    near: float = setting(
        0.25, "heights", "of a body, gap beyond which it does not (cameras may see it too high)", gt=0
    )
    steady: float = setting(0.5, "share", "of a free fall beyond which a body does not lie", gt=0)
    sinks: float = setting(0.04, "heights", "by which a body that lies does not sink soon after", gt=0)
    soon: float = setting(0.25, "s", "how soon", gt=0)
    level: float = setting(
        1.5,
        "standard deviations",
        "of the noise; a body that leans no further, in the mean of a segment, is level",
        gt=0,
    )
    turned: float = setting(
        4.0,
        "standard deviations",
        "of the noise of one frame; the root of the summed squares of the parabola through the headings of a segment, "
        "below which bodies keep their headings, and are parallel",
        gt=0,
    )
    median: int = setting(3, "frames", "whose median height counts: one outlier is no fall", ge=1)


class LineSearchSettings(Section):
    """Which steps are tried, and when no more are."""

    first_damping: float = setting(1e-3, "-", "of initial states, relative to the diagonal", gt=0)
    dampings: tuple[float, ...] = setting(
        (0.1, 10.0), "-", "times the damping of a segment, which its initial state tries, the smallest first"
    )
    parts: tuple[float, ...] = setting(
        (0.5, 0.2, 0.0), "-", "of a step of shared parameters that are tried if the whole one fails; 0 last"
    )
    largest: float = setting(1.0, "-", "change of an unknown parameter in a step, in the coordinates of the fit", gt=0)
    chords: int = setting(2, "steps", "most with the Jacobian of an earlier point", ge=0)
    steps: int = setting(10, "Jacobians", "most of a fit whose number of steps is not said elsewhere", ge=1)
    converged: float = setting(1e-2, "standard deviations", "of the loss; a step that gains less is the last", gt=0)
    at_rest: float = setting(0.1, "rad/s, m/s", "initial velocity of a lying body that may as well be at rest", ge=0)
    worth: float = setting(
        0.0,
        "noise variances",
        "that the velocities of a body that friction holds have to explain, or it is at rest; bodies are tried one by "
        "one then, and together where it is 0",
        ge=0,
    )


class MultiStartSettings(Section):
    """Initial states that are guessed anew, and varied."""

    doubtful: float = setting(
        1.4, "noise variances", "mean squared residual of a segment whose initial state may be wrong", gt=0
    )
    most: float = setting(0.5, "share", "of the segments that may be such; with more, it is the model", ge=0, le=1)
    rounds: int = setting(4, "steps", "of Gauss-Newton from each guess", ge=1)
    undo: int = setting(8, "rounds", "in which what a camera changes is undone", ge=1)
    draws: int = setting(6, "states", "about the present one that each segment tries at each of the scales", ge=0)
    scales: tuple[float, ...] = setting(
        (0.3, 1.0, 3.0, 10.0), "standard deviations", "of a segment's initial state by which they are varied"
    )


class PriorSettings(Section):
    """What is believed before any data."""

    parameter: float = setting(3.0, "-", "deviation of the logarithm of an unknown parameter: a factor of 20", gt=0)
    effect: float = setting(10.0, "typical sizes", "deviation of a parameter of an effect", gt=0)
    engine: float = setting(
        1.0, "share", "of the difference between two engines: its deviation from 1, and the most that it leaves 1", gt=0
    )
    state: tuple[float, float, float, float] = setting(
        (0.2, 0.2, 5.0, 2.0), "rad, m, rad/s, m/s", "deviations of an initial state from its guess"
    )


class IntervalSettings(Section):
    """How what trajectories scatter and what white noise would do are weighed in an interval."""

    white: float = setting(
        0.3, "probability", "that nothing but white noise disturbs an estimate; decision 53", gt=0, lt=1
    )
    tail: float = setting(
        0.1, "-", "else the variance is f times larger, with a density that falls as f^-(1 + tail)", gt=0
    )
    largest: float = setting(1e6, "variances", "of white noise; a scatter beyond it alone counts", gt=1)
    span: float = setting(1e10, "-", "largest f", gt=1)
    points: int = setting(600, "-", "values of f, in equal ratios", ge=10)
    accuracy: float = setting(1e-6, "share", "of how far an interval reaches", gt=0)
    alone: float = setting(
        1e-4,
        "share",
        "of what is known of a parameter; a trajectory that leaves the others less is alone with it",
        gt=0,
    )


class LeastSquaresSettings(Section):
    """All of them; an `Experiment` carries them."""

    differences: DifferenceSettings = DifferenceSettings()
    guess: GuessSettings = GuessSettings()
    line_search: LineSearchSettings = LineSearchSettings()
    multi_start: MultiStartSettings = MultiStartSettings()
    prior: PriorSettings = PriorSettings()
    intervals: IntervalSettings = IntervalSettings()
