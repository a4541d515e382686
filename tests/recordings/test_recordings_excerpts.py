"""The excerpts of the measured recordings: what is in them, that they are their originals, and what is none."""

import importlib
import sys

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from foretouch.errors import RecordingError
from foretouch.identification import Learner, make_estimator
from foretouch.recordings import DATASETS, excerpt, inspect_recording, list_datasets, read_leader_motion, read_recording
from foretouch.recordings.formats.published import About, read_excerpt, write_excerpt
from foretouch.report import forces_under_delay, score_prediction

TUE = [name for name in DATASETS if name.startswith("tue/")]
AURORA = [name for name in DATASETS if name.startswith("aurora/")]
TOUCHED = [dataset for dataset in list_datasets() if dataset.kind in ("foam", "spring", "rigid")]
ABOUT = About("a/b", "https://example.org/b.mat", "0" * 64, "MIT", 0.3, {"time": 1e6, "position": 4e5, "force": 1e3})


# --- what is in them --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DATASETS)
def test_every_recording_is_here_whole(name):
    recording = read_recording(excerpt(name))
    assert len(recording) > 4000
    np.testing.assert_allclose(np.diff(recording.time), 5e-4, rtol=1e-6)
    assert recording.contact_floor == (0.3 if name in TUE else 0.005)
    assert recording.velocity is None
    about = read_excerpt(excerpt(name)).about
    dataset = DATASETS[name]
    assert (about.name, about.original, about.sha256) == (name, dataset.url, dataset.sha256)
    assert about.licence == dataset.origin.licence


@pytest.mark.parametrize("folder", sorted({excerpt(name).parent for name in DATASETS}))
def test_licence_and_origin_lie_beside_them(folder):
    inside = [dataset for dataset in DATASETS.values() if excerpt(dataset.name).parent == folder]
    licence, origin = ((folder / file).read_text(encoding="utf-8") for file in ("LICENSE", "ORIGIN.md"))
    for dataset in inside:
        kind, holder = dataset.origin.licence.split(", ")
        assert licence.startswith(f"{kind} License")
        assert holder in licence
        assert excerpt(dataset.name).name in origin
        assert dataset.url in origin
        assert dataset.sha256 in origin
    assert {path.name for path in folder.iterdir()} == {
        "LICENSE",
        "ORIGIN.md",
        *(excerpt(dataset.name).name for dataset in inside),
    }


def test_all_of_them_are_small():
    folders = {excerpt(name).parent for name in DATASETS}
    assert sum(path.stat().st_size for folder in folders for path in folder.iterdir()) < 900_000


@pytest.mark.parametrize("dataset", TOUCHED, ids=lambda dataset: dataset.name)
@pytest.mark.parametrize("channel", ["raw", "logged"])
def test_pressing_gives_more_force_at_more_depth(dataset, channel):
    recording = read_recording(excerpt(dataset.name), force_channel=channel)
    order = np.argsort(recording.position)
    tenth = len(recording) // 10
    shallow, deep = (recording.force[part].mean() for part in (order[:tenth], order[-tenth:]))
    assert deep > shallow + 0.7


@pytest.mark.parametrize("name", AURORA)
def test_skin_is_pressed_with_the_force_that_was_asked_for(name):
    recording = read_recording(excerpt(name))
    target = float(name.removeprefix("aurora/").removesuffix("-mN")) / 1000
    held = (recording.time > 1.05) & (recording.time < 1.15)
    assert abs(recording.force[held].mean() - target) < 0.1 * target + 0.01
    assert recording.position[held].mean() > recording.position[1000:1100].mean() + 1e-4  # deeper while it presses


def test_raw_and_logged_force_differ_by_offset_and_lag():
    raw, logged = (read_recording(excerpt("tue/a-foam"), force_channel=channel) for channel in ("raw", "logged"))
    assert raw.position.tobytes() == logged.position.tobytes()
    offset = raw.force - logged.force
    assert 7.0 < np.median(offset) < 8.5
    assert np.corrcoef(raw.force, logged.force)[0, 1] > 0.99


