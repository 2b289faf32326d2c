"""A Ray cluster of several nodes on this machine makes what one process makes, whatever dies on the way."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from small_recipe import checksums, evis, write

from evis.dataset.making.make import make
from evis.dataset.making.processes import Processes
from evis.dataset.recipe import Plan
from evis.dataset.recipe_file import read_recipe

pytestmark = pytest.mark.extras
MORE = ("sequences: 5", "sequences: 8")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A head without cores, and two nodes with one each."""
    pytest.importorskip("ray")
    import ray
    from ray.cluster_utils import Cluster

    found = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    for _ in range(2):
        found.add_node(num_cpus=1)
    found.wait_for_nodes()
    yield found
    ray.shutdown()
    found.shutdown()


def serial(folder: Path) -> tuple[Path, dict[str, str]]:
    """The recipe, and what one process makes of it."""
    recipe = write(folder, MORE)
    made = make(read_recipe(recipe), str(folder / "serial"), lambda out: Processes(1, out))
    assert made.made == 8
    return recipe, checksums(folder / "serial")


def test_a_cluster_makes_the_same_bytes(cluster: Any, tmp_path: Path) -> None:
    """By the command line, which finds two workers there."""
    recipe, expected = serial(tmp_path)
    evis("dataset", "make", recipe, "--out", tmp_path / "d", "--address", cluster.address)
    assert checksums(tmp_path / "d") == expected


def test_a_worker_and_a_node_die_in_mid_run(cluster: Any, tmp_path: Path) -> None:
    """Both have begun sequences; others make them, and nothing is half-written."""
    import ray

    from evis.dataset.making.cluster import Actors

    recipe, expected = serial(tmp_path)
    victims: list[str] = []

    class Wounded(Actors):
        def assign(self, worker: int, plans: Sequence[Plan]) -> None:
            super().assign(worker, plans)
            if plans[0].index == 3 and not victims:
                pid = ray.get(self._all[worker].__ray_call__.remote(lambda actor: os.getpid()))
                victims.append("worker")
                os.kill(pid, signal.SIGKILL)
            elif plans[0].index == 5 and len(victims) == 1:
                victims.append("node")
                cluster.remove_node(next(iter(cluster.worker_nodes)), allow_graceful=False)
                cluster.add_node(num_cpus=1)

    made = make(read_recipe(recipe), str(tmp_path / "d"), lambda out: Wounded(None, out, cluster.address, 0))
    assert victims == ["worker", "node"] and made.made == 8 and sum(made.retried.values()) >= 1
    assert checksums(tmp_path / "d") == expected


def test_a_data_set_on_s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Made, resumed, verified and shown there; its files are those of a local one."""
    server_module = pytest.importorskip("moto.server")
    fsspec = pytest.importorskip("fsspec")
    server = server_module.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    try:
        host, port = server.get_host_and_port()
        for name, value in {
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        }.items():
            monkeypatch.setenv(name, value)
        fsspec.filesystem("s3").mkdir("bucket")
        recipe = write(tmp_path)
        evis("dataset", "make", recipe, "--out", tmp_path / "here", "--workers", 1)
        out = "s3://bucket/sets/d"
        evis("dataset", "make", recipe, "--out", out, "--count", 2, "--workers", 1)
        told = json.loads(evis("dataset", "make", recipe, "--out", out, "--resume", "--workers", 2, "--json").stdout)
        assert told["made"] == 3 and told["there"] == 5
        assert json.loads(evis("dataset", "verify", out, "--json").stdout)["wrong"] == []
        evis("dataset", "show", out, "--out", tmp_path / "sheet")
        fsspec.filesystem("s3", skip_instance_cache=True).get("bucket/sets/d", str(tmp_path / "there"), recursive=True)
        assert checksums(tmp_path / "there") == checksums(tmp_path / "here")
    finally:
        server.stop()


def test_workers_share_gpus_of_a_cluster(cluster: Any, tmp_path: Path) -> None:
    """As Ray counts them: three actors on a node that says it has two, none of which computes there."""
    from evis.dataset.making.cluster import Actors

    cluster.add_node(num_cpus=1, num_gpus=2)
    cluster.wait_for_nodes()
    hands: list[Actors] = []

    def three(out: str) -> Actors:
        hands.append(Actors(3, out, cluster.address, 4))
        return hands[0]

    recipe = write(tmp_path)
    made = make(read_recipe(recipe), str(tmp_path / "d"), three, batch=2)
    assert hands[0].count == 3 and made.made == 5 and not made.retried
    make(read_recipe(recipe), str(tmp_path / "one"), lambda out: Processes(1, out))
    assert checksums(tmp_path / "d") == checksums(tmp_path / "one")
