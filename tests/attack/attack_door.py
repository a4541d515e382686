"""Getting in without the right certificate, and saying more than a role may: over TLS, against processes that run."""

from __future__ import annotations

import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
from target import Score, Target, hello_of, intruder, listen, sample, say_everything, session

from foretouch.link import ROLES, Identity, KeyFolder, may_publish
from foretouch.link.access import key_to_send
from foretouch.link.certificates import make_authority, make_identity
from foretouch.link.key_folder import role_of
from foretouch.messages import CHANNELS, encode

SECONDS = 1.5
"""Each stranger tries for so long [s]."""


def strangers(keys: KeyFolder) -> dict[str, tuple[Identity | None, Identity | None]]:
    now = datetime.now(UTC)
    authority, here, _ = keys.read()
    signing = Identity.read((keys.path / "authority.key").read_bytes(), "authority.key", with_key=True)
    other = make_authority(now)
    stolen = make_identity(here["leader"], "follower", now)
    chain = stolen.certificate + here["leader"].certificate
    return {
        "without TLS": (None, None),
        "no certificate": (None, authority),
        "of another authority": (make_identity(other, "leader", now), authority),
        "of another authority, trusting it": (make_identity(other, "follower", now), other),
        "expired": (make_identity(signing, "leader", now - timedelta(days=10), days=5), authority),
        "not yet valid": (make_identity(signing, "leader", now + timedelta(days=30), days=5), authority),
        "signed by a leader's certificate": (
            Identity("follower", stolen.expires, chain, stolen.fingerprint, stolen.key),
            authority,
        ),
        "of this authority, a name that is not listed": (make_identity(signing, "leader.mallory", now), authority),
    }


def knock(target: Target, endpoint: str, identity: Identity | None, trusts: Identity | None) -> tuple[int, int]:
    received: list[str] = []
    output = 0
    with intruder(connect=endpoint, identity=identity, trusts=trusts) as session:
        keys = ("foretouch/**", "foretouch/telemetry", "foretouch/command", "foretouch/leader")
        kept = [listen(session, key, received) for key in keys]
        end = time.monotonic() + SECONDS
        while time.monotonic() < end:
            say_everything(session)
            output += len(CHANNELS) + 2 * len(ROLES)
            time.sleep(0.05)
        for one in kept:
            one.undeclare()
    return output, len(received)


def overstep(target: Target, endpoint: str, name: str) -> tuple[int, bool]:
    """Say what this certificate may not: how often, and whether it was let in as far as its role goes."""
    role, output, received = role_of(name), [], []
    for channel in sorted(set(CHANNELS) - set(may_publish(role))):
        output.append((f"foretouch/{channel}", sample(channel)))
    for other in ("leader", "follower", "watcher"):
        forged = msgspec.structs.replace(sample("command"), holder=other)
        if other != name:
            output.append((key_to_send("command", other), forged))
            output.append((f"foretouch/command/{name}", forged))
        if other != role:
            output.append((key_to_send("hello", other), hello_of(other)))
    with intruder(connect=endpoint, identity=target.identity(name), trusts=target.authority) as session:
        kept = [listen(session, f"foretouch/{channel}", received) for channel in ("telemetry", "leader")]
        end = time.monotonic() + 5.0
        while not received and time.monotonic() < end:
            time.sleep(0.02)
        tried, end = 0, time.monotonic() + SECONDS
        while time.monotonic() < end:
            for key, message in output:
                session.put(key, encode(message))
                tried += 1
            time.sleep(0.02)
        for one in kept:
            one.undeclare()
    return tried, bool(received)


def changed(before: dict[str, object], after: dict[str, object]) -> str:
    return ", ".join(
        f"{name}: {before.get(name)} -> {after.get(name)}" for name in after if before.get(name) != after[name]
    )


def main() -> int:
    score = Score()
    print("door: strangers at a follower's port over TLS, who say everything")
    with tempfile.TemporaryDirectory() as folder, session(Path(folder)) as target:
        before = target.traces()
        for name, (identity, trusts) in strangers(target.keys).items():
            endpoint = target.at_follower if name != "without TLS" else target.at_follower.replace("tls/", "tcp/")
            tried, received = knock(target, endpoint, identity, trusts)
            before, was = target.traces(), before
            traces = changed(was, before)
            score.note(name, tried, received + bool(traces), traces)
        print("door: what a role may not say")
        for name in ("watcher", "follower", "leader.bob"):
            for side, place in (("follower", target.at_follower), ("leader", target.at_leader)):
                tried, let_in = overstep(target, place, name)
                before, was = target.traces(), before
                # What comes under a key of one's own in another's name is counted where it is dropped.
                traces = changed(was, before | {"follower follower_undecodable": was["follower follower_undecodable"]})
                score.note(f"a {name}'s certificate at the {side}", tried, bool(traces) + (not let_in), traces)
    return score.end()


if __name__ == "__main__":
    sys.exit(main())
