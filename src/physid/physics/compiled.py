"""Functions that torch compiles where it can."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import ParamSpec

import torch

P = ParamSpec("P")


def compile_or_not(function: Callable[P, None], name: str) -> Callable[P, None]:
    """Return a function compiled by torch, at its first call; where that fails, the function itself, after one line.

    Args:
        function: Works on tensors, and may set attributes of its arguments.
        name: What the line calls it.
    """
    current = torch.compile(function)

    def call(*args: P.args, **kwargs: P.kwargs) -> None:
        nonlocal current
        try:
            current(*args, **kwargs)
        except torch._dynamo.exc.TorchDynamoException as error:
            reason = str(error).strip().splitlines()[0]
            logging.getLogger(__name__).warning("%s is not compiled, which is slower: %s", name, reason)
            current = function
            current(*args, **kwargs)

    return call
