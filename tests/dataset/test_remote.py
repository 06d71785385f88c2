"""Datasets at addresses: memory, and HTTP and an object store on the loopback interface."""

import functools
import http.server
import shutil
import threading

import numpy as np
import pytest

from faultgen.dataset.reader import open_dataset
from faultgen.dataset.remote import CACHE, cache_folder, is_remote
from faultgen.datasets import load_wear
from faultgen.errors import InputError

fsspec = pytest.importorskip("fsspec")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def whole():
    """The file of a small dataset."""
    return open_dataset(load_wear().path)


@pytest.fixture
def memory(whole):
    """Address of a copy in memory."""
    files = fsspec.filesystem("memory")
    for name in (whole.file.name, whole.file.name + ".sha256"):
        content = whole.file.with_name(name).read_bytes()
        files.pipe(f"/out/{name.replace(whole.file.stem, 'dataset')}", content)
    yield "memory://out"
    files.rm("/out", recursive=True)


def test_a_dataset_in_memory_is_read_and_copied_once(memory, whole):
    dataset = open_dataset(memory)
    assert [run.id for run in dataset] == [run.id for run in whole]
    name = "monitoring/mean_abs_torque"
    assert np.array_equal(dataset[0].read(name), whole[0].read(name))
    (copy,) = cache_folder().glob("*/dataset.h5")
    before = copy.stat().st_mtime_ns
    assert open_dataset(f"{memory}/dataset.h5").file == copy
    assert copy.stat().st_mtime_ns == before


def test_what_has_changed_there_is_copied_again(memory):
    open_dataset(memory)
    files = fsspec.filesystem("memory")
    files.pipe("/out/dataset.h5", b"other")
    files.pipe("/out/dataset.h5.sha256", b"0" * 64)
    with pytest.raises(InputError, match="differs from its checksum"):
        open_dataset(memory)
    assert not list(cache_folder().glob("0*/*"))


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("memory://nothing", "there is no memory://nothing/dataset.h5.sha256"),
        ("nonsense://host/out", "nonsense"),
        ("http://127.0.0.1:9/out", "127.0.0.1"),
    ],
)
def test_an_address_that_cannot_be_read_is_named_in_one_line(address, words):
    with pytest.raises(InputError, match=words) as caught:
        open_dataset(address)
    assert "\n" not in str(caught.value)


def test_a_dataset_is_read_over_http(whole, tmp_path):
    pytest.importorskip("aiohttp")
    folder = tmp_path / "served" / "out"
    folder.mkdir(parents=True)
    for name in (whole.file.name, whole.file.name + ".sha256"):
        copy = name.replace(whole.file.stem, "dataset")
        shutil.copy(whole.file.with_name(name), folder / copy)
    handler = functools.partial(
        http.server.SimpleHTTPRequestHandler, directory=str(tmp_path / "served")
    )
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        dataset = open_dataset(f"http://127.0.0.1:{server.server_port}/out")
        assert len(dataset) == len(whole)
        server.shutdown()


def test_a_dataset_is_read_from_an_object_store(whole, monkeypatch):
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    try:
        host, port = server.get_host_and_port()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        for name in ("ACCESS_KEY_ID", "SECRET_ACCESS_KEY"):
            monkeypatch.setenv(f"AWS_{name}", "test")
        monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        files = fsspec.filesystem("s3", skip_instance_cache=True)
        files.mkdir("robots")
        for name in (whole.file.name, whole.file.name + ".sha256"):
            copy = name.replace(whole.file.stem, "dataset")
            files.put(str(whole.file.with_name(name)), f"robots/out/{copy}")
        assert len(open_dataset("s3://robots/out")) == len(whole)
        with pytest.raises(InputError, match="there is no s3://robots/nothing/dataset.h5"):
            open_dataset("s3://robots/nothing")
    finally:
        server.stop()


def test_paths_are_no_addresses(tmp_path):
    assert not is_remote(tmp_path) and not is_remote("out/dataset.h5") and is_remote("s3://a/b")
