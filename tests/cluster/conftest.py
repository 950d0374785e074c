"""A cluster of one node for each test that asks for one."""

import tempfile
from pathlib import Path

import pytest
from node import Cluster, missing


@pytest.fixture
def node():
    """Return what starts a cluster; it ends with the test."""
    if fault := missing():
        pytest.skip(fault)
    pytest.importorskip("snakemake_executor_plugin_slurm", reason="no executor plugin for Slurm")
    started = []
    with tempfile.TemporaryDirectory(prefix="slurm") as folder:  # sockets' paths have to be short

        def start(**how):
            started.append(Cluster(Path(folder) / str(len(started)), **how))
            return started[-1].__enter__()

        yield start
        for cluster in started:
            cluster.__exit__()
