"""What raised in the stages of a step: counted, kept in one sentence, and no reason for a robot to be left alone."""

from __future__ import annotations

from foretouch.errors import one_line

__all__ = ["Failures"]

LONGEST_TEXT = 200
"""Characters of an exception's own text that are kept."""


class Failures:
    """Exceptions in the stages of a follower's step.

    A stage that learns ends with its first exception: what it holds then is worth nothing. Other stages are tried
    again in the next tick. Safety comes after all of them and needs none.

    Attributes:
        count: Of exceptions so far.
        sentence: What raised first, where and why, on one line; "" while nothing has.
        learns: Whether learning goes on.
    """

    __slots__ = ("count", "learns", "sentence")

    def __init__(self) -> None:
        self.count = 0
        self.sentence = ""
        self.learns = True

    def note(self, stage: str, error: Exception) -> None:
        """Take one exception.

        Args:
            stage: Where, as the end of "raised in".
            error: What was raised; neither it nor its frames are kept.
        """
        self.count += 1
        if not self.sentence:
            said = one_line(error, LONGEST_TEXT)
            self.sentence = f"{type(error).__name__} raised in {stage}{f' ({said})' if said else ''}"

    def stop_learning(self, stage: str, error: Exception) -> None:
        """Take one exception of what learns: it learns no more.

        Args:
            stage: As for `note`.
            error: As for `note`.
        """
        if self.learns:
            self.sentence = ""  # that learning has ended is what people have to know
        self.learns = False
        self.note(stage, error)
