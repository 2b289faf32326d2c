"""`evis events render --style time-surface` and the rate histogram of `evis events info`."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest

from evis.bag.writer import BagWriter
from evis.cli import events as command
from evis.cli.events.info import FIRST_BIN_NS, RATE_BINS
from evis.events import Events, open_recording, open_writer
from evis.events.time_histogram import TimeHistogram
from evis.media.pictures.event_pictures import ON_WHITE, TimeSurface, windows
from msgs.camera import EventPacket
from msgs.header import Header

MS = 1_000_000


def call(capsys, *arguments) -> dict:
    parser = argparse.ArgumentParser(prog="evis events")
    command.add_arguments(parser)
    assert command.run(parser.parse_args([*map(str, arguments), "--json"])) == 0
    return json.loads(capsys.readouterr().out)


def write(path, t, x, y, p, size=(9, 7)):
    with open_writer(path, *size) as writer:
        writer.write(Events.of(t, x, y, p))


def test_a_surface_fades_with_the_age_of_the_last_event():
    """Shade = white + (colour - white) exp(-age / tau), to the nearest of 24 shades."""
    surface = TimeSurface(9, 7, 10 * MS)
    surface.draw(Events.of(np.array([0, 4]) * MS, [1, 2], [3, 3], [1, 1]), 5 * MS)
    picture = surface.draw(Events.of(np.array([6, 20]) * MS, [1, 8], [3, 6], [0, 1]), 20 * MS)
    for (x, y), colour, age in (((1, 3), ON_WHITE.off, 14), ((2, 3), ON_WHITE.on, 16), ((8, 6), ON_WHITE.on, 0)):
        expected = 255 + (np.array(colour) - 255) * np.exp(-age / 10)
        np.testing.assert_allclose(picture[y, x], expected, atol=255 / 48 + 1)
    rest = np.ones((7, 9), bool)
    rest[[3, 3, 6], [1, 2, 8]] = False
    assert (picture[rest] == 255).all()
    assert (surface.draw(Events.empty(), 10**15) == 255).all()


def test_events_outside_and_ahead_of_the_picture():
    """A recording may hold coordinates beyond its size, and times after the window: no wrap, no colour beyond full."""
    surface = TimeSurface(2, 2, MS)
    picture = surface.draw(Events.of([5 * MS, 9 * MS], [0, 7], [0, 0], [1, 1]), 0)
    assert picture[0, 0].tolist() == list(ON_WHITE.on) and (picture[1] == 255).all()


@pytest.mark.parametrize("name", ["a.gif", "a.png"])
def test_render_time_surface(name, capsys, tmp_path):
    """An event fades from picture to picture; the GIF keeps every shade."""
    from PIL import Image

    # the sheet writes times at its top left
    write(tmp_path / "a.npz", np.array([0, 35]) * MS, [1, 98], [32, 36], [1, 0], (99, 40))
    options = ["--style", "time-surface", "--dt", 20, "--tau", 20]
    assert call(capsys, "render", tmp_path / "a.npz", tmp_path / name, *options)["pictures"] == 2
    with Image.open(tmp_path / name) as image:
        if name == "a.png":
            pictures = [np.asarray(image)[:, :99], np.asarray(image)[:, 103:]]
        else:
            pictures = []
            for i in range(image.n_frames):
                image.seek(i)
                pictures.append(np.asarray(image.convert("RGB")))
    shade = [255 + (np.array(ON_WHITE.on) - 255) * np.exp(-n) for n in (1, 2)]
    corner = (slice(35, 37), slice(97, 99))
    for picture, expected in zip(pictures, shade):
        np.testing.assert_allclose(picture[32, 1], expected, atol=255 / 48 + 1)
    assert (pictures[0][corner] == 255).all()
    assert (pictures[1][corner] != 255).any(2).tolist() == [[False, False], [False, True]]


def test_tau_needs_the_surface(tmp_path, capsys):
    """One clear error each."""
    write(tmp_path / "a.npz", [0], [1], [2], [1])
    with pytest.raises(ValueError, match="--tau goes with --style time-surface"):
        call(capsys, "render", tmp_path / "a.npz", tmp_path / "a.gif", "--tau", 5)
    with pytest.raises(ValueError, match="--tau is 0 ms"):
        call(capsys, "render", tmp_path / "a.npz", tmp_path / "a.gif", "--tau", 0, "--style", "time-surface")
    assert not (tmp_path / "a.gif").exists()


def test_histogram_is_numpys(capsys, tmp_path):
    """Counts of a random stream, whatever the blocks."""
    rng = np.random.default_rng(12)
    t = np.sort(rng.integers(10**17, 10**17 + 3 * 10**9, 20_000))
    histogram = TimeHistogram(RATE_BINS, FIRST_BIN_NS)
    for part in np.array_split(t, [1, 7, 3000, 3000, 15_000]):
        histogram.add(part)
    edges = t[0] + histogram.bin_ns * np.arange(65)
    assert histogram.counts() == np.histogram(t, edges)[0][: len(histogram.counts())].tolist()
    assert 32 <= len(histogram.counts()) <= 64 and sum(histogram.counts()) == len(t)
    write(tmp_path / "a.npz", t, t % 9, t % 7, t % 2)
    assert call(capsys, "info", tmp_path / "a.npz")["rate_histogram"] == {
        "bin_ns": histogram.bin_ns,
        "counts": histogram.counts(),
    }


def test_histogram_of_extremes():
    """Nothing, one event, the ends of int64, and times out of order."""
    empty = TimeHistogram(RATE_BINS, FIRST_BIN_NS)
    empty.add(np.empty(0, np.int64))
    assert empty.counts() == []
    ends = TimeHistogram(RATE_BINS, FIRST_BIN_NS)
    ends.add(np.array([-(2**63)], np.int64))
    assert ends.counts() == [1]
    ends.add(np.array([2**63 - 1], np.int64))
    assert sum(ends.counts()) == 2 and ends.counts()[0] == ends.counts()[-1] == 1
    back = TimeHistogram(RATE_BINS, FIRST_BIN_NS)
    back.add(np.array([5000, 4000, 6000, 5500]))
    assert back.counts() == [3, 1]


def test_info_for_people_draws_the_rate(capsys, tmp_path):
    """One bar per bin, blank where there is nothing, the highest where there is most."""
    t = np.concatenate([np.zeros(50, int), np.full(100, 3000), [9000]])
    write(tmp_path / "a.npz", t, t * 0, t * 0, t * 0)
    parser = argparse.ArgumentParser(prog="evis events")
    command.add_arguments(parser)
    command.run(parser.parse_args(["info", str(tmp_path / "a.npz")]))
    line = next(s for s in capsys.readouterr().out.splitlines() if s.startswith("rate "))
    bars = line.split("|")[1]
    assert len(bars) == 10 and [i for i, b in enumerate(bars) if b != " "] == [0, 3, 9]
    assert bars[3] == "█" and bars[9] == "▁" and "at most 100 Mev/s, a bar is 1 us" in line


@pytest.mark.parametrize(("dt", "begin", "end"), [(20, 0, None), (20, 40, 300), (70, 0, None), (1000, 0, None)])
def test_episodes_of_a_bag_are_drawn_one_behind_the_other(dt, begin, end, capsys, tmp_path):
    """Times begin anew twice, with episodes of 120, 110 and 200 ms: an event every 10 ms, each in its own column."""
    with BagWriter(tmp_path / "run.mcap") as bag:
        for k, (episode, i) in enumerate((e, i) for e, n in enumerate((13, 12, 21)) for i in range(n)):
            stamp, rest = i * 10 * MS, {"x": np.array([k], np.uint16), "y": np.zeros(1, np.uint16)}
            packet = EventPacket(
                Header(stamp + 10 * MS, k, episode=episode), np.array([0, 1]), t=np.array([stamp]), **rest,
                p=np.ones(1, np.uint8), width=60, height=4,
            )  # fmt: skip
            bag.write("/cam0/events", packet)
    times = np.concatenate([np.arange(0, 121, 10), np.arange(120, 231, 10), np.arange(230, 431, 10)])
    last = 430 if end is None else end - 1
    with open_recording(tmp_path / "run.mcap") as recording:
        found = list(windows(recording, dt * MS, begin * MS, None if end is None else end * MS))
    assert [start for start, _ in found] == [start * MS for start in range(begin, last + 1, dt)]
    for start, events in found:
        stop = min(start + dt * MS, (last + 1) * MS)
        inside = (times * MS >= start) & (times * MS < stop)
        assert events.x.tolist() == np.flatnonzero(inside).tolist()
        assert events.t.tolist() == (times[inside] * MS).tolist()
    made = call(capsys, "render", tmp_path / "run.mcap", tmp_path / "a.gif", "--dt", 20)
    assert made["pictures"] == 22