@pytest.mark.parametrize("name", TUE)
def test_leader_motion_is_a_hand_near_its_follower(name):
    time, position = read_leader_motion(excerpt(name))
    follower = read_recording(excerpt(name))
    assert time[0] == 0.0
    assert time.shape == position.shape == follower.position.shape
    assert np.corrcoef(position, follower.position)[0, 1] > 0.94
    assert np.ptp(position) > 0.003


def test_an_excerpt_states_what_it_holds():
    path = excerpt("tue/b-foam")
    straight, flipped = read_recording(path), read_recording(path, flip=True)
    assert (straight.position == -flipped.position).all()
    assert (straight.force == flipped.force).all()
    result = inspect_recording(path)
    assert result.stated.startswith("an excerpt of tue/b-foam, which needs no map")
    columns = {"time": "s", "position": "m", "force": "N", "logged_force": "N", "leader_position": "m"}
    assert {column.name: column.unit for column in result.columns} == columns
    assert result.rate == pytest.approx(2000.0)
    assert DATASETS["tue/b-foam"].sha256 in result.notes[0]
    with pytest.raises(RecordingError, match="states its own units: leave --position-unit"):
        read_recording(path, position_unit="mm")
    with pytest.raises(RecordingError, match="aurora/400-mN has one force alone: leave --force-channel out"):
        read_recording(excerpt("aurora/400-mN"), force_channel="logged")
    with pytest.raises(RecordingError, match="aurora/400-mN has no motion of a leader: take one of tue/"):
        read_leader_motion(excerpt("aurora/400-mN"))


def test_it_has_no_columns_to_map(tmp_path):
    map_file = tmp_path / "map.toml"
    map_file.write_text('[position]\ncolumn = "position"\nunit = "m"\n[force]\ncolumn = "force"\nunit = "N"\n')
    with pytest.raises(RecordingError, match="an excerpt of a measured recording has no columns to map"):
        read_recording(excerpt("tue/b-foam"), map_file=map_file)


# --- against the originals --------------------------------------------------------------------------------------------


@pytest.mark.data
@pytest.mark.parametrize("name", DATASETS)
def test_an_excerpt_is_its_original(original, name):
    """Bit by bit; but the filtered force is rounded to half a millinewton."""
    paths = excerpt(name), original(name)
    kept, whole = (read_recording(path) for path in paths)
    for column, same in kept.columns().items():
        np.testing.assert_array_equal(same, whole.columns()[column])
    assert kept.contact_floor == whole.contact_floor
    if name in TUE:
        np.testing.assert_array_equal(*(read_leader_motion(path) for path in paths))
        logged = [read_recording(path, force_channel="logged").force for path in paths]
        np.testing.assert_allclose(*logged, rtol=0.0, atol=0.26e-3)


FIRST = ("tue/b-foam", "aurora/400-mN")


@pytest.mark.data
@pytest.mark.parametrize(
    "name", [*FIRST, *(pytest.param(name, marks=pytest.mark.long) for name in DATASETS if name not in FIRST)]
)
def test_excerpt_and_original_give_the_same_figures(original, name):
    """Of the prediction as `foretouch predict` scores it, in points: percent of the force, or of the time."""
    delay, window = (0.3, {"score_from": 1.5}) if name in TUE else (0.02, {"score_from": 0.5, "score_to": 1.6})

    def figures(path):
        recording = read_recording(path)
        learner = Learner(make_estimator("contact-map", "bank"), contact_floor=recording.contact_floor)
        result = forces_under_delay(recording, learner, delay)
        scores = score_prediction(
            result.time, result.measured, result.predicted, result.delayed, contact_floor=result.contact_floor,
            position=result.position, skipped=result.skipped, **window,
        )  # fmt: skip
        return scores.status, scores.prediction_error_percent, scores.delayed_force_error_percent

    (status, *kept), (other, *whole) = figures(excerpt(name)), figures(original(name))
    assert status == other
    assert (kept == whole == [None, None]) if status == "no_contact" else kept == pytest.approx(whole, abs=0.1)


