"""Arrays that stay on their device: by reference to who takes them there, in numpy to everybody else."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import warp as wp
import zmq

from evis.bus import BusError, Publisher, Subscriber, endpoints_for
from evis.bus.memory.device import DevicePool
from evis.runtime.delivery import Delivery
from evis.runtime.hosting.host import Host
from evis.runtime.hosting.join import Join
from evis.runtime.plan import Edge, NodePlan, Plan, TopicPlan
from evis.simulation.caller import owned
from msgs.camera import Depth
from msgs.fields import MessageError
from msgs.header import Header

sys.path.insert(0, str(Path(__file__).parent))
from device_nodes import Glancer, Watcher
from plan_runs import run_in_threads

COUNT = 20


def make_plan(directory: Path, processes: dict[str, str], size: int, **devices: str) -> Plan:
    """painter -> (watcher, reader); a node that has no process is left out."""
    plan = Plan("device", "run", str(directory))
    inputs = {
        "painter": {},
        "watcher": {"depth": ["/cam0/depth"], "motion": ["/cam0/motion"]},
        "reader": {"depth": ["/cam0/depth"]},
        "glancer": {"depth": ["/cam0/depth"]},
    }
    outputs = {"depth": "/cam0/depth", "motion": "/cam0/motion"}
    params = {
        "painter": {"count": COUNT, "size": size, "device": devices.get("painter", "cpu")},
        "watcher": {"path": str(directory / "watcher.json"), "device": devices.get("watcher", "cpu")},
        "reader": {"path": str(directory / "reader.json")},
        "glancer": {"path": str(directory / "glancer.json")},
    }
    for name, process in processes.items():
        plan.nodes[name] = NodePlan(
            name, f"device_nodes:{name.title()}", params[name], process, inputs[name],
            outputs if name == "painter" else {},
        )  # fmt: skip
    for port, kind in (("depth", "Depth"), ("motion", "Motion")):
        slow = {"glancer": Glancer.arrays_hz({}, port)}
        edges = [Edge(name, port, arrays_hz=slow.get(name)) for name in processes if port in inputs[name]]
        plan.topics[f"/cam0/{port}"] = TopicPlan(f"/cam0/{port}", kind, "painter", port, edges)
    return plan


def check(directory: Path, processes: dict[str, str], by_reference: bool) -> None:
    if "watcher" in processes:
        seen = json.loads((directory / "watcher.json").read_text())
        assert seen == [[by_reference, k, k, -k] for k in range(COUNT)]
    if "reader" in processes:
        assert json.loads((directory / "reader.json").read_text()) == [["ndarray", k] for k in range(COUNT)]


@pytest.mark.parametrize("size", [8, 300])  # inline, and through shared memory, where another process reads
@pytest.mark.parametrize(
    "processes",
    [
        {"painter": "a", "watcher": "a"},
        {"painter": "a", "reader": "a"},
        {"painter": "a", "watcher": "a", "reader": "a"},
        {"painter": "a", "watcher": "a", "reader": "b"},
        {"painter": "a", "watcher": "b", "reader": "a"},
        {"painter": "a", "watcher": "b", "reader": "c"},
    ],
    ids=lambda p: " ".join(f"{n}:{where}" for n, where in p.items()),
)
def test_everybody_sees_the_same_values_and_only_who_takes_them_there_gets_warp_arrays(
    tmp_path: Path, processes: dict[str, str], size: int
) -> None:
    """The watcher keeps three messages at a time: what it keeps must not be written over."""
    assert run_in_threads(make_plan(tmp_path, processes, size)) == {}
    check(tmp_path, processes, by_reference=processes.get("watcher") == "a")


@pytest.mark.parametrize("beside", [{}, {"watcher": "a"}, {"reader": "b"}], ids=str)
def test_arrays_that_nobody_reads_stay_where_they_are(tmp_path: Path, beside: dict[str, str]) -> None:
    """Of three messages one is copied to the host, unless somebody else reads all."""
    assert run_in_threads(make_plan(tmp_path, {"painter": "a", "glancer": "a", **beside}, 300)) == {}
    seen = json.loads((tmp_path / "glancer.json").read_text())
    assert seen == [["array" if k % 3 else "ndarray", 1, k] for k in range(COUNT)]
    check(tmp_path, beside, by_reference=True)


@pytest.mark.parametrize("beside", [{}, {"watcher": "a"}, {"watcher": "a", "reader": "a"}, {"reader": "b"}], ids=str)
def test_another_process_that_reads_no_arrays_of_a_message_gets_none(tmp_path: Path, beside: dict[str, str]) -> None:
    """All messages come, numbered, but two of three are copied to no host for its sake."""
    assert run_in_threads(make_plan(tmp_path, {"painter": "a", "glancer": "c", **beside}, 300)) == {}
    seen = json.loads((tmp_path / "glancer.json").read_text())
    copied = "reader" in beside
    assert seen == [["ndarray", 0 if k % 3 and not copied else 1, k] for k in range(COUNT)]
    check(tmp_path, beside, by_reference=True)


IN_PLACE = [
    ({"painter": "a"}, "array"),
    ({"painter": "a", "watcher": "a"}, "array"),
    ({"painter": "a", "reader": "a"}, "ndarray"),
    ({"painter": "a", "watcher": "a", "reader": "a"}, "array"),
    ({"painter": "a", "watcher": "a", "reader": "b"}, "array"),
    ({"painter": "a", "watcher": "b"}, "ndarray"),
    ({"painter": "a", "watcher": "b", "reader": "a"}, "ndarray"),
]


@pytest.mark.parametrize(("processes", "kind"), IN_PLACE, ids=str)
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def test_arrays_are_made_where_they_are_read(tmp_path: Path, processes: dict[str, str], kind: str, device: str) -> None:
    """On the device where one reader takes them there, or nobody reads them; else on the host, with no copy."""
    plan = make_plan(tmp_path, processes, 300, painter=device, watcher=device)
    plan.nodes["painter"].params["loans"] = str(tmp_path / "loans.json")
    assert run_in_threads(plan) == {}
    assert json.loads((tmp_path / "loans.json").read_text()) == [kind] * COUNT
    check(tmp_path, processes, by_reference=processes.get("watcher") == "a")


PROCESS = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from evis.runtime.executor import Executor
from evis.runtime.plan import Plan
executor = Executor(Plan.load(Path(sys.argv[2])), sys.argv[3])
executor.setup()
executor.wait_connected(60.0)
executor.run()
executor.close()
"""


