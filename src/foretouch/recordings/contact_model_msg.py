"""The contact model as a ROS 2 message of its own, for tools and robots that know nothing of foretouch.

`foretouch_msgs/msg/ContactModel` carries the law's numbers with their names; a receiver needs no table of laws to read
them. `/follower/model` beside it carries every field of `ModelUpdate`, also those that only foretouch can use.
"""

from __future__ import annotations

from typing import Final

from foretouch.messages import ModelUpdate
from foretouch.models import LAWS
from foretouch.recordings.cdr import pack_fields

__all__ = ["CONTACT_MODEL_MSG", "CONTACT_MODEL_TYPE", "contact_model", "number_array", "parameter_names"]

CONTACT_MODEL_TYPE: Final = "foretouch_msgs/msg/ContactModel"

CONTACT_MODEL_MSG: Final = """\
std_msgs/Header header
string law
string[] names
float64[] values
float64[] standard_errors
float64 surface
bool valid
string reason
uint64 sequence
"""
"""Definition in the ``.msg`` language: the law, the names and values of its numbers in SI units, the standard error of
each (NaN for one that is undetermined, none at all where the estimator tells none), the position of the undeformed
surface [m], whether a force may be computed from it, why not, and the running number of the model."""

_HEADER: Final = {"sec": "int32", "nanosec": "uint32", "frame_id": "string"}
_CONTACT_MODEL: Final = _HEADER | {
    name: ros_type for ros_type, name in (line.split() for line in CONTACT_MODEL_MSG.splitlines()[1:])
}
_NUMBER_ARRAY: Final = {"dimensions": "uint32", "label": "string", "size": "uint32", "stride": "uint32"} | {
    "data_offset": "uint32",
    "data": "float64[]",
}


def parameter_names(law: str, count: int) -> tuple[str, ...]:
    """Names of a law's numbers in their order; empty where the law is not known, or has not so many."""
    names = LAWS[law].parameter_names if law in LAWS else ()
    return names if len(names) == count else ()


def contact_model(update: ModelUpdate, stamp: tuple[int, int], frame: str) -> bytes:
    """CDR bytes of a ContactModel.

    Args:
        update: The model as the follower sent it.
        stamp: Seconds and nanoseconds of the header.
        frame: Of the header.
    """
    names = parameter_names(update.law, len(update.parameters))
    numbers = (names, update.parameters, update.standard_errors)
    return pack_fields(
        _CONTACT_MODEL,
        (*stamp, frame, update.law, *numbers, update.surface, update.valid, update.reason, update.sequence),
    )


def number_array(update: ModelUpdate) -> bytes:
    """CDR bytes of a Float64MultiArray of the law's numbers; its one dimension is labelled with their names."""
    label, count = ",".join(parameter_names(update.law, len(update.parameters))), len(update.parameters)
    return pack_fields(_NUMBER_ARRAY, (1, label, count, count, 0, update.parameters))
