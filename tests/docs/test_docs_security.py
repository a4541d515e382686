"""What the page says that each role may send is what the access list enforces."""

from __future__ import annotations

import re
from typing import Any

import pytest
from docs_pages import ROOT

from foretouch.link import ROLES, access_list
from foretouch.messages import CHANNELS

PAGE = (ROOT / "docs" / "security.md").read_text()


def table() -> dict[str, set[str]]:
    """The channels that each role may send on, as the page says."""
    section = PAGE[PAGE.index("## Who can do what") : PAGE.index("**Control is a certificate's.**")]
    rows = re.findall(r"^\| (.+?) \| (yes|no) \| (.+) \|$", section, re.MULTILINE)
    assert [hears for _, hears, _ in rows] == ["yes"] * len(ROLES) + ["no"]
    return {role: set(re.findall(r"`([a-z-]+)`", channels)) for role, _, channels in rows}


def enforced(role: str) -> set[str]:
    """Channels on which a process that receives all takes what a certificate of this name says."""
    made: Any = access_list((*ROLES, "leader.bob"), CHANNELS)
    granted = {rule for policy in made["policies"] if role in policy["subjects"] for rule in policy["rules"]}
    keys = [
        key
        for rule in made["rules"]
        if rule["id"] in granted and "put" in rule["messages"] and "ingress" in rule["flows"]
        for key in rule["key_exprs"]
    ]
    return {re.sub(r"^foretouch/([a-z-]+).*", r"\1", key) for key in keys}


def test_every_channel_is_named() -> None:
    section = PAGE[PAGE.index("## Who can do what") : PAGE.index("**Control is a certificate's.**")]
    assert set(CHANNELS) <= set(re.findall(r"`([a-z-]+)`", section))


@pytest.mark.parametrize("role", ROLES)
def test_the_table_is_what_is_enforced(role: str) -> None:
    assert table()[role] == enforced(role)


def test_who_is_not_listed_may_nothing() -> None:
    assert list(table()) == [*ROLES, "none, another authority's, or not listed"]
    assert list(table().values())[-1] == set()
    made: Any = access_list((), CHANNELS)
    assert made["default_permission"] == "deny"
    assert [policy["subjects"] for policy in made["policies"]] == [["local"]]
    assert made["subjects"] == [{"id": "local", "link_protocols": ["tcp"]}]


def test_each_leader_commands_in_its_own_name_alone() -> None:
    made: Any = access_list(("leader", "leader.bob", "watcher"), CHANNELS)
    keys = {rule["id"]: {key for key in rule["key_exprs"] if "command" in key} for rule in made["rules"]}
    assert keys["leader"] == {"foretouch/command/leader"}
    assert keys["leader.bob"] == {"foretouch/command/leader.bob"}
    assert keys["watcher"] == set()


def test_nobody_releases_over_the_network() -> None:
    fields = {name for channel in CHANNELS.values() for name in channel.kind.__struct_fields__}
    assert not {name for name in fields if "release" in name}
    assert not {name for name in CHANNELS if "release" in name}
