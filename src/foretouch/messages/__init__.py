"""The messages: one schema for the link, the recordings and the console.

`CHANNELS` is the whole table of what is sent, by whom and how often; `encode` and `decode` turn a message into
msgpack bytes and back, strictly.
"""

from foretouch.messages.codec import CHANNELS, LARGEST_MESSAGE, Channel, as_printed, decode, encode, foreign_speaker
from foretouch.messages.hellos import COUNT_PREFIX, NEWS, PROCESS, SINCE, Hellos, Said, settings_at, split_texts
from foretouch.messages.schema import (
    SIDES,
    SPEAKERS,
    STATUS_SENTENCES,
    VERSION,
    WITH_THE_COMMANDS,
    Choice,
    Command,
    EmergencyStop,
    Handle,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    Settings,
    Status,
    Stop,
    Telemetry,
)
from foretouch.messages.session_log import (
    FOLLOWER_DTYPE,
    FOLLOWER_SPACE_DTYPE,
    LEADER_DTYPE,
    LEADER_SPACE_DTYPE,
    SessionLog,
    SessionRows,
    as_row,
)
from foretouch.messages.spatial import CameraImage, FieldUpdate, FixtureBelief, FollowerSpace, LeaderSpace

__all__ = [
    "CHANNELS",
    "COUNT_PREFIX",
    "FOLLOWER_DTYPE",
    "FOLLOWER_SPACE_DTYPE",
    "LARGEST_MESSAGE",
    "LEADER_DTYPE",
    "LEADER_SPACE_DTYPE",
    "NEWS",
    "PROCESS",
    "SIDES",
    "SINCE",
    "SPEAKERS",
    "STATUS_SENTENCES",
    "VERSION",
    "WITH_THE_COMMANDS",
    "CameraImage",
    "Channel",
    "Choice",
    "Command",
    "EmergencyStop",
    "FieldUpdate",
    "FixtureBelief",
    "FollowerSpace",
    "Handle",
    "Hello",
    "Hellos",
    "LeaderSpace",
    "LeaderState",
    "Message",
    "ModelUpdate",
    "Said",
    "SessionLog",
    "SessionRows",
    "Settings",
    "Status",
    "Stop",
    "Telemetry",
    "as_printed",
    "as_row",
    "decode",
    "encode",
    "foreign_speaker",
    "settings_at",
    "split_texts",
]