def run_apart(plan: Plan, path: Path) -> list[str]:
    """Every process of the plan as one of the system's, not as a thread; what each of them says."""
    plan.save(path)
    words = [sys.executable, "-c", PROCESS, str(Path(__file__).parent), str(path)]
    begun = [
        subprocess.Popen([*words, process], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for process in plan.processes()
    ]
    said = [process.communicate(timeout=120)[0] for process in begun]
    assert [process.returncode for process in begun] == [0] * len(begun), said
    return said


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("size", [8, 300])
@pytest.mark.parametrize("beside", [{}, {"glancer": "c"}, {"reader": "c"}, {"reader": "a"}], ids=str)
def test_another_process_on_the_same_gpu_reads_in_place(
    tmp_path: Path, beside: dict[str, str], size: int, device: str
) -> None:
    """The watcher keeps three messages at a time. Beside one who reads all on the host it does so too."""
    processes = {"painter": "a", "watcher": "b", **beside}
    plan = make_plan(tmp_path, processes, size, painter=device, watcher=device.removesuffix(":0"))
    said = run_apart(plan, tmp_path / "plan.json")
    assert not any("CUDA error" in text for text in said), said
    there = device != "cpu" and "reader" not in beside
    watched = json.loads((tmp_path / "watcher.json").read_text())
    # Of three messages the glancer reads one, on the host.
    assert watched == [[there and not ("glancer" in beside and k % 3 == 0), k, k, -k] for k in range(COUNT)]
    if "glancer" in beside:
        seen = json.loads((tmp_path / "glancer.json").read_text())
        assert seen == [["ndarray", 0 if k % 3 and there else 1, k] for k in range(COUNT)]


@pytest.mark.gpu
@pytest.mark.parametrize("watcher", ["cuda", "cuda:0", "cpu"])
def test_arrays_of_a_gpu_reach_a_node_on_the_same_device_as_they_are(tmp_path: Path, watcher: str) -> None:
    processes = {"painter": "a", "watcher": "a", "reader": "a"}
    assert run_in_threads(make_plan(tmp_path, processes, 300, painter="cuda:0", watcher=watcher)) == {}
    check(tmp_path, processes, by_reference=watcher != "cpu")


@pytest.fixture
def publisher(tmp_path: Path):
    context = zmq.Context()
    made = Publisher(context, "/cam0/depth", "painter", endpoints_for(str(tmp_path), "/cam0/depth"), [],
                     message_type=Depth, tap_hz=1 / 3600)  # fmt: skip
    made.start()
    yield made
    made.close()
    context.destroy(linger=0)


def test_without_readers_of_bytes_nothing_is_copied_to_the_host(publisher: Publisher) -> None:
    assert not publisher.reads_bytes()
    for seq in range(3):
        array = publisher.loan_on(wp.get_device("cpu"), {"depth": ((1, 50, 60), wp.float32)})["depth"]
        message = Depth(Header(seq), array)
        publisher.passed(message)
        slot = publisher.claim_on(message)
        assert message.header.seq == seq and slot is not None
        slot.unpin()
    stats = publisher.stats()
    assert stats["sent"] == 3 and stats["bytes"] == 3 * 50 * 60 * 4
    assert stats["slots"] == 0


def test_a_viewer_gets_numpy_arrays_while_it_looks(publisher: Publisher) -> None:
    viewer = Subscriber(publisher._context, "/cam0/depth", "viewer", "tap", publisher.endpoints, message_type=Depth,
                        tap=True)  # fmt: skip
    viewer.start()
    deadline = time.monotonic() + 60
    while not publisher.reads_bytes():
        publisher.pump()
        assert time.monotonic() < deadline
    for stamp in range(4):
        array = publisher.loan_on(wp.get_device("cpu"), {"depth": ((1, 50, 60), wp.float32)})["depth"]
        array.fill_(float(stamp))
        Delivery.of(Depth(Header(stamp), array), publisher, []).over()
    # One message an hour, and one more at the start: the others stay where they are.
    assert not publisher.reads_bytes()
    for stamp in range(2):
        seen = viewer.receive(60_000)
        assert isinstance(seen, Depth) and isinstance(seen.depth, np.ndarray)
        assert seen.header.stamp_ns == stamp and (seen.depth == stamp).all()
    assert publisher.stats()["tap_skipped"] == 2
    viewer.close()


def test_a_warp_array_of_the_wrong_type_is_refused(publisher: Publisher) -> None:
    for shape, dtype in (((1, 5, 6), wp.float64), ((5, 6), wp.float32), ((1, 5, 6), wp.vec2)):
        with pytest.raises(MessageError, match=r"Depth\.depth has"):
            publisher.passed(Depth(Header(0), wp.zeros(shape, dtype=dtype, device="cpu")))


def test_slots_are_used_again_once_released_and_not_before() -> None:
    pool, device = DevicePool("/cam0/depth"), wp.get_device("cpu")
    asked = {"depth": ((1, 4, 5), wp.float32)}

    def claimed():
        array = pool.loan(device, asked)["depth"]
        slot = pool.claim(Depth(Header(0), array))
        assert slot is not None
        return array, slot

    first, slot = claimed()
    second, other = claimed()
    assert first.ptr != second.ptr
    slot.pin()
    slot.unpin()
    third, last = claimed()
    assert third.ptr not in (first.ptr, second.ptr)
    slot.unpin()
    again, slot = claimed()
    assert again.ptr == first.ptr and pool.live == 3
    for held in (slot, other, last):
        held.unpin()
    with pytest.raises(BusError, match="released more often"):
        last.unpin()


def test_a_message_that_was_handed_over_keeps_its_arrays() -> None:
    """What `evis.Simulation` returns is the caller's: later loans are other memory, and nothing is copied."""
    pool, device = DevicePool("/cam0/depth"), wp.get_device("cpu")
    taken = []
    for k in range(3):
        array = pool.loan(device, {"depth": ((1, 4, 5), wp.float32)})["depth"]
        array.fill_(float(k))
        message = Depth(Header(0), array)
        message._slot = pool.claim(message)  # type: ignore[misc]
        taken.append(owned(message))
        assert taken[-1].depth is array
    assert [float(message.depth.numpy().max()) for message in taken] == [0.0, 1.0, 2.0] and pool.live == 0


def test_a_message_that_somebody_else_reads_too_is_copied() -> None:
    pool, device = DevicePool("/cam0/depth"), wp.get_device("cpu")
    array = pool.loan(device, {"depth": ((1, 4, 5), wp.float32)})["depth"]
    message = Depth(Header(0), array)
    message._slot = pool.claim(message)  # type: ignore[misc]
    message.keep()
    assert owned(message).depth.ptr != array.ptr and pool.live == 1


def test_arrays_of_one_loan_do_not_overlap_and_a_larger_one_has_room() -> None:
    pool, device = DevicePool("/cam0/frames"), wp.get_device("cpu")
    for height in (3, 2000, 7):
        loan = pool.loan(device, {"a": ((1, height, 5), wp.vec3), "b": ((2, height), wp.uint8)})
        loan["a"].fill_(wp.vec3(1.0, 2.0, 3.0))
        loan["b"].fill_(255)
        np.testing.assert_array_equal(loan["a"].numpy(), np.broadcast_to([1, 2, 3], (1, height, 5, 3)))
        assert (loan["b"].numpy() == 255).all()


def test_a_loan_that_is_not_sent_lapses() -> None:
    pool, device = DevicePool("/cam0/depth"), wp.get_device("cpu")
    for _ in range(100):
        pool.loan(device, {"depth": ((1, 4, 5), wp.float32)})
        assert pool.claim(Depth(Header(0), np.zeros((1, 4, 5), np.float32))) is None
    assert pool.live == 1


def test_keeping_without_end_is_an_error_that_names_the_topic() -> None:
    pool, device = DevicePool("/cam0/depth"), wp.get_device("cpu")
    with pytest.raises(BusError, match=r"/cam0/depth: all \d+ slots are kept"):
        for _ in range(1000):
            array = pool.loan(device, {"depth": ((1, 4, 5), wp.float32)})["depth"]
            assert pool.claim(Depth(Header(0), array)) is not None


def events_of(directory: Path, *more: str) -> dict[str, np.ndarray]:
    """Events of a short run of real nodes on a GPU."""
    directory.mkdir()
    given = ["device:=cuda", "width:=96", "height:=72", "--duration", "0.2", "--no-view", "--record", "run.mcap"]
    for command in (
        ["launch", "spinning_disk", *given, *more],
        ["bag", "export", "run.mcap", "--topic", "/cam0/events", "events.npz"],
    ):
        subprocess.run([sys.executable, "-m", "evis", *command], cwd=directory, check=True, timeout=600)
    with np.load(directory / "events.npz") as arrays:
        return {name: arrays[name] for name in ("t", "x", "y", "p")}


@pytest.mark.gpu
@pytest.mark.parametrize(
    "arguments", [("interpolator:=rigid",), ("interpolator:=splat", "colour:=true"), ("interpolator:=none",)], ids=str
)
def test_the_events_are_the_same_whether_arrays_stay_on_the_gpu_or_not(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    split, composed = (events_of(tmp_path / name, *arguments, *how) for name, how in
                       (("split", ()), ("composed", ("--compose",))))  # fmt: skip
    assert len(split["t"]) > 1000
    for name, values in split.items():
        np.testing.assert_array_equal(composed[name], values, err_msg=name)


def test_a_node_that_replaces_another_may_be_on_another_device():
    """A run that begins anew may have nodes with other parameters."""
    host = Host(Watcher("watcher", {"device": "cpu"}), NodePlan("watcher", "", {}, "p"), Join([]))
    assert host.takes("depth", wp.get_device("cpu"))
    host.rewind()
    host.node = Watcher("watcher", {})
    host.node.params = {"device": None}
    assert not host.takes("depth", wp.get_device("cpu"))
