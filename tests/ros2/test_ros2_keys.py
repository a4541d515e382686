"""Keys and tokens against those written out in the documentation of rmw_zenoh, and against another implementation."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.ros2 import DEFAULT, SENSOR_DATA, Node, Qos, TopicType, dds_type
from foretouch.ros2.keys import NEWEST

STRING = TopicType("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18")
NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,12}", fullmatch=True)
NAMESPACES = st.lists(NAMES, max_size=3).map(lambda names: "/" + "/".join(names))


def test_keys_are_those_of_the_design_document() -> None:
    # "Topic and Service name mapping to Zenoh key expressions", docs/design.md of ros2/rmw_zenoh
    assert Node().topic_key("/chatter", STRING) == (
        "0/chatter/std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )
    assert Node(0, "/robot1").topic_key("/chatter", STRING) == (
        "0/robot1/chatter/std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def test_tokens_are_those_of_the_design_document() -> None:
    # "Graph Cache", docs/design.md of ros2/rmw_zenoh
    listener = Node(2, "/", "listener").token("aac3178e146ba6f1fc6e6a4085e77f21", 0)
    assert listener == "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    talker = Node(2, "/", "talker")
    token = talker.publisher_token("8b20917502ee955ac4476e0266340d5c", (0, 10), "/chatter", STRING, Qos(True, 7))
    assert token == (
        "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18/::,7:,:,:,,"
    )


def test_quality_of_service_is_written_as_rmw_zenoh_does() -> None:
    # rmw/types.h: best effort is 2. qos.cpp of rmw_zenoh_cpp: reliable, volatile, keep last, 42 are said by nothing.
    assert DEFAULT.token == "::,10:,:,:,,"  # as of the listener in docs/design.md
    assert SENSOR_DATA.token == "2::,5:,:,:,,"
    assert Qos(True, 42).token == "::,:,:,:,,"
    assert NEWEST.token == "::,1:,:,:,,"  # what rclcpp::QoS(1) is


@given(st.booleans(), st.integers(1, 1000))
def test_another_implementation_reads_the_same_quality_of_service(reliable: bool, depth: int) -> None:
    qos = pytest.importorskip("zenoh_ros2_sdk.qos")
    if depth == 42:  # it takes 10 for the default, which rmw_zenoh does not
        return
    profile = qos.QosProfile.decode(Qos(reliable, depth).token)
    assert (profile.reliability is qos.QosReliability.RELIABLE) == reliable
    assert profile.history_depth == depth
    assert profile.durability is qos.QosDurability.VOLATILE
    assert (profile.history_kind, profile.deadline) == (qos.QosHistoryKind.KEEP_LAST, qos.DURATION_INFINITE)


@given(st.integers(0, 232), NAMESPACES, NAMES, st.lists(NAMES, min_size=1, max_size=3), st.integers(0, 99))
def test_another_implementation_makes_the_same_keys(
    domain: int, namespace: str, name: str, words: list[str], number: int
) -> None:
    sdk, entity = pytest.importorskip("zenoh_ros2_sdk.keyexpr"), pytest.importorskip("zenoh_ros2_sdk.entity")
    zenoh = pytest.importorskip("zenoh")
    node, topic = Node(domain, namespace, name), "/" + "/".join(words)
    full = node.full_name(topic)
    theirs = entity.NodeEntity(domain, "1a2b3c", 0, name, namespace)
    end = entity.EndpointEntity(
        theirs, number, entity.EntityKind.PUBLISHER, full, dds_type(STRING.name), STRING.hash, SENSOR_DATA.token
    )
    assert node.topic_key(topic, STRING) == sdk.topic_keyexpr(domain, full, dds_type(STRING.name), STRING.hash)
    assert node.token("1a2b3c", 0) == sdk.node_liveliness_keyexpr(theirs)
    token = node.publisher_token("1a2b3c", (0, number), topic, STRING, SENSOR_DATA)
    assert token == sdk.endpoint_liveliness_keyexpr(end)
    listens = dataclasses.replace(end, kind=entity.EntityKind.SUBSCRIPTION)
    token = node.subscription_token("1a2b3c", (0, number), topic, STRING, SENSOR_DATA)
    assert token == sdk.endpoint_liveliness_keyexpr(listens)
    assert str(zenoh.KeyExpr(token)) == token  # a key that Zenoh takes as it is


@pytest.mark.parametrize("domain", [-1, 233])
def test_a_domain_that_is_none_is_refused(domain: int) -> None:
    with pytest.raises(SettingError, match=rf"domain = {domain}: must be 0 to 232, as ROS_DOMAIN_ID"):
        Node(domain)


@pytest.mark.parametrize(
    "namespace", ["", "robot1", "/robot1/", "//robot1", "/1robot", "/robot 1", "/a*", "/a%b", "/ü"]
)
def test_a_namespace_that_is_none_is_refused(namespace: str) -> None:
    with pytest.raises(SettingError, match=r"namespace = .*: must be /, or names"):
        Node(0, namespace)


@pytest.mark.parametrize("name", ["", "1", "a/b", "a b"])
def test_a_node_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(SettingError, match="must be letters, digits and _"):
        Node(0, "/", name)
