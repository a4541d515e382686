"""What is remembered of a material: its file, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from foretouch.errors import RecordingError, SettingError
from foretouch.models import ContactMapModel
from foretouch.models.contact_map.layout import Map
from foretouch.recordings import memory_path, read_memory, write_memory


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FORETOUCH_MATERIALS", str(tmp_path / "materials"))
    return tmp_path / "materials"


def model() -> ContactMapModel:
    maps = Map.new(lowest=-1e-3, reached=5e-3, felt=3.0, shares=(0.2, 0.8, 0.0), law=(100.0, 1.0, 1.5, 0.1))
    maps[0].coarse.weights[:] = np.arange(maps[0].coarse.weights.size)
    made = ContactMapModel.of(maps)
    assert made is not None
    return made


def test_what_is_written_is_read(home: Path) -> None:
    assert read_memory("foam-1.a") is None
    assert write_memory("foam-1.a", model()) == home / "foam-1.a.json"
    assert read_memory("foam-1.a") == model()
    assert [path.name for path in home.iterdir()] == ["foam-1.a.json"]


@pytest.mark.parametrize("name", ["", "a/b", "../a", ".a", "a b", "a" * 65])
def test_a_name_that_is_a_path_is_refused(name: str) -> None:
    with pytest.raises(SettingError, match="remember"):
        memory_path(name)


def test_a_damaged_file_is_refused_and_stays(home: Path) -> None:
    whole = write_memory("foam", model()).read_bytes()
    other = json.loads(whole)
    changed = {**other, "material": other["material"][:-4] + "AAA="}
    for content in (b"", whole[:-20], b"{}", json.dumps(other | {"version": 2}).encode(), json.dumps(changed).encode()):
        (home / "foam.json").write_bytes(content)
        with pytest.raises(RecordingError, match="damaged"):
            read_memory("foam")
        assert (home / "foam.json").read_bytes() == content


def test_a_text_that_is_no_map_is_refused() -> None:
    for text in ("", "?", "AAAA", model().to_text()[:-8]):
        with pytest.raises(SettingError, match="no text of a contact map"):
            ContactMapModel.from_text(text)
