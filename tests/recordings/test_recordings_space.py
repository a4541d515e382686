"""Recordings of sessions in three dimensions: what is written is read back, by us and by others."""

import io
from collections import defaultdict

import cv2
import msgspec
import numpy as np
import pytest
import session_messages as made
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation
from session_messages import bits

from foretouch.messages import (
    MOST_JOINTS,
    VERSION,
    CameraImage,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    LeaderSpace,
    SessionLog,
)
from foretouch.messages.states import FollowerRow, LeaderRow, in_space
from foretouch.models.scale_field import packed
from foretouch.recordings import SessionWriter, read_session, repair_session
from foretouch.recordings.formats.topics import TOPICS, quaternion
from foretouch.recordings.session.writer import POSE_EVERY

TICKS = 300
KINDS = (FollowerRow, LeaderRow, FieldUpdate, FixtureBelief, CameraImage)


def odd(tick, count):
    return [made.ODD[(tick + shift) % len(made.ODD)] for shift in range(count)]


def picture(tick):
    """A JPEG as a camera makes it; empty where the stream dropped it."""
    if tick % 90 == 0:
        return b""
    pixels = np.random.default_rng(tick).integers(0, 256, (24, 32, 3), np.uint8)
    return cv2.imencode(".jpg", pixels)[1].tobytes()


