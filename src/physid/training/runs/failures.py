"""Whose an error is that arises in a run: the checkpoint's, that of what a configuration chose, or a defect of ours.

The first two are the user's to mend, and are said in one line; a defect shows where it arose, and so does an error in a
package that the user allows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from traceback import walk_tb
from types import FrameType
from typing import Any, Self

from lightning.fabric.utilities.exceptions import MisconfigurationException

from physid.class_paths import lies_in
from physid.data.refusals import out_of_memory

RESTORING = ("resume_start", "restore", "_restore")
"""How the names of the methods of Lightning's checkpoint connector begin that read a checkpoint."""
CONNECTOR = "lightning.pytorch.trainer.connectors.checkpoint_connector"
TOP = ("physid.training.runs.run", "physid.training.runs.building")
"""Modules from which Lightning is called; what lies above is not inspected."""
CALLED = ("self", "callback")
"""What Lightning and torch call the object whose method runs, or is about to."""
PLACES = {
    "strategies": "strategy",
    "accelerators": "accelerator",
    "profilers": "profiler",
    "precision": "precision",
    "tuner": "callbacks",
    "plugins": "plugins",
}
"""Parts of Lightning, and which key of the Trainer chooses one."""
CARRIED = "Traceback (most recent call last)"
"""In the message of an error that arose in another process: it shows where by itself."""
LONGEST = 300  # letters of a message of others that is quoted


@dataclass(frozen=True)
class Chosen:
    """What a configuration names.

    Attributes:
        keys: The key of each class, by its name without its module.
        trainer: The settings of the Trainer.
        allowed: Packages of the user's own.
    """

    keys: Mapping[str, str]
    trainer: Mapping[str, Any]
    allowed: Sequence[str] = ()

    @classmethod
    def of(cls, config: Mapping[str, Any], allowed: Sequence[str] = ()) -> Self:
        """Return what a resolved configuration names."""
        return cls(dict(_named(config, "")), config.get("trainer") or {}, allowed)

    def owns(self, module: str) -> bool:
        """Return whether a module is physid's, or of a package that the user allows."""
        return lies_in(module, ("physid", *self.allowed))


def explain(error: Exception, chosen: Chosen, checkpoint: object = None) -> ValueError | None:
    """Say in one line what the user has to mend.

    Args:
        error: What arose while Lightning's classes were made or at work.
        chosen: What the configuration names.
        checkpoint: What the Trainer has read, or was about to.

    Returns:
        The error to raise instead; None where it is to be raised as it is: the system's, one of the code of physid or
        of the user's own, or one that says all by itself.
    """
    if out_of_memory(error) or isinstance(error, OSError) or CARRIED in str(error):
        return None
    frames = [frame for frame, _ in walk_tb(error.__traceback__)][::-1]
    if isinstance(error, MisconfigurationException):  # say fewer epochs than a checkpoint has
        place = _place(frames, chosen)
        return ValueError(f"trainer: {error}" if place is None else _line(place, error))
    if checkpoint is not None and any(map(_restores, frames)):
        if frames and lies_in(frames[0].f_globals.get("__name__", ""), chosen.allowed):
            return None
        if str(error).startswith(f"{checkpoint}: "):
            return None
        return misfit(checkpoint, error)
    place = _place(frames, chosen)
    return None if place is None else ValueError(_line(place, error))


def misfit(checkpoint: object, error: Exception) -> ValueError:
    """Return an error that says of which checkpoint another one is."""
    return ValueError(
        f"{checkpoint}: expected a checkpoint of this version of physid and this model, found another: {_said(error)} "
        "Begin in a new folder, or use the version that record.json names"
    )


def _named(value: Any, key: str) -> Iterator[tuple[str, str]]:
    """Yield the name of each class below a key, and where it is named."""
    if isinstance(value, Mapping):
        if isinstance(value.get("class_path"), str):
            yield value["class_path"].rpartition(".")[2], key
        for name, each in value.items():
            yield from _named(each, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            yield from _named(each, f"{key}.{index}")


def _place(frames: Sequence[FrameType], chosen: Chosen) -> str | None:
    """Return the key, and the class, whose code failed; None where it is physid's or the user's own.

    Args:
        frames: Where the error arose, and what had called that, and so on.
        chosen: What the configuration names.
    """
    for frame in frames:
        module = frame.f_globals.get("__name__", "")
        if module in TOP:
            break
        if chosen.owns(module):
            return None
        for name in CALLED:
            kind = type(frame.f_locals.get(name))
            if chosen.owns(kind.__module__) and name == "callback":
                return None
            if kind.__name__ in chosen.keys and not chosen.owns(kind.__module__):
                return f"{chosen.keys[kind.__name__]}: {kind.__name__}"
            parts = [PLACES[each] for each in kind.__module__.split(".")[::-1] if each in PLACES]
            if kind.__module__.startswith("lightning.") and parts and chosen.trainer.get(parts[0]) is not None:
                return f"trainer.{parts[0]}: {kind.__name__}"
    # What torch says while it goes back through a model is of the model.
    return "trainer" if frames and frames[0].f_globals.get("__name__", "").startswith("lightning.") else None


def _restores(frame: FrameType) -> bool:
    """Return whether a frame is one of Lightning's that read a checkpoint."""
    return frame.f_globals.get("__name__") == CONNECTOR and frame.f_code.co_name.startswith(RESTORING)


def _line(place: str, error: Exception) -> str:
    return f"{place}: {_said(error).rstrip('.')}; mend it or remove it from the configuration"


def _said(error: Exception) -> str:
    """Return what an error says as one sentence; of some kinds the name of the kind says the most."""
    text = " ".join(str(error).split())
    text = text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
    if not text or not isinstance(error, ValueError | RuntimeError | MisconfigurationException | ImportError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return text if text.endswith(".") else f"{text}."
