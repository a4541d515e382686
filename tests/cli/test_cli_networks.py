"""`foretouch network`: what there is, what one is like, and sessions over it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typed_commands import good, output_of, refusal_of, run

from foretouch.cli.commands import networks
from foretouch.link import NETWORK_NAMES, PUBLISHED_NETWORKS, network_trace
from foretouch.report import network_row

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    """A file of round trips with one stall of 0.7 s."""
    path = tmp_path / "home.csv"
    late = (0.03 + max(3.0 - 0.05 * n, 0.0) * (n >= 46) for n in range(120))
    path.write_text("time_s,round_trip_s\n" + "\n".join(f"{0.05 * n:.2f},{one:.3f}" for n, one in enumerate(late)))
    return path


def test_the_list_names_all_and_whose_they_are(elsewhere: Path) -> None:
    rows = {row["name"]: row for row in output_of("network", "list")["networks"]}
    assert tuple(rows) == NETWORK_NAMES
    for name, row in rows.items():
        assert row["here"] == (name not in PUBLISHED_NETWORKS)
        assert row["source"]
        assert ("each_way_median_s" in row) == row["here"]
    assert "CC BY 4.0" in rows["5g-rural"]["licence"]
    text = good("network", "list").stdout
    assert "foretouch network show 5g-rural fetches it" in text
    assert "300 ms" in text


def test_the_measured_ones_are_as_they_were_measured(measured_network: Any) -> None:
    figures = output_of("network", "show", measured_network("5g-urban"))
    assert figures["measured_median_s"] == pytest.approx(0.018)
    assert figures["measured_max_s"] == pytest.approx(0.261)
    assert figures["rows"] == 4432
    rural = output_of("network", "show", measured_network("5g-rural"))
    assert rural["stalls_that_unload"] > 10
    assert rural["longest_stall_s"] > 20.0


@pytest.mark.parametrize("name", NETWORK_NAMES)
def test_the_documentation_shows_the_list_as_it_is(name: str, request: pytest.FixtureRequest) -> None:
    if name in PUBLISHED_NETWORKS:
        request.getfixturevalue("measured_network")(name)
    assert network_row(network_trace(name)) in (DOCS / "networks.md").read_text().splitlines()


def test_a_file_is_shown_and_drawn(trace: Path, tmp_path: Path) -> None:
    result = good("network", "show", trace, "--figure", tmp_path / "home.png")
    assert (tmp_path / "home.png").read_bytes().startswith(b"\x89PNG")
    assert "1 stall longer than 50 ms" in result.stdout
    assert "1 longer than 500 ms" in result.stdout
    assert "longest stall   7" in result.stdout
    assert "must end with .png" in refusal_of("network", "show", trace, "--figure", tmp_path / "home.svg")


def test_commands_refuse_what_is_no_network(tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("time_s,delay_ms\n0,20\n1,-3\n")
    for words in (["simulate"], ["teleop", "--headless"], ["sweep", "--out", tmp_path / "sweep"]):
        said = refusal_of(*words, "--network", bad)
        assert f"network = '{bad}': line 3: its delay of -0.003 s is negative" in said
        assert "unknown network '6g'" in refusal_of(*words, "--network", "6g")
    assert run("simulate", "--network", "6g").exit_code == 1  # of the runner: the command itself ends with 2
    assert not (tmp_path / "sweep").exists()


@pytest.mark.long
def test_a_session_over_a_file_is_simulated_and_replayed(trace: Path, tmp_path: Path) -> None:
    recording = tmp_path / "session.mcap"
    options = ["--network", trace, "--network-start", "2", "--duration", "3", "--recording", recording]
    content = output_of("simulate", *options)
    assert content["settings"]["network"] == str(trace)
    assert content["settings"]["position_delay"] == "0.0"
    assert content["stable"]
    again = output_of("replay", recording, "--network", "geostationary")
    assert again["replayed"]["settings"]["network"] == "geostationary"
    trace.unlink()
    assert "report" not in run("report", recording).output.partition("Session:")[0]
    assert "there is no such file" in refusal_of("replay", recording)


@pytest.mark.long
def test_a_sweep_runs_over_one(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    options = ["--sessions", "2", "--baselines", "0", "--duration", "2", "--jobs", "1", "--network", "low-orbit"]
    content = output_of("sweep", "--out", folder, *options)
    assert content["ours"]["sessions"] == 2
    assert not content["objections"]
    assert "low-orbit" in (folder / "sessions.jsonl").read_text().splitlines()[0]
    again = output_of("sweep", "--out", folder, "--replay", "1")
    assert again["identical"]
    assert "--network low-orbit --network-start" in again["command"]


@pytest.mark.parametrize(
    ("host", "insecure", "endpoint"),
    [
        ("127.0.0.1", False, "tcp/127.0.0.1:7447"),
        ("localhost:9000", False, "tcp/localhost:9000"),
        ("robot.example", False, "tls/robot.example:7447"),
        ("robot.example:9000", True, "tcp/robot.example:9000"),
        ("[fe80::1]", False, "tls/[fe80::1]:7447"),
        ("[fe80::1]:9000", True, "tcp/[fe80::1]:9000"),
        ("tls/robot.example:1", False, "tls/robot.example:1"),
    ],
)
def test_a_host_is_reached_with_keys_unless_it_is_this_machine(host: str, insecure: bool, endpoint: str) -> None:
    assert networks.endpoint_of(host, insecure=insecure) == endpoint


def test_measuring_refuses_before_it_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "must be 1 to 600" in refusal_of("network", "measure", "127.0.0.1", "--seconds", "0.5")
    assert "is not there" in refusal_of("network", "measure", "127.0.0.1", "--out", tmp_path / "no" / "home.csv")
    assert "keys" in refusal_of("network", "measure", "robot.example", "--keys", tmp_path / "none")
    assert "keys" in refusal_of("network", "answer", "0.0.0.0", "--keys", tmp_path / "none")
    assert list(tmp_path.iterdir()) == []
