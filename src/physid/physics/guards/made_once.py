"""Tensors that are made once and kept."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar, cast

import torch

Given = ParamSpec("Given")
Made = TypeVar("Made")


def made_once(make: Callable[Given, Made]) -> Callable[Given, Made]:
    """Let a function that returns tensors make them once for each of its arguments, which can be hashed.

    They are made outside of torch's inference mode, whoever asks first: tensors made within it can serve no gradient
    later, so that a test or a prediction would keep the next fit in the same process from being one.
    """

    @wraps(make)
    def outside(*args: Given.args, **kwargs: Given.kwargs) -> Made:
        with torch.inference_mode(False):
            return make(*args, **kwargs)

    return cast("Callable[Given, Made]", lru_cache(outside))
