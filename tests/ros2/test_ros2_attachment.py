"""The attachment to the byte, and the identifier in it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.ros2 import Node, Qos, TopicType, attachment, publisher_gid

TALKER = Node(2, "/", "talker").publisher_token(
    "8b20917502ee955ac4476e0266340d5c",
    (0, 10),
    "/chatter",
    TopicType("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
    Qos(True, 7),
)
GIDS = {
    # xxhash 4.1.0 of PyPI, which wraps the original library: low half, then high half, each little endian
    129: "326aae57e5b30419e59e63ca7d73375c",
    160: "6456e76beb1d057e2cbebeb3bff41687",
    161: "d56dcb6b5ce2cd2d22e1227e35503651",
    224: "d0bd98f8463fe93f574bd53358a29890",
    240: "3bafceee62e8f02fd555b92be2f26fd5",
    241: "65fb1a1b932ee2d9a297ea9b85dd16d3",
    256: "b3c07fbbb5a29c4cc4f8ea1dbba9d1df",
    257: "ce564323c66b81240c6634b16e6755a6",
    1024: "1d8f1067e117bf01213e61795d431ed2",
    1025: "ad091c77d084a7bc15e71b3eb6d98e00",
    1088: "198377b0ce07396ba111bc22284de4a1",
    3000: "a017419ed8196e062f58602eb718bc50",
}
DIGITS = "0123456789abcdefghijklmnopqrstuvwxyz" * 100


def test_the_bytes_are_those_of_the_design_document() -> None:
    # "Publishers", docs/design.md of ros2/rmw_zenoh: 8 bytes number, 8 bytes time, 1 byte length (16), 16 bytes
    data = attachment(1, 1_764_000_000_123_456_789, bytes(range(16)))
    number, sent = "0100000000000000", "15cd256fa7fc7a18"
    assert int.from_bytes(bytes.fromhex(sent), "little") == 1_764_000_000_123_456_789
    assert data == bytes.fromhex(number + sent + "10" + "000102030405060708090a0b0c0d0e0f")


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1), st.binary(min_size=16, max_size=16))
def test_the_bytes_are_those_of_zenohs_own_serialiser_and_of_another_reader(number: int, sent: int, gid: bytes) -> None:
    ext, sdk = pytest.importorskip("zenoh.ext"), pytest.importorskip("zenoh_ros2_sdk.attachment")
    data = attachment(number, sent, gid)
    assert data == bytes(ext.z_serialize((ext.Int64(number), ext.Int64(sent), gid)))
    read = sdk.Attachment.from_bytes(data)
    assert (read.sequence_id, read.timestamp_ns, read.gid) == (number, sent, gid)


def test_the_identifier_of_a_token_is_that_of_the_original_hash() -> None:
    assert publisher_gid(TALKER).hex() == "ac170f31eadcd9ff0cd86d7a17907d1c"


@pytest.mark.parametrize("length", GIDS)
def test_the_identifier_is_that_of_the_original_hash_at_every_length(length: int) -> None:
    assert publisher_gid(DIGITS[:length]).hex() == GIDS[length]


def test_a_text_that_is_no_publishers_token_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 129 bytes, and not 128"):
        publisher_gid(DIGITS[:128])
