"""A private authority and its certificates: whole or not at all, private, and only for whom they were made."""

from __future__ import annotations

import contextlib
import os
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from foretouch.errors import SettingError
from foretouch.link import CERTIFICATE_DAYS, ROLES, KeyFolder, default_key_folder, load_credentials
from foretouch.link.key_folder import role_of

pytest.importorskip("cryptography")
NOW = datetime(2030, 5, 1, tzinfo=UTC)


@pytest.fixture
def keys(tmp_path: Path) -> KeyFolder:
    folder = KeyFolder(tmp_path / "keys")
    folder.init(NOW)
    return folder


def content(keys: KeyFolder) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in keys.path.iterdir() if path.is_file()}


def test_a_new_authority_lets_in_the_three_roles_and_nobody_else_may_read(keys: KeyFolder) -> None:
    keys.issue("follower", "", NOW)
    assert set(content(keys)) == {"authority.key", "authority.crt", "allowed.txt", "follower.pem"}
    assert stat.S_IMODE(keys.path.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in keys.path.iterdir()} == {0o600}
    assert b"PRIVATE" not in content(keys)["authority.crt"]
    assert load_credentials("follower", keys.path, now=NOW).allowed == ROLES


def test_a_certificate_is_of_the_authority_and_ends_when_asked(keys: KeyFolder) -> None:
    made = keys.issue("leader", "alice", NOW, days=90)
    credentials = load_credentials("leader", keys.path, now=NOW)
    assert credentials.identity == made
    assert made.common_name == "leader.alice"
    assert made.days_left(NOW) == pytest.approx(90)
    assert made.issued_by(credentials.authority)
    assert credentials.allowed == (*ROLES, "leader.alice")
    stranger = KeyFolder(keys.path.parent / "other")
    assert not made.issued_by(stranger.init(NOW))


def test_no_certificate_outlasts_its_authority(keys: KeyFolder) -> None:
    late = NOW + timedelta(days=3600)
    assert keys.issue("leader", "", late).days_left(late) == pytest.approx(50)
    with pytest.raises(SettingError, match=r"has expired: foretouch keys rotate --authority"):
        keys.issue("watcher", "", NOW + timedelta(days=3651))
    keys.rotate(None, NOW + timedelta(days=3651), authority=True)
    load_credentials("leader", keys.path, now=NOW + timedelta(days=3651))


def test_nothing_is_overwritten(keys: KeyFolder) -> None:
    keys.issue("leader", "", NOW)
    before = content(keys)
    with pytest.raises(SettingError, match=r"authority.key.* not overwritten: foretouch keys rotate --authority"):
        keys.init(NOW)
    with pytest.raises(SettingError, match=r"leader.pem.* not overwritten: foretouch keys rotate leader"):
        keys.issue("leader", "", NOW)
    assert content(keys) == before


@pytest.mark.parametrize("name", ["leader.pem", "authority.key"])
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_key_that_others_may_read_is_refused_with_what_mends_it(keys: KeyFolder, name: str, mode: int) -> None:
    keys.issue("leader", "", NOW)
    (keys.path / name).chmod(mode)
    with pytest.raises(SettingError, match=f"by others than its owner: chmod 600 {keys.path / name}$"):
        keys.rotate(None, NOW) if name == "authority.key" else load_credentials("leader", keys.path, now=NOW)
    os.system(f"chmod 600 {keys.path / name}")
    keys.rotate(None, NOW)
    load_credentials("leader", keys.path, now=NOW)


@pytest.mark.parametrize("name", ["authority.crt", "allowed.txt"])
def test_what_is_public_may_be_read_but_not_written_by_others(keys: KeyFolder, name: str) -> None:
    keys.issue("leader", "", NOW)
    (keys.path / name).chmod(0o644)
    load_credentials("leader", keys.path, now=NOW)
    (keys.path / name).chmod(0o664)
    with pytest.raises(SettingError, match=r"can be written by others .*chmod 600"):
        load_credentials("leader", keys.path, now=NOW)


