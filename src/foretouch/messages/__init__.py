"""The messages: one schema for the link, the recordings and the console.

`CHANNELS` is the whole table of what is sent, by whom and how often; `encode` and `decode` turn a message into
msgpack bytes and back, strictly.
"""

from foretouch.messages.channels import CHANNELS, Channel
from foretouch.messages.codec import decode, encode
from foretouch.messages.schema import (
    VERSION,
    Command,
    Handle,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    Settings,
    Stop,
    Telemetry,
)
from foretouch.messages.session_log import (
    COUNT_PREFIX,
    FOLLOWER_DTYPE,
    LEADER_DTYPE,
    SessionLog,
    SessionRows,
    as_row,
    split_texts,
)

__all__ = [
    "CHANNELS",
    "COUNT_PREFIX",
    "FOLLOWER_DTYPE",
    "LEADER_DTYPE",
    "VERSION",
    "Channel",
    "Command",
    "Handle",
    "Hello",
    "LeaderState",
    "Message",
    "ModelUpdate",
    "SessionLog",
    "SessionRows",
    "Settings",
    "Stop",
    "Telemetry",
    "as_row",
    "decode",
    "encode",
    "split_texts",
]
