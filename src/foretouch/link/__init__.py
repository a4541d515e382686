"""The link: bytes between processes and machines (Zenoh), and seeded network faults on top.

It never sees a law; what it carries is the table `foretouch.messages.CHANNELS`.
"""

from foretouch.link.endpoints import check_endpoint, check_port_free, free_endpoint
from foretouch.link.fault_stage import FaultStage
from foretouch.link.faults import Faults
from foretouch.link.sequence import SequenceCounter
from foretouch.link.zenoh_link import ZenohLink

__all__ = ["FaultStage", "Faults", "SequenceCounter", "ZenohLink", "check_endpoint", "check_port_free", "free_endpoint"]
