import hashlib
import re
import sys
from dataclasses import replace

import pytest

from foretouch.errors import DatasetError, MissingExtraError, UnknownNameError
from foretouch.files import origins
from foretouch.recordings import DATA_DIR, DATASETS, excerpt, fetch_all, fetch_dataset, list_datasets

NAME = "aurora/400-mN"


@pytest.fixture
def published(monkeypatch):
    """What was published under `NAME`, as far as the registry knows: its checksum."""
    content = b"volts"
    monkeypatch.setitem(DATASETS, NAME, replace(DATASETS[NAME], sha256=hashlib.sha256(content).hexdigest()))
    return content


@pytest.fixture
def origin(published, www):
    """The file where the real origin has it."""
    dataset = DATASETS[NAME]
    where = dataset.origin
    path = www / where.repository / where.commit / where.folder / dataset.file
    path.parent.mkdir(parents=True)
    path.write_bytes(published)
    return path


def test_the_registry_is_whole():
    assert len(DATASETS) == 24
    assert len({dataset.sha256 for dataset in DATASETS.values()}) == 24
    for name, dataset in DATASETS.items():
        assert name == dataset.name
        assert re.fullmatch(r"(tue|aurora)/[a-z0-9]+(-[a-z0-9]+)*(-mN)?", name)
        assert re.fullmatch("[0-9a-f]{64}", dataset.sha256)
        assert re.fullmatch("[0-9a-f]{40}", dataset.origin.commit)
        assert dataset.origin.commit in dataset.url
        assert dataset.url == origins.address(dataset.origin, dataset.file)
        assert " " not in dataset.url
        assert dataset.origin.licence.startswith("MIT, Copyright (c) ")
    assert [dataset.name for dataset in list_datasets("rigid") if dataset.seen] == ["tue/a-rigid"]
    assert len(list_datasets("foam")) == 11
    assert sum(dataset.seen for dataset in list_datasets("foam")) == 5
    assert sum(dataset.seen for dataset in list_datasets()) == 13
    assert len(list_datasets("skin")) == 4
    assert [dataset.name for dataset in list_datasets()] == list(DATASETS)
    assert DATASETS["tue/m1-d-foam"].url.endswith("/m1_question1/question1d_foam.mat")
    assert DATASETS["aurora/100-mN"].url.endswith("/Emma%20protocols/22-01-18/100%20mN%20data%20file.ddf")


@pytest.mark.data
@pytest.mark.parametrize("name", DATASETS)
def test_every_original_is_the_registered_one(original, name):
    assert hashlib.sha256(original(name).read_bytes()).hexdigest() == DATASETS[name].sha256


def test_all_of_a_kind_are_fetched_in_order(published, elsewhere, monkeypatch):
    monkeypatch.setenv(DATA_DIR, str(elsewhere))
    paths = []
    for dataset in list_datasets("skin"):
        monkeypatch.setitem(DATASETS, dataset.name, replace(dataset, sha256=DATASETS[NAME].sha256))
        paths.append(elsewhere / dataset.origin.local_folder / dataset.file)
        paths[-1].parent.mkdir(exist_ok=True)
        paths[-1].write_bytes(published)
    assert fetch_all("skin") == paths


@pytest.mark.parametrize("take", [fetch_dataset, excerpt])
def test_an_unknown_name_is_refused_with_those_there_are(take):
    with pytest.raises(UnknownNameError, match="unknown dataset 'foam': choose one of aurora/100-mN, "):
        take("foam")


def test_an_unknown_kind_is_refused_with_those_there_are():
    with pytest.raises(UnknownNameError, match="choose one of foam, free, rigid, skin, spring"):
        list_datasets("wood")


def test_a_data_folder_serves_without_network_or_pooch(published, elsewhere, monkeypatch):
    path = elsewhere / "store" / "below" / "aurora_skin_indentation" / DATASETS[NAME].file
    path.parent.mkdir(parents=True)
    path.write_bytes(published)
    monkeypatch.setenv(DATA_DIR, str(elsewhere / "store"))
    monkeypatch.setitem(sys.modules, "pooch", None)
    assert fetch_dataset(NAME) == path
    with pytest.raises(MissingExtraError, match="pooch"):
        fetch_dataset("tue/a-foam")


def test_a_wrong_file_in_the_data_folder_is_refused(elsewhere, monkeypatch):
    dataset = DATASETS[NAME]
    wrong = elsewhere / dataset.origin.local_folder / dataset.file
    wrong.parent.mkdir()
    wrong.write_text("something else")
    monkeypatch.setenv(DATA_DIR, str(elsewhere))
    with pytest.raises(DatasetError, match="is not the original of aurora/400-mN: its SHA-256 differs"):
        fetch_dataset(NAME)


def test_a_data_folder_that_is_none_is_refused(elsewhere, monkeypatch):
    monkeypatch.setenv(DATA_DIR, str(elsewhere / "absent"))
    with pytest.raises(DatasetError, match="is no folder"):
        fetch_dataset(NAME)


def test_without_network_one_line_says_what_to_do(elsewhere):
    for attempt in (lambda: fetch_dataset(NAME), lambda: fetch_all("skin")):
        with pytest.raises(DatasetError) as caught:
            attempt()
        assert re.search(r"is not here and could not be fetched.*refused.*FORETOUCH_DATA_DIR", str(caught.value))
        assert "\n" not in str(caught.value)


def test_the_origin_is_asked_once_and_then_the_cache(origin, elsewhere, monkeypatch):
    path = fetch_dataset(NAME)
    assert path.read_bytes() == origin.read_bytes()
    assert elsewhere / "cache" in path.parents
    monkeypatch.setattr(origins, "HOST", "http://127.0.0.1:9")
    assert fetch_dataset(NAME) == path


def test_what_the_origin_changed_is_not_taken(origin):
    origin.write_text("another version")
    with pytest.raises(DatasetError, match="what came has another SHA-256"):
        fetch_dataset(NAME)
    origin.unlink()
    with pytest.raises(DatasetError, match="404"):
        fetch_dataset(NAME)
