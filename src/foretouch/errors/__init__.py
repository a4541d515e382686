"""Errors that a user can meet, one tree.

    ForetouchError
    ├── InputError            what was given breaks a rule: exit code 2
    │   ├── RecordingError    a recording: file, row, rule
    │   ├── UnknownNameError  no such model, estimator, material ...: the valid names
    │   ├── SettingError      an option or a constructor argument out of range
    │   │   └── ArgumentTypeError  of another type than is wanted; a TypeError too
    │   └── DatasetError      a measured file or an arm's mesh is not here and cannot be fetched
    ├── LinkError             the network: a port in use, no peer: exit code 2
    │   └── PeerVersionError  the peer speaks another version of the messages
    ├── SideError             the loop of a side raised, as a driver may: exit code 1, and its traceback
    ├── DecodeError           bytes that are no message of ours (counted and dropped inside a session)
    └── MissingExtraError     a package of an optional extra is not installed: exit code 2

and one warning, `RecordingWarning`: a recording that was read, and what was guessed to read it.

Every message is one line that says what was found, where, which rule it breaks and what to do. Inside a control
loop nothing raises: a step returns a status with a sentence instead.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Any

from foretouch.errors.printing import install_command, one_line, plural, printable, was_or_were

__all__ = [
    "ArgumentTypeError",
    "DatasetError",
    "DecodeError",
    "ForetouchError",
    "InputError",
    "LinkError",
    "MissingExtraError",
    "PeerVersionError",
    "RecordingError",
    "RecordingWarning",
    "SettingError",
    "SideError",
    "UnknownNameError",
    "install_command",
    "one_line",
    "plural",
    "printable",
    "was_or_were",
]


class ForetouchError(Exception):
    """Base of every error that foretouch raises on purpose; its text is one line for the user, and printable."""

    def __str__(self) -> str:
        """What names and values in it would do to a terminal is shown instead of done."""
        return printable(super().__str__(), lines=True)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error as it is, not made again from its text."""
        return _as_it_was, (type(self), self.args), self.__dict__


def _as_it_was(kind: type[ForetouchError], args: tuple[Any, ...]) -> ForetouchError:
    error = kind.__new__(kind)
    error.args = args
    return error


class RecordingWarning(UserWarning):
    """What was guessed where a recording was read, or looks wrong in it; its text is one line for the user."""

    def __str__(self) -> str:
        """The text of `ForetouchError`."""
        return printable(super().__str__(), lines=True)


class InputError(ForetouchError):
    """What was given breaks a rule."""


class RecordingError(InputError):
    """A recording cannot be used.

    Args:
        source: The file (or another name of the recording).
        problem: What was found and which rule it breaks, in one line.
        row: Row in the file, counted as an editor counts lines (header = 1), where one row is to blame.
    """

    def __init__(self, source: object, problem: str, *, row: int | None = None) -> None:
        where = f"{source}" if row is None else f"{source}, row {row}"
        super().__init__(f"{where}: {problem}")
        self.source = source
        self.row = row


class UnknownNameError(InputError):
    """A name that is not registered.

    Args:
        kind: What was looked for, for example ``"estimator"``.
        name: The name that was given.
        choices: The names that exist.
    """

    def __init__(self, kind: str, name: str, choices: Iterable[str]) -> None:
        self.choices = sorted(choices)
        super().__init__(f"unknown {kind} {name!r}: choose one of {', '.join(self.choices)}")


class SettingError(InputError):
    """An option or constructor argument breaks its rule.

    Args:
        name: Name of the option or the argument.
        value: Value that was given.
        rule: Rule that it breaks, and what to do.
    """

    def __init__(self, name: str, value: object, rule: str) -> None:
        super().__init__(f"{name} = {value!r}: {rule}")
        self.name = name


class ArgumentTypeError(SettingError, TypeError):
    """An argument is of another type than is wanted.

    Args:
        name: Name of the argument.
        value: Value that was given.
        wanted: What is wanted, and how one gets it.
    """

    def __init__(self, name: str, value: object, wanted: str) -> None:
        given = "None" if value is None else f"{one_line(reprlib.repr(value))} ({type(value).__name__})"
        InputError.__init__(self, f"{name} is {given}: must be {wanted}")
        self.name = name


class DatasetError(InputError):
    """What others published is neither here (``FORETOUCH_DATA_DIR``, cache) nor can be fetched, or is damaged."""


class SideError(ForetouchError):
    """The loop of a side raised, and its session was ended in order; what was raised is the ``__cause__``."""


class LinkError(ForetouchError):
    """The network link cannot be used."""


class PeerVersionError(LinkError):
    """The peer speaks another version of the messages."""

    def __init__(self, theirs: object, ours: int) -> None:
        super().__init__(
            f"the peer speaks message version {theirs}, this side version {ours}: "
            "install the same foretouch version on both machines"
        )


class DecodeError(ForetouchError):
    """Bytes that are no message of ours."""


class MissingExtraError(ForetouchError):
    """An optional package is missing, or several; separated by commas, as their extras are then."""

    def __init__(self, package: str, extra: str) -> None:
        verb = "are" if "," in package else "is"
        super().__init__(f"{package} {verb} not installed: {install_command(extra)}")