def session():
    """Messages of both sides and of the camera, with the times at which they were recorded [ns]."""
    nodes = packed([128, 129], [128, 130], [0.7, -0.2], [0.01, 0.04])
    for tick in range(1, TICKS + 1):
        now = tick * 1_000_000
        state, hand = made.leader_state(tick), LeaderSpace(*odd(tick, 28))
        yield msgspec.structs.replace(state, energy=made.ODD[tick % 8], epoch=2**53 + 1, space=hand), now
        probe = FollowerSpace(*odd(tick, 28), tick // 7, *odd(tick + 3, tick % (MOST_JOINTS + 1)))
        yield msgspec.structs.replace(made.telemetry(tick), run=2**62 + 1, space=probe), now
        if tick % 30 == 0:
            pose = (0.1 * np.sin(tick), -0.02, 0.3, 0.002 * tick, -1.1, 0.0)
            result = pose if tick % 60 else ()
            spread = tuple(odd(tick, 36)) if result else ()
            reason = "" if result else "no board: ü"
            yield (
                CameraImage(VERSION, tick // 30, now, tick, picture(tick), result, spread, 4, reason, (1.0,) * 15),
                now,
            )
            told = (*pose[:5], 0.0), (1e-8,) * 36, float("inf"), tick, 2, 1, "seen"
            yield FixtureBelief(VERSION, tick // 30, now, *told), now
            yield FieldUpdate(VERSION, tick // 30, now, nodes, 3), now


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "scene.mcap"
    with SessionWriter(file) as writer:
        for number, (message, now) in enumerate(session()):
            writer.write(message, now)
            if number % 100 == 0:
                writer.flush()
    return file


def of(kind):
    return [one for message, _ in session() for one in (message, *in_space(message)) if type(one) is kind]


def whole(messages):
    return [bits(msgspec.structs.astuple(message)) for message in messages]


def test_a_scene_reads_back_bit_by_bit(path):
    log, sent = read_session(path), SessionLog.from_messages(message for message, _ in session())
    for table in ("leader", "follower", "leader_space", "follower_space"):
        assert getattr(log, table).tobytes() == getattr(sent, table).tobytes()
    for kept, kind in ((log.fields, FieldUpdate), (log.images, CameraImage), (log.beliefs, FixtureBelief)):
        assert whole(kept) == whole(of(kind))
    assert log.follower.size == log.leader.size == log.follower_space.size == log.leader_space.size == TICKS


def test_a_file_that_was_cut_holds_what_was_flushed_and_is_mended(path):
    whole_file, log = path.read_bytes(), read_session(path)
    path.write_bytes(whole_file[: int(0.6 * len(whole_file))])
    cut = read_session(path)
    assert cut.counts == {"truncated": 1}
    assert 0.4 * TICKS < cut.follower_space.size < 0.7 * TICKS
    assert cut.follower_space.tobytes() == log.follower_space[: cut.follower_space.size].tobytes()
    assert whole(cut.images) == whole(log.images[: len(cut.images)])
    result = repair_session(path)
    mended = read_session(path)
    assert result.messages["/follower/space"] == mended.follower_space.size == cut.follower_space.size
    assert result.messages["/camera/image/compressed"] == sum(bool(image.jpeg) for image in mended.images)
    assert mended.leader_space.tobytes() == cut.leader_space.tobytes()
    assert whole(mended.beliefs) == whole(cut.beliefs)


def test_another_reader_gets_every_value_and_the_standard_types_say_the_same(path):
    reader = make_reader(io.BytesIO(path.read_bytes()), decoder_factories=[DecoderFactory()])
    read = defaultdict(list)
    for _, channel, _, message in reader.iter_decoded_messages(log_time_order=False):
        read[channel.topic].append(message)
    for kind in KINDS:
        names = kind.__struct_fields__
        got = [bits([getattr(one, name) for name in names]) for one in read[TOPICS[kind].name]]
        assert [tuple(values) for values in got] == whole(of(kind))
    for got, sent in zip(read["/follower/probe"], of(FollowerRow)[POSE_EVERY - 1 :: POSE_EVERY], strict=True):
        place = got.pose.position
        assert bits([place.x, place.y, place.z]) == bits([sent.place_x, sent.place_y, sent.place_z])
        assert got.header.stamp.sec * 10**9 + got.header.stamp.nanosec == sent.time_ns
        assert (got.header.frame_id, got.pose.orientation.w) == ("world", 1.0)
    for got, sent in zip(read["/camera/fixture/pose"], of(FixtureBelief), strict=True):
        turn = got.pose.orientation
        turned = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
        assert turned.as_rotvec() == pytest.approx(sent.pose[3:], abs=1e-12)
        assert got.pose.position.x == sent.pose[0]
    shown = [image for image in of(CameraImage) if image.jpeg]
    assert 0 < len(shown) < len(of(CameraImage))
    for got, sent in zip(read["/camera/image/compressed"], shown, strict=True):
        assert (got.format, got.header.frame_id) == ("jpeg", "camera")
        assert bytes(got.data) == sent.jpeg
        assert cv2.imdecode(np.frombuffer(bytes(got.data), np.uint8), cv2.IMREAD_COLOR).shape == (24, 32, 3)


def test_a_recording_from_before_there_were_joints_has_none(path, tmp_path):
    """Its schema has no such fields: they are cut out of each message here, as an older version wrote it."""
    topic = TOPICS[FollowerRow]
    joints = [name for name in FollowerRow.__struct_fields__ if name.startswith("joint_")]
    lines = topic.layout.schema.splitlines()
    older = topic.layout.of_schema("\n".join(line for line in lines if line.split()[-1] not in joints))
    assert len(joints) == MOST_JOINTS
    assert older is not None
    assert not set(joints) & set(older.dtype.names)
    assert all(np.isnan(older.missing[name]) for name in joints)


def test_a_session_along_a_line_has_nothing_of_a_scene(tmp_path):
    made.write_session(tmp_path / "line.mcap", 60)
    log = read_session(tmp_path / "line.mcap")
    assert (log.follower_space.size, log.leader_space.size) == (0, 0)
    assert (log.fields, log.images, log.beliefs) == ((), (), ())


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, -2.0, 1.1), (0.0, 3.14159, 0.0)])
def test_quaternions_are_those_of_another_implementation(turn):
    ours, theirs = np.array(quaternion(turn)), Rotation.from_rotvec(turn).as_quat()
    assert min(np.abs(ours - theirs).max(), np.abs(ours + theirs).max()) < 1e-14
