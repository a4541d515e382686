"""Arguments that a command takes and does not name itself."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence

__all__ = ["with_parameters"]


def with_parameters(command: Callable[..., None], parameters: Sequence[inspect.Parameter]) -> Callable[..., None]:
    """Say which arguments a command takes, where `inspect.signature` and Typer look for them.

    Args:
        command: That takes any; it is changed.
        parameters: With their annotations.

    Returns:
        The command.
    """
    vars(command)["__signature__"] = inspect.Signature(parameters)
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command
