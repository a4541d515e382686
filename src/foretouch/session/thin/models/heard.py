"""What the leader's end makes of the bytes of models."""

from __future__ import annotations

import math
import struct
from typing import Any

import msgspec

from foretouch.errors import ForetouchError
from foretouch.messages import ModelUpdate, decode, encode
from foretouch.models.contact_map.layout import MEMORY
from foretouch.session.thin.models import coding
from foretouch.session.thin.models.told import (
    DIFFERENCE,
    LENGTH,
    MEMORIES,
    MILLISECOND,
    NO_TEXTS,
    NOTHING,
    OTHER,
    PLAIN,
    TAG,
    TEXTS,
    UNTOUCHED,
    USUAL_MS,
    WHOLE,
    Form,
    Kept,
    Texts,
    decode_texts,
    memory_of_steps,
    start_of,
    tag_of,
    texts_from,
)

KEPT = 64  # Newest models that are kept, for a difference to one of them


class ModelsHeard:
    """The leader's end: what arrives becomes the messages that the follower made, as far as they can be felt.

    Attributes:
        wants_whole: Whether a model came that differs from one that is not here.
    """

    def __init__(self) -> None:
        self._form = Form()
        self._kept: dict[int, Kept] = {}  # by their numbers
        self.wants_whole = False

    def take(self, data: bytes) -> ModelUpdate | None:
        """The model of these bytes; None where they are none, or its base is not known: then `wants_whole` is True."""
        try:
            return self._take(data)
        except (ForetouchError, msgspec.MsgspecError, struct.error, ValueError, OverflowError, RecursionError):
            return None

    def _take(self, data: bytes) -> ModelUpdate | None:
        if not data:
            return None
        if data[0] == PLAIN:
            update = decode(data[1:], ModelUpdate)
            self._keep(Kept(tag_of(data), update.sequence, 0, 0, NO_TEXTS, 0, NOTHING.steps), update.run)
            return update
        kind, told, at = data[0] % TEXTS, [], 1
        if kind not in (WHOLE, DIFFERENCE):
            return None
        base = NOTHING
        if kind == DIFFERENCE:
            (tag,) = TAG.unpack_from(data, at)
            at += TAG.size
            known = [kept for kept in self._kept.values() if kept.tag == tag]
            if not known:
                self.wants_whole = True
                return None
            base = max(known, key=lambda kept: kept.sequence)
        if data[0] & TEXTS:
            (length,) = LENGTH.unpack_from(data, at)
            at += LENGTH.size
            told, at = decode_texts(data[at : at + length], type=list), at + length
        texts, whole = texts_from(base.texts, told)
        if len(whole) != (3 if kind == WHOLE else 0):
            return None
        kept, memory = self._read(data[at:], base, texts, whole)
        found = self._form.update_of(Kept(tag_of(data), *kept), memory)
        if found is None:
            return None
        update = decode(encode(found), ModelUpdate)
        self._keep(Kept(tag_of(data), *kept), update.run)
        self.wants_whole = self.wants_whole and kind != WHOLE
        return update

    def _read(self, data: bytes, base: Kept, texts: Texts, whole: list[int]) -> Any:
        """The fields of a `Kept` after its tag, and the state."""
        memories = len(coding.MEMORY) if texts.state == MEMORIES else 0
        heads, steps = self._form.read(data, len(coding.HEAD) + memories, start_of(base, texts.law), texts.is_map)
        number, passed, commands, reason = heads[: len(coding.HEAD)]
        if not 0 <= reason <= OTHER:
            raise ValueError("no such reason")
        state = memory_of_steps(heads[len(coding.HEAD) :]) if memories else ()
        if texts.state == UNTOUCHED:
            state = (math.nan,) * MEMORY
        if not whole:
            passed += USUAL_MS * number
            time_ns = base.time_ns + passed * MILLISECOND
            whole = [base.sequence + number, time_ns, base.command_sequence + commands + passed]
        return (*whole, texts, reason, steps), state

    def _keep(self, kept: Kept, run: int) -> None:
        """Remember a model that came; those of another run of the follower are of no use any more."""
        self._kept = {
            number: one for number, one in self._kept.items() if one.texts.run == run or one.steps is NOTHING.steps
        }
        self._kept[kept.sequence] = kept
        if len(self._kept) > KEPT:
            del self._kept[min(self._kept)]
