"""Results in an object store: moto's server, behind a door that can be shut."""

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from types import SimpleNamespace

import pytest
from node import free_ports
from small import CONFIG, copied, differing, with_data_set

import pandis
from pandis.pipeline.run.host.ending import farewell
from pandis.pipeline.run.job import stored
from shapes import box
from support import environment, snakemake, snakemake_command

STORE = ("--profile", "workflow/profiles/s3", "--default-storage-prefix", "s3://pandis")
#: The mesh is a file of the folder, and not of the store.
BOX = ["exact", "pandis-exact"], {"box": {"source": "box.obj"}}


class Door:
    """A port through which the store is reached, while it is open."""

    def __init__(self, behind):
        self.behind, self.port = behind, free_ports(1)[0]
        self._links, self._threads, self._door = [], [], None

    def open(self):
        self._door = socket.create_server(("127.0.0.1", self.port))
        self._welcomer = self._start(self._welcome, self._door)

    def shut(self):
        """Let nobody in any more, and cut off who is inside.

        The welcoming thread ends before the links are closed: a guest that it admitted
        meanwhile would be left open.
        """
        self._cut(self._door)
        self._welcomer.join()
        for link in self._links:
            self._cut(link)
        for thread in self._threads:
            thread.join()
        for each in (self._door, *self._links):
            each.close()
        self._links, self._threads = [], []

    @staticmethod
    def _start(target, *arguments):
        thread = threading.Thread(target=target, args=arguments, daemon=True)
        thread.start()
        return thread

    @staticmethod
    def _cut(link):
        with suppress(OSError):
            link.shutdown(socket.SHUT_RDWR)

    def _welcome(self, door):
        with suppress(OSError):
            while True:
                guest = door.accept()[0]
                try:
                    store = socket.create_connection(self.behind)
                except OSError:  # the store itself has ended
                    guest.close()
                    raise
                self._links += [guest, store]
                for one, other in ((guest, store), (store, guest)):
                    self._threads.append(self._start(self._pass_on, one, other))

    @staticmethod
    def _pass_on(one, other):
        with suppress(OSError):
            while got := one.recv(1 << 16):
                other.sendall(got)
            other.shutdown(socket.SHUT_WR)


@pytest.fixture
def store():
    """Return a door to an empty store, and the environment in which Snakemake finds it."""
    pytest.importorskip("moto", reason="no moto: pip install -r tests/cluster/requirements.txt")
    pytest.importorskip("snakemake_storage_plugin_s3", reason="no storage plugin for S3")
    port = free_ports(1)[0]
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    door = Door(("127.0.0.1", port))
    names = {"ENDPOINT_URL": f"http://127.0.0.1:{door.port}", "ACCESS_KEY": "a", "SECRET_KEY": "b"}
    end = time.monotonic() + 60
    while server.poll() is None and time.monotonic() < end:
        with suppress(OSError):
            socket.create_connection(("127.0.0.1", port)).close()
            break
        time.sleep(0.1)
    door.open()
    yield door, {f"SNAKEMAKE_STORAGE_S3_{name}": value for name, value in names.items()}
    door.shut()
    server.kill()
    server.wait()


def with_box(folder):
    """Copy the workflow there, with a configuration of a box."""
    copied(folder, *BOX)
    box((20, 10, 10), 5).export(folder / "box.obj")
    return folder


def fetched(names, folder):
    """Bring the store's results into a folder, as `aws s3 sync` does."""
    import boto3

    bucket = boto3.resource(
        "s3", endpoint_url=names["SNAKEMAKE_STORAGE_S3_ENDPOINT_URL"], region_name="us-east-1",
        aws_access_key_id="a", aws_secret_access_key="b",
    ).Bucket("pandis")  # fmt: skip
    for thing in bucket.objects.all():
        path = folder / thing.key
        path.parent.mkdir(parents=True, exist_ok=True)
        bucket.download_file(thing.key, str(path))