def test_a_folder_that_others_may_look_into_is_tightened_when_keys_are_made(tmp_path: Path) -> None:
    for mode, tightened in ((0o755, True), (0o750, True), (0o711, True), (0o700, False)):
        keys = KeyFolder(tmp_path / f"{mode:o}")
        keys.path.mkdir()
        keys.path.chmod(mode)
        keys.init(NOW)
        assert stat.S_IMODE(keys.path.stat().st_mode) == 0o700
        assert keys.tightened is tightened
    others = KeyFolder(tmp_path / "others")
    others.path.mkdir()
    others.path.chmod(0o777)
    with pytest.raises(SettingError, match="can be written by others: chmod 700"):
        others.init(NOW)
    assert stat.S_IMODE(others.path.stat().st_mode) == 0o777


def test_the_end_is_warned_of_thirty_days_before_and_then_refused(keys: KeyFolder) -> None:
    end = keys.issue("leader", "", NOW).expires

    def on(days: float) -> str:
        return load_credentials("leader", keys.path, now=end - timedelta(days=days)).warning

    assert end == NOW + timedelta(days=CERTIFICATE_DAYS)
    assert on(31) == ""
    assert on(29) == f"the certificate of leader ends in 29 days, on {end:%Y-%m-%d}: foretouch keys rotate"
    with pytest.raises(SettingError, match=r"leader.*expired on 2031-05-01: foretouch keys rotate leader, and copy"):
        on(-1)


def test_rotation_makes_new_certificates_of_the_same_authority(keys: KeyFolder) -> None:
    for role in ROLES:
        keys.issue(role, "", NOW)
    before = content(keys)
    later = NOW + timedelta(days=300)
    made = keys.rotate(None, later)
    after = content(keys)
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {f"{role}.pem" for role in ROLES}
    assert all(identity.days_left(later) == pytest.approx(CERTIFICATE_DAYS) for identity in made)
    keys.rotate("leader", later)
    assert {name for name in after if after[name] != content(keys)[name]} == {"leader.pem"}
    with pytest.raises(SettingError, match=r"'leader.bob': has no certificate in .*, which has follower, leader, w"):
        keys.rotate("leader.bob", later)
    with pytest.raises(SettingError, match="with a new authority all"):
        keys.rotate("leader", later, authority=True)


def test_with_a_new_authority_old_certificates_are_nobody_s(keys: KeyFolder) -> None:
    old = keys.issue("leader", "", NOW)
    (new,) = keys.rotate(None, NOW, authority=True)
    credentials = load_credentials("leader", keys.path, now=NOW)
    assert credentials.identity == new
    assert not old.issued_by(credentials.authority)
    (keys.path / "leader.pem").write_bytes(old.pem)
    with pytest.raises(SettingError, match=r"leader.pem.* is from another authority than .*authority.crt"):
        load_credentials("leader", keys.path, now=NOW)


class Crash(BaseException):
    """A process that ends here."""


@pytest.mark.parametrize("call", ["open", "fsync", "rename", "replace", "rmdir"])
@pytest.mark.parametrize("moment", [1, 2, 4, 7])
def test_a_rotation_that_crashes_anywhere_leaves_the_old_or_the_new(
    keys: KeyFolder, monkeypatch: pytest.MonkeyPatch, call: str, moment: int
) -> None:
    for role in ROLES:
        keys.issue(role, "", NOW)
    old = content(keys)
    owner = Path if call in ("rename", "replace", "rmdir") else os
    real, count = getattr(owner, call), 0

    def crash(*arguments: object, **named: object) -> object:
        nonlocal count
        count += 1
        if count == moment:
            raise Crash
        return real(*arguments, **named)

    with monkeypatch.context() as patched:
        patched.setattr(owner, call, crash)
        with contextlib.suppress(Crash):
            keys.rotate(None, NOW, authority=True)
    loaded = [load_credentials(role, keys.path, now=NOW) for role in ROLES]  # belong together, or this raises
    after = content(keys)
    assert not [path for path in keys.path.iterdir() if path.is_dir()]
    assert set(after) == set(old)
    changed = {name for name in old if after[name] != old[name]}
    assert changed in (set(), set(old) - {"allowed.txt"})
    assert len({credentials.authority for credentials in loaded}) == 1
    keys.rotate(None, NOW, authority=True)
    assert not {name for name in old if name != "allowed.txt" and content(keys)[name] == after[name]}


