"""Which topic of a bag is the position or the force: by the type of its messages, and by how often they come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from foretouch.errors import RecordingError
from foretouch.recordings.meaning.mapping import Signal
from foretouch.recordings.meaning.names import BY_WORD, FORCE, POSITION, name_says, rank
from foretouch.recordings.source import Bag, Topic, listed

LEAST_RATE: Final = 20.0
"""What follows a press comes as often [1/s] or more; markers, stages and states of health come more rarely."""

FORCE_FIELDS: Final = {
    "geometry_msgs/msg/WrenchStamped": "wrench.force.z",
    "geometry_msgs/msg/Wrench": "force.z",
}
"""Types of messages that hold a force in newtons, and its field along z."""

POSITION_FIELDS: Final = {
    "geometry_msgs/msg/PoseStamped": "pose.position.z",
    "geometry_msgs/msg/PointStamped": "point.z",
    "geometry_msgs/msg/TransformStamped": "transform.translation.z",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose.position.z",
    "nav_msgs/msg/Odometry": "pose.pose.position.z",
    "geometry_msgs/msg/Pose": "position.z",
    "geometry_msgs/msg/Point": "z",
}
"""Types of messages that hold a position in metres, and its field along z."""

JOINTS: Final = "sensor_msgs/msg/JointState"
PLAIN: Final = {f"std_msgs/msg/{kind}": "data" for kind in ("Float64", "Float32")}
_OF = {POSITION: (POSITION_FIELDS, "m"), FORCE: (FORCE_FIELDS, "N")}

LOOKED_INTO: Final = 8
"""Number of topics that are looked into, those of most messages first; of other joint states one joint is taken for
a candidate, and of other topics the rate over the whole bag for their rate."""

NAMED: Final = 5  # number of candidates that are named in a sentence
LARGEST_LOOK: Final = 2**25  # bytes of the first messages, which tell along which axis something moves


@dataclass(frozen=True)
class Candidate:
    """One field that could be the quantity."""

    signal: Signal  # topic, field and unit
    # 3 for a type of message with that quantity, 2 for a joint alone, 1 for a joint among others or a bare number whose
    # topic is named like the quantity; words in a name are no more than that
    standing: int
    count: int  # number of messages
    rate: float  # messages per second [1/s]

    @property
    def text(self) -> str:
        """Place and rate, for people."""
        return f"{self.signal.place} ({self.rate:.4g} a second)"


class Chosen(NamedTuple):
    """What came of it: the only signal that it can be, or what is open with all candidates; and notes."""

    signal: Signal | None
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    candidates: tuple[str, ...]


def choose_topic(bag: Bag, quantity: str) -> Chosen:
    """The one topic that can be a quantity.

    Of the topics that come `LEAST_RATE` times a second or more, those whose type of message fits best; of several none.
    Where no topic comes as often, the same of all; positions that come so rarely are refused, for a press lies between
    two of them.
    """
    results = sorted(_candidates(bag, quantity), key=lambda one: (-one.standing, -one.count))
    if not results:
        types = listed(f"{topic.name} ({topic.type_name})" for topic in bag.topics)
        return Chosen(None, (f"no topic has messages of a type with a {quantity}; its topics: {types}",), (), ())
    names = tuple(one.signal.place for one in results)
    fast = [one for one in results if one.rate >= LEAST_RATE]
    best = [one for one in fast or results if one.standing == (fast or results)[0].standing]
    if len(best) > 1:
        return Chosen(None, (f"several topics could be {quantity}: {_some(best)}",), (), names)
    (one,) = best
    problems, notes = [], []
    if not fast and quantity == POSITION:
        problems.append(
            f"position {one.signal.place} comes {one.rate:.3g} times a second: one that comes less often than "
            f"{LEAST_RATE:g} times is not guessed, for a press lies between two of its messages"
        )
    rivals = [other for other in results if other is not one and other.standing >= one.standing]
    if fast and rivals:
        there = ", ".join(other.signal.topic for other in rivals[:NAMED])
        more = f" and {len(rivals) - NAMED} more" if len(rivals) > NAMED else ""
        notes.append(
            f"{quantity} is {one.text}, for no other topic of such messages comes {LEAST_RATE:g} times a second: "
            f"not {there}{more}"
        )
    return Chosen(one.signal, tuple(problems), tuple(notes), names if problems else ())


def axis_note(bag: Bag, quantity: str, signal: Signal) -> tuple[str, ...]:
    """A sentence where a quantity moves more along another axis than along z, which is assumed."""
    stem, dot, axis = signal.field.rpartition(".")
    if axis != "z":
        return ()
    fields = {name: f"{stem}{dot}{name}" for name in "xyz"}
    try:
        series = bag.read(signal.topic, list(fields.values()), within=LARGEST_LOOK)
    except RecordingError:
        return ()  # the reader of the whole reports why
    moved = {name: float(np.ptp(series.values[field])) for name, field in fields.items()}
    most = max(moved, key=lambda name: moved[name])
    if not moved[most] > moved["z"]:  # so that NaN gives no sentence
        return ()
    unit = signal.unit
    text = f"it moves most along {most} ({_amount(moved[most], unit)} against {_amount(moved['z'], unit)})"
    return (f'{quantity}: z is assumed, but {text}; [{quantity}] field = "{fields[most]}" takes that',)


def _amount(value: float, unit: str) -> str:
    return f"{1e3 * value:.3g} mm" if unit == "m" and value < 1.0 else f"{value:.3g} {unit}"


def _candidates(bag: Bag, quantity: str) -> list[Candidate]:
    fields, unit = _OF[quantity]
    there = sorted((topic for topic in bag.topics if topic.count), key=lambda topic: -topic.count)
    results: list[Candidate] = []
    joints = 0
    for topic in there:
        if topic.type_name in fields:
            signal = Signal(topic=topic.name, field=fields[topic.type_name], unit=unit)
            results.append(Candidate(signal, 3, topic.count, _rate(bag, topic, len(results))))
        elif topic.type_name == JOINTS and quantity == POSITION:
            joints += 1
            positions = _joints_of(bag, topic) if joints <= LOOKED_INTO else ["position[0]"]
            rate = _rate(bag, topic, len(results))
            standing = 2 if len(positions) == 1 else 1
            results += [
                Candidate(Signal(topic=topic.name, field=position), standing, topic.count, rate)
                for position in positions
            ]
        elif topic.type_name in PLAIN and rank(quantity, name_says(topic.name))[0] >= BY_WORD:
            signal = Signal(topic=topic.name, field=PLAIN[topic.type_name])
            results.append(Candidate(signal, 1, topic.count, _rate(bag, topic, len(results))))
    return results


def _joints_of(bag: Bag, topic: Topic) -> list[str]:
    return [column.name for column in bag.fields(topic.name) if column.name.startswith("position[")]


def _rate(bag: Bag, topic: Topic, before: int) -> float:
    """Messages a second [1/s], over the whole bag, or over the topic's first ones, whichever is more.

    A topic may be there for a part of the bag's time only.
    """
    if topic.count < 2 or bag.duration <= 0.0:
        return 0.0
    rate = (topic.count - 1) / bag.duration
    if rate >= LEAST_RATE or topic.count <= LEAST_RATE or before >= LOOKED_INTO:
        return rate
    return max(rate, bag.first_rate(topic.name, int(LEAST_RATE) + 1))


def _some(candidates: Sequence[Candidate]) -> str:
    named = ", ".join(one.text for one in candidates[:NAMED])
    more = len(candidates) - NAMED
    return f"{named} and {more} more" if more > 0 else named
