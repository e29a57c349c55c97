"""How far a diagnosis is: the stages that it passes, each with the share of the time that has gone when it begins."""

from __future__ import annotations

from enum import Enum
from typing import Protocol


class Stage(Enum):
    """What a diagnosis is doing; `{}` stands for what it does that to.

    Attributes:
        phrase: For a person.
        share: Of the time, when it first begins [%].
    """

    READING = "reading the recordings", 0
    FITTING_SHORT_SEGMENTS = "fitting the nominal model to short segments", 2
    FITTING_NOMINAL = "fitting the nominal model", 2
    CHOOSING_STEPS = "choosing the steps of the engine", 12
    REPLAYING_NOMINAL = "replaying the fit in the reference simulator", 22
    MEASURING_NUMERICS = "measuring where the numerics disturb", 40
    FITTING_CONTACT_FREE = "fitting the nominal model to contact-free segments", 45
    TESTING = "testing all effects at once, against null simulations", 50
    FITTING = "fitting {}", 62
    FINISHING = "fitting {} to the end", 72
    REPLAYING = "replaying {} in the reference simulator", 75
    EXAMINING = "looking at what {} leaves", 80
    EXAMINING_IMPACTS = "looking at what {} leaves at impacts", 87
    FITTING_ALL_FRAMES = "fitting what was found to all frames", 88
    FREEING = "fitting {} as well, which is given", 93
    WRITING = "writing the report", 97

    def __init__(self, phrase: str, share: int) -> None:
        self.phrase = phrase
        self.share = share

    def about(self, what: str) -> str:
        """Return the phrase, said of something."""
        return self.phrase.format(what)


class Progress(Protocol):
    """Told what a diagnosis is doing."""

    def __call__(self, stage: Stage, what: str = "") -> None:
        """Take note of a stage that begins, and of what it is about."""


def silent(stage: Stage, what: str = "") -> None:
    """Tell nobody."""
