"""A GPU's kernels compiled in processes beside this one: the same bytes, and no kernel lost with a process."""

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import warp as wp

from evis.gpu import compilers
from evis.gpu.compilers import FUNCTION, NAMES, Compilers, line_of, share_compilers
from evis.warp_start import start_warp
from nodes.interpolator.rigid.look_up.gather_kernels import make_place

start_warp()
share_compilers()


def compiled(folder: Path, monkeypatch: pytest.MonkeyPatch, cores: int) -> bytes:
    """The code of a kernel for an H200, on a machine of so many cores."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
    wp.compile_aot_module(make_place(1).module, arch=90, module_dir=folder)
    (made,) = [path for path in folder.iterdir() if path.suffix in (".ptx", ".cubin")]
    return made.read_bytes()


@pytest.fixture
def asked(monkeypatch):
    """Answers of processes, in the place of the thread's own compiler."""
    found: list[int | None] = []
    fresh = Compilers()
    ask = fresh.ask

    def note(library: str, line: bytes) -> int | None:
        found.append(ask(library, line))
        return found[-1]

    monkeypatch.setattr(fresh, "ask", note)
    monkeypatch.setattr(compilers, "_compilers", fresh)
    yield found
    if fresh._own is not None:
        fresh._own.close()


def test_code_is_that_of_this_process(tmp_path, monkeypatch, asked):
    alone = compiled(tmp_path / "alone", monkeypatch, 1)
    assert asked == []
    assert compiled(tmp_path / "beside", monkeypatch, 16) == alone
    assert asked == [0]


def test_a_process_that_ends_is_replaced_and_at_last_done_without(tmp_path, monkeypatch, asked):
    first = compiled(tmp_path / "first", monkeypatch, 16)
    own = compilers._compilers._own
    assert own is not None
    own._process.kill()
    own._process.wait()
    assert compiled(tmp_path / "second", monkeypatch, 16) == first
    assert asked == [0, 0]
    monkeypatch.setattr(compilers.sys, "executable", "/bin/false")
    compilers._compilers._own._process.kill()
    assert compiled(tmp_path / "third", monkeypatch, 16) == first
    assert asked == [0, 0, None]


def test_what_cannot_be_compiled_is_told_as_ever(tmp_path, monkeypatch, asked, capfd):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(16)))

    @wp.func_native("return no_such_thing;")
    def broken(x: wp.float32) -> wp.float32: ...

    @wp.kernel(module="unique", enable_backward=False)
    def use(x: wp.array(dtype=float)):
        x[0] = broken(x[1])

    with pytest.raises(Exception, match="build failed"):
        wp.compile_aot_module(use.module, arch=90, module_dir=tmp_path)
    assert len(asked) == 1 and asked[0] not in (0, None)
    assert "no_such_thing" in "".join(capfd.readouterr())


def test_it_ends_with_who_asks_and_not_by_ctrl_c():
    beside = str(Path(compilers.__file__).with_name("compiler_process.py"))
    with subprocess.Popen(
        [sys.executable, "-I", "-S", beside, "libc.so.6", "labs"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        for value in (-3, 70_000):
            process.stdin.write(json.dumps({"types": ["size"], "values": [value % 2**64]}).encode() + b"\n")
            process.stdin.flush()
            assert int(process.stdout.readline()) == abs(value)
            process.send_signal(signal.SIGINT)
        process.stdin.close()
        until = time.monotonic() + 60
        while process.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        assert process.returncode == 0


def test_what_no_line_can_hold_is_compiled_here():
    types = [ctypes.c_char_p, ctypes.c_bool, ctypes.c_size_t, ctypes.POINTER(ctypes.c_char_p)]
    assert set(types[:3]) <= set(NAMES)
    assert json.loads(line_of(types, (b"a\n\xc3\xa9", True, 0, None))) == {
        "types": ["text", "bool", "size", "none"],
        "values": ["a\n\u00e9", True, 0, None],
    }
    assert line_of(types, (b"a", True, 1, (ctypes.c_char_p * 1)(b"part"))) is None


def test_it_is_shared_once():
    from warp._src import context

    before = getattr(context.runtime.core, FUNCTION)
    share_compilers()
    assert getattr(context.runtime.core, FUNCTION) is before
