"""Which kernels are exported, and what they and their records are called in C: one entry each.

To export a kernel, add an entry, and a `Struct` for each record that it takes. Its documentation is its own docstring.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cache
from typing import Any

from foretouch.core.compiling import Kernel, interpreted
from foretouch.devices import hand_kernel
from foretouch.export.structs import Struct, records_in, snake
from foretouch.export.targets import Target
from foretouch.identification.contact_map import trial
from foretouch.robot import RobotSample, slide
from foretouch.session.safety import kernel as safety
from foretouch.session.safety.safety import SafetyLimits
from foretouch.session.steps import delaying, following, leading
from foretouch.session.steps.tick import Follower


@dataclass(frozen=True, slots=True)
class Entry:
    """A kernel as a function of C.

    Attributes:
        name: In C, without the prefix.
        kernel: What is exported.
        results: Names of its results, each written where a pointer says; a kernel of one result returns it.
        parameters: Names of its parameters in C, those of tuples one by one, where not the kernel's own.
    """

    name: str
    kernel: Kernel[..., Any]
    results: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """What it does."""
        return inspect.getdoc(interpreted(self.kernel.function)) or ""


SHOWN = RobotSample._fields[:-1]  # all but whether it holds, which is of arms
ASKED = ("stop", "release", "ended")
DRAWS = ("encoder", "sensor", "accelerometer")

ENTRIES = (
    Entry("leader_heard", leading.hear),
    Entry("leader_adopt_received", leading.adopt),
    Entry("leader_tick", leading.tick),
    Entry("follower_take_received", following.take),
    Entry("follower_step", following.tick, parameters=("follower", *SHOWN, "now_ns", "period_ns", *ASKED)),
    Entry("follower_publish", following.publish),
    Entry("follower_published", following.published),
    Entry("safety_set", safety.set_limits),
    Entry("safety_keep", safety.keep_safe, results=("aim", "status")),
    Entry("safety_limit", safety.limit),
)
"""In the code for every processor."""

SIMULATED = (
    Entry("slide_exchange", slide.exchange, results=SHOWN, parameters=("slide", "desired", *DRAWS)),
    Entry("hand_move", hand_kernel.move),
    Entry("leader_tick_delayed", delaying.tick_delayed),
    Entry("trial_expect", trial.expect),
    Entry("trial_learn", trial.learn),
    Entry("trial_foretell", trial.foretell),
)
"""In the code for a browser, where a robot, a hand and a network are simulated, and recordings are predicted."""

NAMED = {
    safety.Limits: Struct(safety.Limits, "safety_limits", described=SafetyLimits),
    safety.Memory: Struct(safety.Memory, "safety"),
    leading.Leader: Struct(leading.Leader, "leader"),
    following.Following: Struct(following.Following, "follower"),
    Follower: Struct(Follower, "follower_memory"),
    slide.Slide: Struct(slide.Slide, "slide"),
    hand_kernel.Held: Struct(hand_kernel.Held, "hand"),
    delaying.Delaying: Struct(delaying.Delaying, "delaying"),
    trial.Trial: Struct(trial.Trial, "trial"),
}
"""What is called otherwise in C than its class."""


def entries_of(target: Target) -> tuple[Entry, ...]:
    """What is exported for a target."""
    return ENTRIES + SIMULATED if target.simulates else ENTRIES


@cache
def structs() -> tuple[Struct, ...]:
    """The records of all entries, each after those that it is made of, which are called as their classes are."""
    every = dict.fromkeys(kind for one in NAMED for kind in records_in(one))
    return tuple(NAMED.get(kind, Struct(kind, snake(kind))) for kind in every)
