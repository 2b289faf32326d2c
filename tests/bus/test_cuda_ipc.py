"""What names arrays on a GPU to another process: where they are, and descriptors that are none."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import msgpack
import numpy as np
import pytest
import warp as wp

from evis.bus.memory.cuda_ipc import KIND, MOST_INLINE, ArrayPlaces, ImportedSlots, uuid_of, without_rows
from evis.bus.memory.device import DevicePool
from evis.gpu.driver import HANDLE_BYTES
from msgs.camera import Keyframe, Motion
from msgs.codec import decode_header, pack_header
from msgs.fields import MessageError
from msgs.header import Header

SIZE = 4096


@pytest.fixture
def memory() -> Any:
    return wp.zeros(SIZE, dtype=wp.uint8, device="cpu")


def keyframe(memory: Any, at: int = 0, envs: int = 1) -> Keyframe:
    radiance: Any = wp.array(ptr=memory.ptr + at, shape=(envs, 3, 4), dtype=wp.vec3, device="cpu")
    return Keyframe(Header(7), np.full(envs, 5, np.int32), radiance=radiance)


def test_arrays_of_a_block_are_told_by_their_offsets(memory: Any) -> None:
    placed = ArrayPlaces.of(keyframe(memory, 64), memory.ptr, SIZE)
    assert placed is not None
    assert placed.places == {"radiance": [64, 3]}
    assert placed.inline == {"episodes": np.array([5], np.int32).tobytes()}
    assert placed.forms["radiance"].shape == (1, 3, 4, 3) and placed.forms["radiance"].nbytes == 144


@pytest.mark.parametrize("at, fits", [(-4, False), (SIZE - 144, True), (SIZE - 140, False), (SIZE + 64, False)])
def test_arrays_that_are_not_wholly_in_the_block_go_another_way(memory: Any, at: int, fits: bool) -> None:
    assert (ArrayPlaces.of(keyframe(memory, at), memory.ptr, SIZE) is not None) == fits


def test_large_arrays_of_the_host_go_another_way(memory: Any) -> None:
    rest = np.zeros(MOST_INLINE // 4, np.int32)
    message = keyframe(memory)
    message.episodes = rest
    message.radiance = wp.zeros((len(rest), 0, 4), dtype=wp.vec3, device="cpu")  # type: ignore[assignment]
    assert ArrayPlaces.of(message, memory.ptr, SIZE) is not None
    message.episodes = np.zeros(len(rest) + 1, np.int32)
    message.radiance = wp.zeros((len(rest) + 1, 0, 4), dtype=wp.vec3, device="cpu")  # type: ignore[assignment]
    assert ArrayPlaces.of(message, memory.ptr, SIZE) is None


def test_who_reads_no_arrays_needs_no_gpu(memory: Any) -> None:
    placed = ArrayPlaces.of(keyframe(memory), memory.ptr, SIZE)
    assert placed is not None
    forms: Any = placed.forms
    head = decode_header(pack_header(keyframe(memory), forms, {KIND: ["anything"]}), Keyframe)
    message = without_rows(head)
    assert isinstance(message, Keyframe) and message.header.stamp_ns == 7
    assert message.episodes.shape == (0,) and message.image.shape == (0, 3, 4, 3)


def test_a_cpu_is_no_gpu() -> None:
    assert uuid_of("cpu") == "" and uuid_of("") == ""


def test_slots_of_the_host_are_shown_to_nobody() -> None:
    pool, device = DevicePool("/cam0/motion"), wp.get_device("cpu")
    array = pool.loan(device, {"motion": ((1, 4, 5), wp.vec2)})["motion"]
    message = Motion(Header(0), array)
    slot = pool.claim(message)
    assert slot is not None and slot.exported is None and slot.placed(message) is None


@pytest.mark.gpu
@pytest.mark.parametrize(
    "change, what",
    [
        ({0: "GPU-of-another-machine"}, "are on GPU GPU-of-another-machine"),
        ({1: "1"}, "describes no arrays"),
        ({2: -1}, "are on GPU"),
        ({3: b"short"}, "are on GPU"),
        ({3: bytes(HANDLE_BYTES)}, "cannot be opened"),
        ({5: {}}, "no place in device memory"),
        ({5: {"motion": [0, 3]}}, "is not within"),
        ({5: {"motion": [1 << 40, 2]}}, "is not within"),
        ({5: {"motion": [-8, 2]}}, "no place in device memory"),
        ({5: {"motion": "here"}}, "no place in device memory"),
        ({6: {"motion": b"123"}}, "does not fit"),
    ],
)
def test_a_descriptor_that_is_none_is_refused(change: dict[int, Any], what: str) -> None:
    """In the process of the publisher itself, which cannot open its own memory: nothing comes to that."""
    device: Any = wp.get_device("cuda:0")
    pool = DevicePool("/cam0/motion")
    message = Motion(Header(0), pool.loan(device, {"motion": ((1, 4, 5), wp.vec2)}, exported=True)["motion"])
    slot = pool.claim(message)
    assert slot is not None and slot.exported is not None
    placed = slot.placed(message)
    assert placed is not None
    body = msgpack.unpackb(placed.packed(message, slot.exported))
    for index, value in change.items():
        body["extra"][KIND][index] = value
    head = decode_header(msgpack.packb(body), Motion)
    slots = ImportedSlots("cuda:0")
    if 3 not in change:
        slots._open[body["extra"][KIND][1]] = slot._memory, wp.Event(device)
    with pytest.raises(MessageError, match=what):
        slots.attach(head, head.extra[KIND])


CHILD = """
import sys
import msgpack
from evis.bus.memory.cuda_ipc import KIND, ImportedSlots
from msgs.camera import Motion
from msgs.codec import decode_header
from msgs.fields import MessageError
slots = ImportedSlots("cuda:0")
for line in sys.stdin:
    head = decode_header(bytes.fromhex(line), Motion)
    try:
        print(slots.attach(head, head.extra[KIND]).motion.numpy().sum(), flush=True)
    except MessageError as error:
        print(error, flush=True)
"""


@pytest.mark.gpu
def test_another_process_opens_a_slot_once() -> None:
    device: Any = wp.get_device("cuda:0")
    pool = DevicePool("/cam0/motion")
    message = Motion(Header(0), pool.loan(device, {"motion": ((1, 4, 5), wp.vec2)}, exported=True)["motion"])
    message.motion.fill_(wp.vec2(1.0, 2.0))  # type: ignore[attr-defined]
    slot = pool.claim(message)
    assert slot is not None and slot.exported is not None
    placed = slot.placed(message)
    assert placed is not None
    slot.exported.written()
    packed = placed.packed(message, slot.exported)
    lines = "\n".join([packed.hex()] * 3)
    child = [sys.executable, "-c", CHILD]
    said = subprocess.run(child, input=lines, capture_output=True, text=True, timeout=120)
    assert said.returncode == 0, said.stderr
    assert said.stdout.splitlines() == ["60.0"] * 3
