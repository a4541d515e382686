"""Measured networks: what files are taken and refused, and what a trace does to messages."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import DatasetError, SettingError, UnknownNameError
from foretouch.files import origins
from foretouch.link import NETWORK_NAMES, PUBLISHED_NETWORKS, Faults, FaultStage, NetworkTrace, network_trace
from foretouch.link.networks.named import CICV5G
from foretouch.link.networks.trace import Way

MS = 1_000_000
PUBLIC_HEAD = "pub_time(ms) sub_time(ms) delay(ms) utmX(m) sinr(db)"


def written(folder: Path, text: str | bytes, name: str = "trace.csv") -> str:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def a_trace(time: list[float], delay: list[float], **more: Any) -> NetworkTrace:
    return NetworkTrace("trace", np.array(time), np.array(delay), **{"one_way": True, **more})


def sent_over(way: Way, ticks: int) -> list[int]:
    """Arrivals of one message a millisecond [ms]."""
    return [round(way.arrival_ns(tick * MS) / MS) for tick in range(ticks)]


@pytest.mark.parametrize(
    "text",
    [
        "time_s,round_trip_ms\n0,20\n0.5,40\n1.0,20\n",
        "round_trip_ms;time_ms\n20;1700000000000\n40;1700000000500\n20;1700000001000\n",
        "\ufeffTime [s]\tRTT [ms]\n0\t20\n\n0.5\t40\n1\t20\n",
        "# of a Tuesday\nt (us) delay (us)\n0 20000\n500000 40000\n1000000 20000\n",
        "0,0.02\n0.5,0.04\n1,0.02\n",
        "time_s,one_way_delay_ms\n0,10\n0.5,20\n1,10\n",
        f"{PUBLIC_HEAD}\n1000 1020 20 3.5 24\n1500 1540 40 3.5 24\n2000 2020 20 3.5 24 \n",
    ],
)
def test_columns_are_found_by_their_names_and_units(text: str, tmp_path: Path) -> None:
    trace = network_trace(written(tmp_path, text))
    np.testing.assert_allclose(trace.time, [0.0, 0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(trace.delay, [0.01, 0.02, 0.01], atol=1e-9)
    assert trace.length == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("time_s,delay_ms\n", "has no rows"),
        ("time_s,delay_ms\n0,20\n", "has one row"),
        (b"\x00\x01\x02" * 50, "is no text"),
        (b"\xff\xfe\xff" * 50, "is no text"),
        ("time_s,delay\n0,20\n1,20\n", "line 1: column 'delay' has no unit"),
        ("when_s,delay_s\n0,20\n1,20\n", "line 1: has no column that says when"),
        ("time_s,size_s\n0,20\n1,20\n", "line 1: has no column that says how long"),
        ("0,1,0.02\n1,2,0.02\n", "line 1: has 3 columns without names"),
        ("time_s,delay_ms\n0,20\n0.1\n", "line 3: has 1 columns"),
        ("time_s,delay_ms\n0,20\n0.1,x\n", "line 3: its delay 'x' is no finite number"),
        ("time_s,delay_ms\n0,20\nnan,20\n", "line 3: its time 'nan' is no finite number"),
        ("time_s,delay_ms\n0,20\n0.1,inf\n", "line 3: its delay 'inf'"),
        ("time_s,delay_ms\n0,20\n0.1,-1\n", "line 3: its delay of -0.001 s is negative"),
        ("time_s,delay_s\n0,20\n0.1,18000\n", "line 3: its delay of 18000 s is longer than 60 s: name the unit"),
        ("time_s,delay_ms\n1,20\n0.5,20\n", "line 3: its time is 0.5 s before the row above"),
        ("time_s,delay_ms\n0,20\n0,20\n", "line 3: its time is that of the first row"),
        ("time_s,delay_ms\n0,20\n0.1,20\n0.2,20\n1.3,20\n", "line 5: no message was sent for 1.1 s before it"),
    ],
)
def test_bad_files_are_refused_in_one_line(text: str | bytes, said: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(SettingError, match=re.escape(said)) as refused:
        FaultStage(Faults(network=path))
    assert "\n" not in str(refused.value)
    assert path in str(refused.value)


def test_rare_messages_have_longer_gaps(tmp_path: Path) -> None:
    rows = "".join(f"{2 * n},20\n" for n in range(9))
    assert network_trace(written(tmp_path, f"time_s,rtt_ms\n{rows}25,20\n")).time.size == 10
    with pytest.raises(SettingError, match="for 14 s before it, and 10 s are allowed"):
        network_trace(written(tmp_path, f"time_s,rtt_ms\n{rows}30,20\n", "rare.csv"))


def test_what_is_no_file_and_no_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match="there is no such file"):
        network_trace(str(tmp_path / "nowhere.csv"))
    with pytest.raises(SettingError, match="is no file"):
        network_trace(str(tmp_path))
    with pytest.raises(UnknownNameError, match="unknown network '6g': choose one of 5g-arterial"):
        network_trace("6g")
    with pytest.raises(SettingError, match="network_start"):
        Faults(network_start=-1.0)


def test_a_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path, "0,0.02\n1,0.02\n")
    assert network_trace(path).measured[0] == 0.02
    written(tmp_path, "0,0.0400\n1,0.0400\n")
    assert network_trace(path).measured[0] == 0.04


def test_a_stall_holds_then_lets_all_come_at_once() -> None:
    time = [0.0, 0.05, 0.1, 0.15, 0.2, 0.25]
    trace = a_trace(time, [0.02, 0.02, 0.1, 0.05, 0.02, 0.02])
    arrivals = sent_over(Way(trace), 200)
    assert arrivals[:50] == [tick + 20 for tick in range(50)]
    assert set(arrivals[51:150]) == {200}  # held from the last row that was not, until the first that was comes
    assert trace.longest_stall == pytest.approx(0.13, abs=0.002)


def test_a_round_trip_is_halved_but_not_its_stall() -> None:
    """What is sent before the end of a stall waits for it, in either direction; its answer does not wait again."""
    time = np.arange(0.0, 3.0, 0.05)
    round_trip = 0.04 + np.maximum(2.0 - time, 0.0) * (time >= 1.0)
    trace = NetworkTrace("stalls", time, round_trip)
    np.testing.assert_allclose(trace.delay[time < 1.0], 0.02)
    assert trace.longest_stall == pytest.approx(1.05, abs=0.01)
    there = trace.arrivals(time)
    stream = np.arange(0.0, 3.0, 1e-3)
    back = np.interp(there, stream, trace.arrivals(stream)) - time
    # The stall begins behind the last row before it: the answer to that row is caught, which was not.
    assert np.flatnonzero(abs(back - round_trip)[:-2] > 0.06).tolist() == [19]


def test_it_begins_again_and_where_it_is_told() -> None:
    trace = a_trace([0.0, 0.1, 0.2], [0.01, 0.03, 0.02])
    assert trace.length == pytest.approx(0.3)
    once = sent_over(Way(trace), 900)
    assert once[300] == once[299] == 319  # nothing overtakes the last one, which was later
    assert once[320:600] == [arrival + 300 for arrival in once[20:300]]
    later = sent_over(Way(trace, start=100.1), 100)  # 100.1 s are 333 lengths, and 0.2 s
    assert later == [arrival - 200 for arrival in once[200:300]]


def test_a_thin_network_takes_the_messages_of_each_kind_it_has_time_for() -> None:
    stage: FaultStage[Any] = FaultStage(Faults(network="subsea-acoustic"))
    for tick in range(1000):
        stage.push(tick * MS, tick)
        stage.push(tick * MS, str(tick))
    arrived = stage.pop_due(2000 * MS)
    assert [one for one in arrived if isinstance(one, int)] == list(range(0, 1000, 40))
    assert [int(one) for one in arrived if isinstance(one, str)] == list(range(0, 1000, 40))
    assert stage.dropped == 2000 - len(arrived)


def traces() -> st.SearchStrategy[NetworkTrace]:
    """Any trace: rows up to 200 ms apart, some at once, delays to 2 s, of either kind."""
    row = st.tuples(st.floats(0.0, 0.2), st.floats(0.0, 2.0))

    def made(rows: list[tuple[float, float]], one_way: bool) -> NetworkTrace:
        between, delay = zip(*rows, strict=True)
        time = np.concatenate(([0.0], np.cumsum(between)[:-1] + 1e-3))
        return NetworkTrace("any", time, np.array(delay), one_way=one_way)

    return st.builds(made, st.lists(row, min_size=2, max_size=30), st.booleans())


@given(traces(), st.floats(0.0, 20.0))
def test_nothing_overtakes_and_nothing_comes_before_it_is_sent(trace: NetworkTrace, start: float) -> None:
    arrivals = [Way.arrival_ns(way, tick * MS) for way in [Way(trace, start)] for tick in range(400)]
    assert all(before <= after for before, after in pairwise(arrivals))
    assert all(arrival >= tick * MS for tick, arrival in enumerate(arrivals))
    assert max(arrivals) <= (400 + 1e3 * (trace.delay.max() + trace.length)) * MS
    assert (trace.delay >= 0.5 * trace.measured - 1e-9).all()


@settings(max_examples=30)
@given(
    st.sampled_from(["low-orbit", "geostationary"]),
    st.integers(0, 99),
    st.floats(0.0, 0.5),
    st.floats(0.0, 0.05),
    st.floats(0.0, 300.0),
)
def test_other_faults_are_added_and_repeat(name: str, seed: int, loss: float, delay: float, start: float) -> None:
    faults = Faults(delay=delay, loss=loss, network=name, network_start=start, seed=seed)

    def arrived() -> tuple[list[tuple[int, int]], int]:
        stage: FaultStage[int] = FaultStage(faults)
        result = []
        for tick in range(1500):
            if tick < 300:
                stage.push(tick * MS, tick)
            result += [(tick, message) for message in stage.pop_due(tick * MS)]
        return result, stage.dropped

    first, dropped = arrived()
    assert (first, dropped) == arrived()
    assert len(first) + dropped == 300
    assert [message for _, message in first] == sorted(message for _, message in first)  # delay and loss alone
    least = 1e3 * (delay + network_trace(name).delay.min())
    assert all(tick - message >= least - 1e-6 for tick, message in first)


def test_faults_change_on_the_way_and_the_network_stays(tmp_path: Path) -> None:
    path = written(tmp_path, "time_s,one_way_ms\n0,50\n1,50\n")
    stage: FaultStage[int] = FaultStage(Faults(network=path))
    Path(path).unlink()  # it was read, and nothing is raised on the way
    stage.push(0, 1)
    stage.change(delay=0.1, jitter=0.0, loss=0.0, outage=0.0)
    stage.push(0, 2)
    assert stage.pop_due(50 * MS) == [1]
    assert stage.pop_due(149 * MS) == []
    assert stage.pop_due(150 * MS) == [2]


@pytest.mark.parametrize("name", NETWORK_NAMES)
def test_each_named_network_is_one(name: str, request: pytest.FixtureRequest) -> None:
    if name in PUBLISHED_NETWORKS:
        request.getfixturevalue("measured_network")(name)
    trace = network_trace(name)
    assert trace.name == name
    assert trace.source
    assert trace.length > 50.0
    assert (np.diff(trace.time) >= 0.0).all()
    assert bool(trace.licence) == (name in PUBLISHED_NETWORKS)
    arrivals = sent_over(Way(trace), 60_000)
    assert all(before <= after for before, after in pairwise(arrivals))


@pytest.mark.parametrize("name", PUBLISHED_NETWORKS)
def test_the_silence_of_a_measured_network_is_kept(name: str, measured_network: Any) -> None:
    """Halved with the rest, a stall would be half as long as it was measured."""
    trace = network_trace(measured_network(name))
    measured = float(np.diff(np.maximum.accumulate(trace.time + trace.measured)).max())
    assert 0.75 * measured < trace.longest_stall < 1.15 * measured


def test_what_was_published_is_fetched_once_and_checked(www: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"{PUBLIC_HEAD}\n1000 1020 20 3 24\n1500 1540 40 3 24\n9000 9020 20 3 24\n".encode()
    one = replace(PUBLISHED_NETWORKS["5g-urban-public"], last_line=3)
    folder = www / CICV5G.repository / CICV5G.commit / CICV5G.folder / one.folder
    folder.mkdir(parents=True)
    (folder / "v2v_info-01.txt").write_bytes(text)
    assert not one.here
    with pytest.raises(DatasetError, match="another SHA-256"):
        one.fetch("5g-urban-public")
    one = replace(one, sha256=hashlib.sha256(text).hexdigest())
    trace = one.fetch("5g-urban-public")
    assert trace.time.tolist() == [0.0, 0.5]
    assert trace.licence.startswith("CC BY 4.0")
    assert one.here
    monkeypatch.setattr(origins, "HOST", "http://127.0.0.1:9")
    assert one.fetch("5g-urban-public").time.size == 2


def test_without_file_and_origin_it_says_what_to_do(elsewhere: Path) -> None:
    with pytest.raises(DatasetError, match=r"network 5g-rural is not here .* folder that has networks/"):
        PUBLISHED_NETWORKS["5g-rural"].fetch("5g-rural")


def test_concatenated_runs_are_refused_at_their_seam(measured_network: Any, tmp_path: Path) -> None:
    """The repository's files all.txt hold several runs, one behind the other."""
    measured_network("5g-arterial-public")
    path = origins.in_data_dir("networks/arterial_n78_v80_run01.txt")
    if path is None:
        pytest.skip("its file is in the cache, under another name")
    lines = path.read_text().splitlines()
    first, second = [lines[0], *lines[100:]], lines[1:100]
    for rows, said in (([*first, *second], "before the row above"), ([*lines[:60], *lines[100:]], "for 2.")):
        with pytest.raises(SettingError, match=said):
            network_trace(written(tmp_path, "\n".join(rows), f"{len(rows)}.txt"))
