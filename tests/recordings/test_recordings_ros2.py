"""What we write is ROS 2 to two implementations that are not ours."""

import math
from collections import defaultdict

import msgspec
import numpy as np
import pytest
import session_messages as made
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from foretouch.messages import VERSION, CameraImage, FixtureBelief, FollowerSpace, ModelUpdate, Telemetry
from foretouch.models import LAWS
from foretouch.recordings import SessionWriter, read_session
from foretouch.recordings.formats.topics import CONTACT_MODEL_MSG, CONTACT_MODEL_TYPE, TOPICS
from foretouch.recordings.session.writer import POSE_EVERY

MODEL = ModelUpdate(
    VERSION, 7, 1_234_567_890_123, 40, "continuous-switching", (4321.5, 0.1, 1.4, -1 / 3), (), 0.0123, True,
    "all is well: ä", "fprls", b"", standard_errors=(1.5, math.nan, 0.25, 5e-324),
)  # fmt: skip
UNKNOWN = msgspec.structs.replace(MODEL, sequence=8, law="law", valid=False, standard_errors=())
JPEG = bytes(range(256)) + b"\xff"
PLACES = FollowerSpace(0.1, -0.2, 1 / 3, *(0.0,) * 16)
PROBE = Telemetry(VERSION, 40, 5 * 10**9 + 6, 0, *(0.0,) * 6, False, False, 0, 0, 0, space=PLACES)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("ros2") / "session.mcap"
    with SessionWriter(path) as writer:
        for message, log_time_ns in made.session(30):
            writer.write(message, log_time_ns)
        writer.write(MODEL, 10**9)
        writer.write(UNKNOWN, 10**9 + 1)
        writer.write(PROBE, 10**9 + 2)
        writer.write(filled(FixtureBelief, pose=(1.0, 2.0, 3.0, 0.0, 0.0, math.pi / 2)), 10**9 + 3)
        writer.write(filled(CameraImage, jpeg=JPEG), 10**9 + 4)
    return path


def filled(kind, **fields):
    """A message of this kind with these fields, and nothing in the others."""
    nothing = {"int64": 0, "float64": 0.0, "bool": False, "string": "", "uint8[]": b""}
    types = dict(reversed(line.split()) for line in TOPICS[kind].layout.schema.splitlines())
    empty = {name: nothing.get(ros_type, ()) for name, ros_type in types.items()}
    return kind(**{**empty, "version": VERSION, "time_ns": 5 * 10**9 + 6, **fields})


def by_mcap_ros2(path):
    result = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            result[channel.topic].append(message)
    return result


def by_rosbags(path):
    result = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            result[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return result


READERS = pytest.mark.parametrize("read", [by_mcap_ros2, by_rosbags])


def bits(values):
    return np.asarray(list(values), dtype=np.float64).tobytes()


@READERS
def test_the_contact_model_carries_its_names_and_numbers(session, read):
    *_, known, unknown = read(session)["/follower/contact_model"]
    assert (known.law, list(known.names)) == (MODEL.law, list(LAWS[MODEL.law].parameter_names))
    assert bits(known.values) == bits(MODEL.parameters)
    assert bits(known.standard_errors) == bits(MODEL.standard_errors)
    assert bits([known.surface]) == bits([MODEL.surface])
    assert (known.valid, known.reason, known.sequence) == (True, MODEL.reason, MODEL.sequence)
    assert known.header.stamp.sec * 10**9 + known.header.stamp.nanosec == MODEL.time_ns
    assert (unknown.valid, list(unknown.names), list(unknown.standard_errors)) == (False, [], [])
    assert bits(unknown.values) == bits(UNKNOWN.parameters)


@READERS
def test_the_numbers_stand_in_an_array_of_a_standard_type(session, read):
    *_, known, _ = read(session)["/follower/contact_model/values"]
    assert bits(known.data) == bits(MODEL.parameters)
    (dimension,) = known.layout.dim
    assert (dimension.label, dimension.size, dimension.stride) == ("stiffness,damping,exponent,switching", 4, 4)
    assert known.layout.data_offset == 0


@READERS
def test_standard_types_carry_the_numbers_of_the_messages(session, read):
    result = read(session)
    told = [*(message for message, _ in made.session(30) if type(message) is Telemetry), PROBE]
    for joints, force, message in zip(result["/follower/joint_states"], result["/follower/wrench"], told, strict=True):
        assert bits([*joints.position, *joints.velocity, *joints.effort]) == bits(
            [message.position, message.velocity, message.force]
        )
        assert bits([force.wrench.force.z]) == bits([message.force])
        assert joints.header.stamp.sec * 10**9 + joints.header.stamp.nanosec == message.time_ns
    *along, probe = result["/follower/probe"]
    drawn = [message for message in told[:-1] if message.sequence % POSE_EVERY == 0]
    assert bits(pose.pose.position.z for pose in along) == bits(-message.position for message in drawn)
    assert all((pose.pose.orientation.w, pose.header.frame_id) == (1.0, "world") for pose in along)
    assert len(drawn) == 3
    assert bits([probe.pose.position.x, probe.pose.position.y, probe.pose.position.z]) == bits([0.1, -0.2, 1 / 3])
    (fixture,) = result["/camera/fixture/pose"]
    turn = fixture.pose.orientation
    np.testing.assert_allclose([turn.x, turn.y, turn.z, turn.w], [0, 0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-15)
    (image,) = result["/camera/image/compressed"]
    assert (image.format, bytes(image.data)) == ("jpeg", JPEG)


def test_the_definitions_are_those_of_ros_2(session):
    """Field by field as in ROS 2's own packages; of our own message, as its text says."""
    known = get_typestore(Stores.LATEST).fielddefs
    with AnyReader([session]) as reader:
        there = reader.typestore.fielddefs
        for connection in reader.connections:
            if not connection.msgtype.startswith("foretouch_msgs/"):
                assert there[connection.msgtype][1] == known[connection.msgtype][1], connection.msgtype
        names = [name for name, _ in there[CONTACT_MODEL_TYPE][1]]
    fields = [part.splitlines() for part in CONTACT_MODEL_MSG.split("\n\n")[1:]]
    assert names == [line.split()[1] for part in fields for line in part if not line.startswith("#")]
    assert all(part[0].startswith("# ") for part in fields)  # each says what it is; names and values together
    assert len(fields) == len(names) - 1


def test_a_recording_from_before_the_message_had_its_name_is_read(session, tmp_path):
    with session.open("rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    own = next(schema for schema in schemas if schema.name == "foretouch_msgs/msg/ModelUpdate")
    path = tmp_path / "former.mcap"
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        number = writer.register_schema("foretouch_msgs/msg/ContactModel", "ros2msg", own.data)
        channel = writer.register_channel("/follower/model", "cdr", number)
        writer.add_message(channel, 1, TOPICS[ModelUpdate].layout.pack(UNKNOWN), 1)
        writer.finish()
    assert read_session(path).models == (UNKNOWN,)
