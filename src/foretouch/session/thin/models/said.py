"""Models over a link of few bytes: only what the leader's hand would feel, and only what changed.

The follower's end knows what the leader's has: the steps of each number that crossed (`compact`). It says a model where
the force that this one renders differs by more than a part of what can be felt (`felt`), as the difference to one that
the leader is known to render from, or whole.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import ModelUpdate, encode
from foretouch.models import ContactMapModel
from foretouch.models.contact_map.layout import MEMORY
from foretouch.models.law_kernel import Law
from foretouch.session.thin.models import compact, felt
from foretouch.session.thin.models.spared import spare
from foretouch.session.thin.models.told import (
    FARTHEST_PLAY,
    MEMORIES,
    MILLISECOND,
    NO_TEXTS,
    NOTHING,
    PLAIN,
    SALT,
    USUAL_MS,
    Form,
    Kept,
    Texts,
    calm,
    head_of,
    is_news,
    row_of,
    start_of,
    steps_of_memory,
    tag_of,
    texts_of,
)

PART = 0.2
"""Change of force at which a model is said while bytes are saved up, as a part of the just noticeable difference."""

ROUNDED, LEAST_ROUNDED = 0.5, 0.3
"""Change at which rounding is as rough as it may be; and the part of that by which it is in any case."""

STEADY_RATE, LEARNING_RATE, LEARNING_NS = 115.0, 560.0, 5_000_000_000
"""Bytes a second of models in the long run, and so long after there is a first model, or another material [ns]."""

LARGEST_BURST, COSTLY = 500.0, 8.0
"""Bytes that may be saved up. The fewer of them are left, the larger is the change that is said, up to so many times as
large: it is better to say much of the next press than everything of the first."""

HURRY_NS = 20_000_000
"""The sooner after the newest model, the larger is the change that is said: twice as large after this time [ns]. Until
a model is acknowledged, those after it say again what it said."""

LONGEST_NS = 2_000_000_000  # Longest time between two models [ns]
PATIENCE = 1.5  # Round trips after which a model is said again that the leader has not acknowledged
SELDOM_NS = 10_000_000_000  # Time between two messages of the numbers that only people look at [ns]
REMEMBERED, BASES = 64, 48  # Models that are remembered; and the newest, of which the other end keeps all


@dataclass(slots=True, eq=False)
class _Sent:
    """A model that was sent: as both ends know it, and what the leader renders from it."""

    kept: Kept
    law: NDArray[np.void]
    surface: float
    fixture: tuple[float, ...]
    sent_ns: int
    acknowledged: bool = False


class ModelsSaid:
    """The follower's end: says what the leader would feel.

    Args:
        part: Change of force at which a model is said while bytes are saved up, as a part of the just noticeable
            difference.
        plenty: How many times as many bytes it may take as it needs.
    """

    def __init__(self, part: float = PART, plenty: float = 1.0) -> None:
        self._part, self._plenty, self._form = part, plenty, Form()
        self._sent: OrderedDict[int, _Sent] = OrderedDict()  # the newest by their numbers
        self._newest: _Sent | None = None
        self._base: _Sent | None = None  # the newest that the leader is known to have
        self._other = Law.new()  # room for a law
        self._touches = felt.Touches.new()
        self._trip_ns = float(LONGEST_NS) / PATIENCE  # until a model is acknowledged
        self._whole, self._whole_ns = True, -LONGEST_NS
        self._seldom_ns = -SELDOM_NS
        self._allowance, self._allowed_ns, self._learnt_ns = plenty * LARGEST_BURST, 0, -LEARNING_NS
        for each in (felt.gap, felt.apart, felt.touch, felt.suppose, felt.remember, spare):
            each.entry  # noqa: B018  # see `Form`

    def ask_whole(self) -> None:
        """The other end lost what differences refer to."""
        self._whole, self._base = True, None

    def offer(self, update: ModelUpdate, acknowledged: int, now_ns: int) -> bytes | None:
        """What is to be sent of this model, None where nobody would feel it.

        Args:
            update: The newest model.
            acknowledged: Number of the newest model that the leader is known to render from, 0 before the first.
            now_ns: Time of this tick [ns].
        """
        self._note(acknowledged, now_ns)
        law, model = felt.law_of(update)
        self._touch(update, law, model)
        said = texts_of(update, model is not None)
        rate = LEARNING_RATE if now_ns - self._learnt_ns < LEARNING_NS else STEADY_RATE
        self._allowance += self._plenty * rate * 1e-9 * (now_ns - self._allowed_ns)
        self._allowance, self._allowed_ns = min(self._allowance, self._plenty * LARGEST_BURST), now_ns
        if not self._is_due(update, law, said, now_ns):
            return None
        data = None if said is None else self._write(update, law, model, *said, now_ns)
        if data is None:
            data = bytes([PLAIN]) + encode(update)
            self._keep(
                Kept(tag_of(data), update.sequence, 0, 0, NO_TEXTS, 0, NOTHING.steps), len(data), update, law, now_ns
            )
        return data

    def _touch(self, update: ModelUpdate, law: NDArray[np.void], model: ContactMapModel | None) -> None:
        """Take note of where the material is touched; of a law without memory nothing tells."""
        has = law, update.surface
        if self._newest is not None:
            has = self._newest.law, self._newest.surface
        if model is not None and len(update.state) == MEMORY:
            felt.touch.entry(law, update.surface, update.state, update.time_ns * 1e-9, *has, self._touches[0])
        elif model is None and update.valid:
            felt.suppose.entry(update.surface, *has, self._touches[0])

    def _note(self, acknowledged: int, now_ns: int) -> None:
        """Take note of what the leader renders from."""
        sent = self._sent.get(acknowledged)
        if sent is None or sent.acknowledged:
            return
        sent.acknowledged = True
        self._trip_ns += (
            0.25 * (now_ns - sent.sent_ns - self._trip_ns) if self._base else now_ns - sent.sent_ns - self._trip_ns
        )
        if self._base is None or acknowledged > self._base.kept.sequence:
            self._base = sent

    def _is_due(self, update: ModelUpdate, law: NDArray[np.void], said: tuple[Texts, int] | None, now_ns: int) -> bool:
        """Whether a model is to be said now."""
        sent = self._newest
        if sent is None or now_ns - sent.sent_ns >= LONGEST_NS:
            return True
        if self._whole and now_ns - self._whole_ns >= self._trip_ns:
            return True
        if self._differs(sent, update, law, said, now_ns - sent.sent_ns):
            return True
        late = not sent.acknowledged and now_ns - sent.sent_ns > PATIENCE * self._trip_ns
        return late and (self._base is None or self._differs(self._base, update, law, said, now_ns - sent.sent_ns))

    def _differs(
        self, sent: _Sent, update: ModelUpdate, law: NDArray[np.void], said: tuple[Texts, int] | None, since_ns: int
    ) -> bool:
        """Whether the leader would feel that it renders from a model that was sent in place of this one."""
        if said is not None and is_news(sent.kept.texts, said[0]):
            return True
        if self._allowance < 0.0:
            return False
        touches = self._touches[0]
        nowhere = not touches.count and abs(update.surface - sent.surface) > SURFACE_CHANGE
        if nowhere or felt.moved(sent.fixture, update.fixture):
            return True
        part = self._change() * (1.0 + HURRY_NS / max(since_ns, 1))
        if sent is self._newest:
            return bool(felt.gap.entry(law, update.surface, touches) > part)
        return bool(felt.apart.entry(law, update.surface, sent.law, sent.surface, touches) > part)

    def _change(self) -> float:
        """Change of force at which a model is said now, in just noticeable differences."""
        left = max(self._allowance, 0.0) / (self._plenty * LARGEST_BURST)
        return float(self._part * COSTLY ** (1.0 - left))

    def _write(
        self,
        update: ModelUpdate,
        law: NDArray[np.void],
        model: ContactMapModel | None,
        texts: Texts,
        reason: int,
        now_ns: int,
    ) -> bytes | None:
        """The message of a model; None where it has no such form."""
        base, memory = self._base_for(update), []
        if texts.state == MEMORIES:
            if max(map(abs, update.state)) > FARTHEST_PLAY:
                return None
            memory = steps_of_memory(update.state)
        row, is_map = row_of(update, model), model is not None
        if row is None:
            return None
        texts = calm(texts, base.texts)
        steps, start = np.empty(compact.COUNT, np.int64), start_of(base, texts.law)
        seldom = base is NOTHING or now_ns - self._seldom_ns >= SELDOM_NS or texts.errors != base.texts.errors
        compact.settle.entry(row, compact.grids_of(is_map), start, steps, self._form.maps, seldom)
        self._seldom_ns = now_ns if seldom else self._seldom_ns
        if model is not None:
            rounded = compact.value_of(steps[0], *compact.GRIDS_OF_MAP[0])
            spare.entry(
                steps,
                start,
                compact.GRIDS_OF_MAP,
                law,
                update.surface,
                rounded,
                self._other,
                self._form.maps,
                self._touches[0],
                min(max(self._change() / ROUNDED, LEAST_ROUNDED), 1.0),
            )
        head, heads = head_of(base, texts, update)
        numbers = self._form.write([*heads, reason, *memory], start, steps, is_map)
        if not numbers:
            return None
        data = self._named(head + numbers)
        time_ns = update.time_ns if base is NOTHING else base.time_ns + (heads[1] + USUAL_MS * heads[0]) * MILLISECOND
        kept = Kept(tag_of(data), update.sequence, time_ns, update.command_sequence, texts, reason, steps)
        seen = self._form.update_of(kept, update.state)
        if seen is None:
            return None
        if base is NOTHING:
            self._whole, self._whole_ns = False, now_ns
        before = self._newest.kept.texts if self._newest is not None else NO_TEXTS
        if texts.valid and (not before.valid or texts.reason not in ("", before.reason)):
            self._learnt_ns = now_ns
        self._keep(kept, len(data), seen, felt.law_of(seen)[0], now_ns)
        return data

    def _base_for(self, update: ModelUpdate) -> Kept:
        """What a model is written as the difference to."""
        base = self._base
        if base is None or self._whole or base.kept.texts.run != update.run:
            return NOTHING
        return base.kept if base in list(self._sent.values())[-BASES:] else NOTHING

    def _named(self, data: bytes) -> bytes:
        """The message with a first byte by which its tag is none of the others'."""
        taken = {sent.kept.tag for sent in self._sent.values()}
        for salt in range(0, 256, SALT):
            salted = bytes([data[0] + salt]) + data[1:]
            if tag_of(salted) not in taken:
                return salted
        return data

    def _keep(self, kept: Kept, size: int, seen: ModelUpdate, law: NDArray[np.void], now_ns: int) -> None:
        """Remember what was sent."""
        self._newest = self._sent[kept.sequence] = _Sent(kept, law, seen.surface, seen.fixture, now_ns)
        self._allowance -= size
        felt.remember.entry(law, seen.surface, self._touches[0])
        while len(self._sent) > REMEMBERED:
            self._sent.popitem(last=False)


SURFACE_CHANGE = 1e-4  # Motion of a surface that is always said while nothing has been touched [m]
