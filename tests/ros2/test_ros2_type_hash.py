"""Type hashes against those that are published, and against two other implementations."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from foretouch.recordings.formats.topics import CONTACT_MODEL_MSG, CONTACT_MODEL_TYPE, STANDARD, StandardTopic
from foretouch.ros2 import type_description, type_hash

PUBLISHED = {
    # docs/design.md of ros2/rmw_zenoh
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    # `ros2 topic info -v` of a running ROS 2, as people quote it; the type_hashes of Jazzy's installed JSON files
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "sensor_msgs/msg/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "geometry_msgs/msg/WrenchStamped": "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
}
PACKAGE = Path(__file__).resolve().parents[2] / "ros2" / "foretouch_msgs"
SCHEMAS = {topic.type_name: topic.schema for topic in STANDARD} | {"std_msgs/msg/String": "string data\n"}


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_hash_is_the_published_one(name: str) -> None:
    assert type_hash(name, SCHEMAS[name]) == f"RIHS01_{PUBLISHED[name]}"


def test_every_type_of_another_implementation_has_its_hash() -> None:
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    equal, refused = 0, []
    for name in store.types:
        schema = store.generate_msgdef(name, ros_version=2)[0]
        # Of a char, rosidl makes a uint8 and rosbags something of its own: we know neither, nor bounded types.
        if re.search(r"<=\d|\bchar\b", schema):
            refused.append(name)
            with pytest.raises(ValueError, match=r"cannot describe the type|is not there"):
                type_hash(name, schema)
            continue
        assert type_hash(name, schema) == store.hash_rihs01(name), name
        equal += 1
    assert equal > 140
    assert len(refused) < 15


@pytest.mark.parametrize("topic", STANDARD, ids=lambda topic: topic.name)
def test_every_topic_of_ours_has_the_hash_of_two_other_implementations(topic: StandardTopic) -> None:
    typesys, sdk = pytest.importorskip("rosbags.typesys"), pytest.importorskip("zenoh_ros2_sdk.utils")
    ours = type_hash(topic.type_name, topic.schema)
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(topic.schema, topic.type_name))
    assert ours == store.hash_rihs01(topic.type_name)
    first, *others = topic.schema.split("=" * 80 + "\n")
    inside = {}
    for other in others:
        title, _, text = other.partition("\n")
        inside["/msg/".join(title.removeprefix("MSG: ").split("/"))] = text
    assert ours == sdk.compute_type_hash_from_msg(topic.type_name, first, inside)


def test_the_description_is_what_the_standard_says() -> None:
    schema = "Inner[] many\nfloat64[3] vector\n" + "=" * 80 + "\nMSG: pack/Inner\nstring text\n"
    assert type_description("pack/msg/Outer", schema) == {
        "type_description": {
            "type_name": "pack/msg/Outer",
            "fields": [
                _described("many", 145, nested="pack/msg/Inner"),
                _described("vector", 59, capacity=3),
            ],
        },
        "referenced_type_descriptions": [{"type_name": "pack/msg/Inner", "fields": [_described("text", 17)]}],
    }


def _described(name: str, number: int, *, capacity: int = 0, nested: str = "") -> dict[str, object]:
    kind = {"type_id": number, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}
    return {"name": name, "type": kind}


def test_comments_constants_and_defaults_change_nothing_and_all_else_does() -> None:
    plain = type_hash("pack/msg/One", "float64 x\nstring y\n")
    same = "# what it is\nuint8 LARGE=3\nuint8 SMALL = 1\nfloat64 x 1.5  # a default\n\nstring y\n"
    assert type_hash("pack/msg/One", same) == plain
    others = ("float32 x\nstring y\n", "float64 z\nstring y\n", "string y\nfloat64 x\n", "float64[] x\nstring y\n")
    assert len({plain, type_hash("pack/msg/Two", same), *(type_hash("pack/msg/One", other) for other in others)}) == 6


@pytest.mark.parametrize(
    ("schema", "message"),
    [
        ("std_msgs/Header header\n", "pack/msg/One.header: the definition of std_msgs/msg/Header is not there"),
        ("float64[<=3] x\n", "cannot describe the type 'float64[<=3]'"),
        ("string<=10 x\n", "cannot describe the type 'string<=10'"),
    ],
)
def test_what_cannot_be_described_is_refused(schema: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        type_hash("pack/msg/One", schema)


def test_the_source_package_defines_the_message_that_is_sent() -> None:
    assert (PACKAGE / "msg" / "ContactModel.msg").read_text() == CONTACT_MODEL_MSG
    build = (PACKAGE / "CMakeLists.txt").read_text()
    manifest = (PACKAGE / "package.xml").read_text()
    package, kind = CONTACT_MODEL_TYPE.split("/msg/")
    assert f"project({package})" in build
    assert f'"msg/{kind}.msg"' in build
    assert f"<name>{package}</name>" in manifest
    for used in set(re.findall(r"^(\w+)/\w+", CONTACT_MODEL_MSG, re.MULTILINE)):
        assert f"<depend>{used}</depend>" in manifest
        assert f"find_package({used} REQUIRED)" in build