def test_a_folder_that_others_may_write_is_refused_and_what_is_not_there_told(tmp_path: Path, keys: KeyFolder) -> None:
    with pytest.raises(SettingError, match=r"is no folder of keys .*foretouch keys init makes one"):
        load_credentials("leader", tmp_path / "nowhere")
    with pytest.raises(SettingError, match="no certificate for the leader: foretouch keys issue leader"):
        load_credentials("leader", keys.path)
    (keys.path / "authority.key").unlink()
    with pytest.raises(SettingError, match=r"authority.key.* is not here: run this where the authority was made"):
        keys.issue("leader", "", NOW)
    keys.path.chmod(0o770)
    with pytest.raises(SettingError, match=f"can be written by others: chmod 700 {keys.path}$"):
        load_credentials("leader", keys.path, now=NOW)


def test_of_several_certificates_of_a_role_the_plain_one_is_taken(keys: KeyFolder) -> None:
    keys.issue("leader", "alice", NOW)
    keys.issue("leader", "bob", NOW)
    with pytest.raises(SettingError, match=r"several certificates for the leader \(leader.alice, leader.bob\)"):
        load_credentials("leader", keys.path, now=NOW)
    keys.issue("leader", "", NOW)
    assert load_credentials("leader", keys.path, now=NOW).identity.common_name == "leader"


def test_a_name_is_let_in_no_more_once_it_is_struck_out(keys: KeyFolder) -> None:
    keys.issue("leader", "alice", NOW)
    listed = keys.path / "allowed.txt"
    listed.write_text("# who may come in\n" + listed.read_text().replace("leader.alice\n", "\n"))
    assert load_credentials("leader", keys.path, now=NOW).allowed == ROLES
    listed.write_text("leader\nanybody\n")
    with pytest.raises(SettingError, match=r"common name = 'anybody': write ROLE or ROLE.NAME"):
        load_credentials("leader", keys.path, now=NOW)


def test_files_that_are_no_keys_are_refused(keys: KeyFolder) -> None:
    leader, follower = keys.issue("leader", "", NOW), keys.issue("follower", "", NOW)
    path, none = keys.path / "leader.pem", r"leader.pem.*is no key with a certificate"
    garbage = (b"", b"garbage", leader.certificate, leader.key, leader.pem[:-40], b"\xff" * 1000)
    for data, message in (
        *((data, none) for data in garbage),
        (leader.key + follower.certificate, "the certificate of another key"),
        (follower.pem, "is the certificate of 'follower'"),
        (b" " * 100_000, "longer than 65536 bytes"),
    ):
        path.write_bytes(data)
        with pytest.raises(SettingError, match=message) as raised:
            load_credentials("leader", keys.path, now=NOW)
        assert "\n" not in str(raised.value)
    path.unlink()
    os.mkfifo(path, 0o600)
    with pytest.raises(SettingError, match="no regular file"):
        load_credentials("leader", keys.path, now=NOW)


@pytest.mark.parametrize(
    "name",
    ["", "master", "Leader", "leader.", "leader.A", "leader/../x", "leader.x y", "leader." + 33 * "a", "leader.-"],
)
def test_a_name_is_a_role_or_a_role_with_a_name(name: str) -> None:
    with pytest.raises(SettingError, match=r"write ROLE or ROLE.NAME: leader, follower, watcher"):
        role_of(name)
    assert role_of("leader.left-hand-2") == "leader"


def test_the_folder_is_where_it_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("FORETOUCH_KEYS", str(tmp_path))
    assert default_key_folder() == tmp_path
    monkeypatch.delenv("FORETOUCH_KEYS")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_key_folder() == tmp_path / ".config" / "foretouch" / "keys"


def test_no_key_is_ever_printed(keys: KeyFolder) -> None:
    keys.issue("leader", "", NOW)
    assert "PRIVATE" not in repr(load_credentials("leader", keys.path, now=NOW))