@pytest.mark.long
@pytest.mark.data
def test_the_tool_makes_them_again(original, monkeypatch):
    for name in DATASETS:
        original(name)
    monkeypatch.syspath_prepend(excerpt("tue/b-foam").parents[5] / "docs")
    tool = importlib.import_module("make_excerpts")
    monkeypatch.delitem(sys.modules, "make_excerpts")
    assert [name for name, dataset in DATASETS.items() if not tool.is_right(dataset)] == []
    assert tool.origin_page(excerpt("tue/b-foam").parent) == excerpt("tue/b-foam").with_name("ORIGIN.md").read_text()
    with pytest.raises(ValueError, match=r"tue/b-foam: force is 0\.\d+ counts away from a whole number"):
        tool.require_counts(DATASETS["tue/b-foam"], {"force": np.array([0.00123])}, {"force": 1000.0})


# --- the files --------------------------------------------------------------------------------------------------------


COUNTS = arrays(np.int64, st.tuples(st.just(3), st.integers(2, 30)), elements=st.integers(-(2**40), 2**40))


@given(COUNTS)
def test_what_was_counted_comes_back_bit_by_bit(tmp_path_factory, counts):
    """However the numbers were rounded: here as products, not as the quotients of the reader."""
    path = tmp_path_factory.mktemp("made") / "made.npz"
    units = ABOUT.counts_per_unit
    columns = {name: counts[row] * (1.0 / units[name]) for row, name in enumerate(units)}
    write_excerpt(path, ABOUT, columns)
    about, result = read_excerpt(path)
    assert about == ABOUT
    for name, column in columns.items():
        np.testing.assert_array_equal(result[name], column)


@given(arrays(np.float64, 20, elements=st.floats(-5.0, 5.0)))
def test_what_was_not_counted_comes_back_to_half_a_count(tmp_path_factory, column):
    path = tmp_path_factory.mktemp("made") / "made.npz"
    time = np.arange(20) * 5e-4
    write_excerpt(path, ABOUT, {"time": time, "position": time, "force": column})
    np.testing.assert_allclose(read_excerpt(path).columns["force"], column, rtol=0.0, atol=0.5001e-3)


def saved(path, about, **columns):
    np.savez_compressed(path, about=np.array(about), **columns)


def told(**changed):
    return msgspec.json.encode(msgspec.structs.replace(ABOUT, **changed)).decode()


STEPS = {name: np.ones(10, np.int16) for name in ABOUT.counts_per_unit}


@pytest.mark.parametrize(
    ("about", "columns"),
    [
        (told(), {}),
        (told(), STEPS | {"force": np.ones(10)}),
        (told(), STEPS | {"force": np.ones((2, 5), np.int16)}),
        (told(), STEPS | {"force": np.array([{"a": 1}], dtype=object)}),
        (told(counts_per_unit=ABOUT.counts_per_unit | {"force": 0.0}), STEPS),
        (told(counts_per_unit={"time": 1e6}), STEPS),
        (told(), STEPS | {"force_last": np.ones(9, np.int8)}),
        (told(), STEPS | {"force_last": np.ones(10)}),
        ("{}", STEPS),
        ('{"name": "an unknown key"}', STEPS),
    ],
)
def test_another_npz_is_refused_in_one_line(tmp_path, about, columns):
    path = tmp_path / "other.npz"
    saved(path, about, **columns)
    for read in (read_recording, read_leader_motion, inspect_recording):
        with pytest.raises(RecordingError, match=r"other\.npz: is no excerpt of a measured recording") as caught:
            read(path)
        assert "\n" not in str(caught.value)


def test_columns_of_unequal_length_are_refused(tmp_path):
    saved(tmp_path / "other.npz", told(), **(STEPS | {"force": np.ones(9, np.int16)}))
    with pytest.raises(RecordingError, match="force has shape"):
        read_recording(tmp_path / "other.npz")


def test_a_cut_one_is_refused_in_one_line(tmp_path):
    content = excerpt("tue/b-foam").read_bytes()
    path = tmp_path / "cut.npz"
    for length in (0, 100, 5000, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        with pytest.raises(RecordingError, match=r"cut\.npz: is no excerpt"):
            read_recording(path)
