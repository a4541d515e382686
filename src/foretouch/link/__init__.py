"""The link: bytes between processes and machines (Zenoh), permission to send them, and seeded network faults on top.

It never sees a law; what it carries is the table `foretouch.messages.CHANNELS`.
"""

from foretouch.link.access import (
    Credentials,
    access_list,
    check_endpoint,
    check_port_free,
    free_endpoint,
    is_encrypted,
    is_exposed,
    load_credentials,
    may_publish,
)
from foretouch.link.certificates import CERTIFICATE_DAYS, WARNING_DAYS, Identity
from foretouch.link.faults import Faults, FaultStage
from foretouch.link.followers_here import WaitingNote, followers
from foretouch.link.frames import CHANNEL_NUMBERS, FrameServer
from foretouch.link.key_folder import ROLES, KeyFolder, default_key_folder
from foretouch.link.networks.named import NETWORK_NAMES, PUBLISHED_NETWORKS, network_trace
from foretouch.link.networks.reading import read_trace
from foretouch.link.networks.trace import NetworkTrace
from foretouch.link.sequence import SequenceCounter
from foretouch.link.zenoh_link import ASKING_PERIOD_NS, STOPPING_CHANNELS, ZenohLink, ask_to_stop, new_press

__all__ = [
    "ASKING_PERIOD_NS",
    "CERTIFICATE_DAYS",
    "CHANNEL_NUMBERS",
    "NETWORK_NAMES",
    "PUBLISHED_NETWORKS",
    "ROLES",
    "STOPPING_CHANNELS",
    "WARNING_DAYS",
    "Credentials",
    "FaultStage",
    "Faults",
    "FrameServer",
    "Identity",
    "KeyFolder",
    "NetworkTrace",
    "SequenceCounter",
    "WaitingNote",
    "ZenohLink",
    "access_list",
    "ask_to_stop",
    "check_endpoint",
    "check_port_free",
    "default_key_folder",
    "followers",
    "free_endpoint",
    "is_encrypted",
    "is_exposed",
    "load_credentials",
    "may_publish",
    "network_trace",
    "new_press",
    "read_trace",
]
