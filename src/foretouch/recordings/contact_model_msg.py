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
# A contact model as the follower learns it. All numbers are in SI units: metres, newtons, seconds.

# When the follower had it. frame_id is "probe", whose z points out of the surface, as the force does.
std_msgs/Header header

# Name of the contact law, such as "contact-map" or "hunt-crossley".
string law

# The law's numbers by name, in the law's own order, for depths in metres: the stiffness of "hunt-crossley" is in
# N/m^exponent, an exponent has no unit. No names where the sender does not know the law.
string[] names
float64[] values

# Standard error of each value, in its unit: NaN for one that is undetermined; empty where the estimator tells none.
float64[] standard_errors

# Where the undeformed surface is [m], along the probe's axis, in the coordinate of the joint of /follower/joint_states,
# which grows into the material: depth is that position less this one. In the frame "world" of a session along a line
# it lies at z of minus this. In a scene: how much deeper than its known shape the surface was felt, along its normal.
float64 surface

# Whether a force may be computed from it.
bool valid

# One sentence: why it may not, or what there is to know.
string reason

# Running number of the model; it counts from 1 in each process of the follower, and a gap is one that did not arrive.
uint64 sequence
"""
"""Definition in the ``.msg`` language, which says what each field is; ``ros2/foretouch_msgs`` has the same text."""

_HEADER: Final = {"sec": "int32", "nanosec": "uint32", "frame_id": "string"}
_FIELDS: Final = [line.split() for line in CONTACT_MODEL_MSG.splitlines() if line and not line.startswith("#")]
_CONTACT_MODEL: Final = _HEADER | {name: ros_type for ros_type, name in _FIELDS[1:]}
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
