"""`foretouch keys`, and what the sides say where nothing is checked."""

from __future__ import annotations

import json
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from typed_commands import good, run

from foretouch.cli.commands.sides import _leader_name
from foretouch.errors import ForetouchError, LinkError, SettingError
from foretouch.link import KeyFolder

pytest.importorskip("cryptography")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FORETOUCH_KEYS", str(tmp_path / "keys"))
    return tmp_path / "keys"


def shown() -> dict[str, dict[str, object]]:
    return json.loads(good("keys", "show", "--json").stdout)["certificates"]  # type: ignore[no-any-return]


def test_an_authority_and_three_roles(folder: Path) -> None:
    assert str(folder / "authority.key") in good("keys", "init").stdout
    for role in ("leader", "follower"):
        issued = good("keys", "issue", role)
        assert f"{role}.pem  until " in issued.stdout
        assert f"authority.crt, allowed.txt, {role}.pem" in issued.stderr
    good("keys", "issue", "watcher", "lab-2", "--days", 90)
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}
    certificates = shown()
    assert set(certificates) == {"authority.crt", "leader.pem", "follower.pem", "watcher.lab-2.pem"}
    assert certificates["watcher.lab-2.pem"]["common_name"] == "watcher.lab-2"
    assert certificates["watcher.lab-2.pem"]["days_left"] == pytest.approx(90, abs=0.1)
    text = good("keys", "show")
    assert "let in: leader, follower, watcher, watcher.lab-2" in text.stdout
    assert not text.stderr
    assert "PRIVATE" not in text.stdout + str(certificates)


def test_rotation_and_what_is_void_then(folder: Path, tmp_path: Path) -> None:
    good("keys", "init")
    assert "foretouch keys issue" in good("keys", "rotate").stderr
    good("keys", "issue", "leader")
    before = shown()
    good("keys", "rotate")
    between = shown()
    assert before["authority.crt"] == {**between["authority.crt"], "days_left": before["authority.crt"]["days_left"]}
    assert before["leader.pem"]["sha256"] != between["leader.pem"]["sha256"]
    old = (folder / "leader.pem").read_bytes()
    assert "let in nowhere" in good("keys", "rotate", "--authority").stderr
    assert shown()["authority.crt"]["sha256"] != between["authority.crt"]["sha256"]
    assert all(certificate["of_this_authority"] for certificate in shown().values())
    (folder / "leader.pem").write_bytes(old)
    assert "is from another authority" in good("keys", "show").stderr


def test_the_end_is_shown_and_warned_of(folder: Path) -> None:
    keys = KeyFolder(folder)
    keys.init(datetime.now(UTC))
    keys.issue("leader", "", datetime.now(UTC), days=20)
    keys.issue("follower", "", datetime.now(UTC) - timedelta(days=9), days=8)
    warned = good("keys", "show").stderr
    assert "leader.pem ends soon: foretouch keys rotate" in warned
    assert "follower.pem has expired: foretouch keys rotate" in warned


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("issue", "leader"), r"is no folder of keys .*: foretouch keys init makes one"),
        (("show",), r"is no folder of keys"),
        (("rotate",), r"is no folder of keys"),
        (("issue", "master"), r"is no folder of keys|write ROLE or ROLE.NAME"),
    ],
)
def test_without_an_authority_it_says_how_to_make_one(folder: Path, arguments: tuple[str, ...], message: str) -> None:
    raised = run("keys", *arguments).exception
    assert isinstance(raised, SettingError)
    with pytest.raises(SettingError, match=message):
        raise raised


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("init",), "not overwritten"),
        (("issue", "leader"), "not overwritten"),
        (("issue", "master"), "write ROLE or ROLE.NAME"),
        (("issue", "leader", "../x"), "write ROLE or ROLE.NAME"),
        (("issue", "follower", "--days", "0"), "days = 0.0: must be above 0"),
        (("issue", "follower", "--days", "nan"), "days = nan: must be above 0"),
        (("rotate", "follower"), "has no certificate in"),
    ],
)
def test_mistakes_end_in_one_line_and_change_nothing(folder: Path, arguments: tuple[str, ...], message: str) -> None:
    good("keys", "init")
    good("keys", "issue", "leader")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    raised = run("keys", *arguments).exception
    assert isinstance(raised, ForetouchError)
    assert message in str(raised)
    assert "\n" not in str(raised)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_a_side_asks_for_its_keys(folder: Path) -> None:
    follower = ("follower", "--listen", "tls/0.0.0.0:7447", "--duration", 1)
    assert "foretouch keys init" in str(run(*follower).exception)
    good("keys", "init")
    assert "no certificate for the follower: foretouch keys issue follower" in str(run(*follower).exception)
    watching = run("record", "s.mcap", "--connect", "tls/192.0.2.1:7447").exception
    assert "no certificate for the watcher" in str(watching)
    good("keys", "issue", "follower")
    (folder / "follower.pem").chmod(0o644)
    assert f"chmod 600 {folder / 'follower.pem'}" in str(run(*follower).exception)
    plain = run("follower", "--listen", "tcp/0.0.0.0:7447").exception
    assert isinstance(plain, LinkError)
    assert "tls/HOST:PORT" in str(plain)


@pytest.mark.long
@pytest.mark.live
def test_an_insecure_session_says_so_on_every_screen(tmp_path: Path) -> None:
    from foretouch.link import free_endpoint

    here, there = (free_endpoint().replace("127.0.0.1", "0.0.0.0") for _ in range(2))

    def start(*arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "foretouch", *arguments, "--insecure"]
        return subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    connect = ("--connect", here.replace("0.0.0.0", "127.0.0.1"), "--connect", there.replace("0.0.0.0", "127.0.0.1"))
    processes = {
        "follower": start("follower", "--listen", here, "--material", "hunt-crossley"),
        "recorder": start("record", "s.mcap", *connect),
        "leader": start("leader", *connect[:2], "--listen", there, "--duration", "1.5", "--wait-for-recorder"),
    }
    try:
        output = {name: process.communicate(timeout=60)[1] for name, process in processes.items()}
    finally:
        for process in processes.values():
            process.kill()
    assert "INSECURE: nothing is encrypted and nobody is checked" in output["leader"]
    assert "INSECURE: nothing is encrypted and nobody is checked" in output["follower"]
    assert "INSECURE" not in output["recorder"]  # its own endpoints are on this machine
    assert "INSECURE: nothing was encrypted and nobody was checked" in good("report", tmp_path / "s.mcap").stdout


def test_a_folder_that_was_open_to_others_is_said(folder: Path) -> None:
    folder.mkdir(mode=0o755)
    folder.chmod(0o755)
    assert f"{folder}: others could look into it; it has mode 700 now" in good("keys", "init").stderr
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_with_keys_a_leader_has_its_certificate_s_name() -> None:
    assert _leader_name("anna", "") == "anna"
    assert "@" in _leader_name(None, "")
    assert _leader_name(None, "leader.anna") == _leader_name("leader.anna", "leader.anna") == "leader.anna"
    with pytest.raises(SettingError, match="name = 'bob': cannot be given with keys"):
        _leader_name("bob", "leader.anna")