@pytest.mark.full
def test_a_second_folder_has_nothing_to_do(store, tmp_path):
    """And what the store holds is whole, and belongs to the configuration."""
    _, names = store
    first, second = with_box(tmp_path / "first"), with_box(tmp_path / "second")
    done = snakemake(first, *STORE, "-j2", *CONFIG, "--", "all", **names)
    assert done.returncode == 0, done.stdout
    assert "The results are in s3://pandis/results/" in done.stdout
    assert not (first / "results").exists()
    done = snakemake(second, *STORE, "-j2", *CONFIG, "--", "all", **names)
    assert done.returncode == 0, done.stdout
    assert "Nothing to be done" in done.stdout
    assert "no record of the options behind the results in s3://pandis" in done.stdout
    done = snakemake(second, *STORE, "-j2", *CONFIG, "--", "verify", **names)
    assert done.returncode != 0
    assert "verify reads files, but these results are in s3://pandis" in done.stdout
    fetched(names, second)
    done = snakemake(second, "-j2", *CONFIG, "--", "verify")
    assert done.returncode == 0, done.stdout
    path = second / "results/box/export/exact.pandis"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert snakemake(second, "-j2", *CONFIG, "--", "verify").returncode != 0


@pytest.mark.full
def test_a_store_that_goes_away_for_half_a_minute_is_waited_for(store, tmp_path):
    door, names = store
    folder = with_box(tmp_path / "run")
    command = snakemake_command(*STORE, "-j2", *CONFIG, "--", "all")
    log = tmp_path / "log"
    with log.open("w") as stream:
        run = subprocess.Popen(command, cwd=folder, stdout=stream, stderr=stream,
                               env=environment(**names))  # fmt: skip
        try:
            while "Finished jobid" not in log.read_text() and run.poll() is None:
                time.sleep(0.1)
            door.shut()
            time.sleep(30)
            door.open()
            assert run.wait(900) == 0, log.read_text()
        finally:
            run.kill()
    fetched(names, folder)
    done = snakemake(folder, "-j2", *CONFIG, "--", "verify")
    assert done.returncode == 0, done.stdout


@pytest.mark.full
def test_a_data_set_is_that_of_a_local_run(store, tmp_path):
    _, names = store
    here, there = with_data_set(tmp_path / "here"), with_data_set(tmp_path / "there")
    done = snakemake(here, "-j2", *CONFIG, "--", "datasets")
    assert done.returncode == 0, done.stdout
    done = snakemake(there, *STORE, "-j2", *CONFIG, "--", "datasets", **names)
    assert done.returncode == 0, done.stdout
    assert not (there / "results").exists()
    fetched(names, there)
    assert differing(here, there) == []
    shutil.rmtree(there / "results")
    box((3, 2, 1), 1).export(there / "parts/new.obj")
    done = snakemake(there, *STORE, "-j2", *CONFIG, "--", "datasets", **names)
    assert done.returncode == 0, done.stdout
    fetched(names, there)
    assert pandis.LabelStore(there / "results/datasets/parts").names == ["box", "new", "small"]


def test_what_a_run_says_names_the_store():
    class Plan:
        store, folder, scenes, report = "s3://bucket/", "results", {}, "results/report.html"

    assert farewell(Plan) == "\nThe results are in s3://bucket/results/"


def test_shut_doors_let_nobody_in():
    """Else the store would never have been away."""
    server = socket.create_server(("127.0.0.1", 0))
    door = Door(server.getsockname())
    door.open()
    guest = socket.create_connection(("127.0.0.1", door.port))
    host = server.accept()[0]
    guest.sendall(b"in")
    assert host.recv(2) == b"in"
    door.shut()
    assert guest.recv(2) == b""
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", door.port))
    door.open()
    again = socket.create_connection(("127.0.0.1", door.port))
    door.shut()
    for one in (guest, host, again, server):
        one.close()


def test_results_name_their_inputs_without_the_store(tmp_path, monkeypatch):
    """The same bytes with a store and without: a bucket may be called as the results are."""
    monkeypatch.chdir(tmp_path)
    copies = ".snakemake/storage/s3/results/some/where"
    monkeypatch.delenv(stored.COPIES, raising=False)
    assert stored.original("results/box/mesh.zarr.zip") == "results/box/mesh.zarr.zip"
    assert not stored.is_copy(f"{copies}/results/box/mesh.zarr.zip")
    settings = SimpleNamespace(
        default_storage_prefix="s3://results/some/where/", local_storage_prefix=".snakemake/storage"
    )
    stored.tell_copies(settings)
    assert os.environ[stored.COPIES] == copies
    monkeypatch.setenv(stored.COPIES, copies)  # so that it is taken back
    assert stored.original(f"{copies}/results/box/mesh.zarr.zip") == "results/box/mesh.zarr.zip"
    assert stored.original(tmp_path / copies / "results/a") == "results/a"
    assert stored.original("meshes/box.obj") == "meshes/box.obj"
    assert stored.original("/elsewhere/box.obj") == "/elsewhere/box.obj"
