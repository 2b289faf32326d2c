"""`evis events measure` on files."""

from __future__ import annotations

import argparse
import io
import json
import sys

import numpy as np
import pytest
from rotating_events import texture, turning_edges

from evis.cli import events as command
from evis.events import Events, open_writer


def parse(*arguments: object) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="evis events")
    command.add_arguments(parser)
    return parser.parse_args(["measure", *(str(a) for a in arguments)])


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """45 rad/s, 0.4 s, three revolutions."""
    path = tmp_path_factory.mktemp("measure") / "turning.npz"
    with open_writer(path, 120, 100) as writer:
        writer.write(Events.of(*turning_edges(lambda t: 45 * t, 0.4, texture(count=12))))
    return path


class Terminal(io.StringIO):
    """Keeps what is drawn."""

    def isatty(self) -> bool:
        return True


def test_json_and_picture(turning, capsys, tmp_path, monkeypatch):
    """The keys that scripts rely on; a picture that is one; a bar that also moves during the fit."""
    picture = tmp_path / "speed.png"
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert command.run(parse(turning, "--json", "--size", "120x100", "--png", picture)) == 0
    assert "rotation, stretch 1: speed" in sys.stderr.getvalue()
    result = json.loads(capsys.readouterr().out)
    assert result["rotation"]["omega_rad_s"] == pytest.approx(45, rel=0.01)
    assert 0.5 <= result["rotation"]["confidence"] <= 1
    t = [at for at, _ in result["rotation"]["series"]]
    assert t == sorted(t) and result["t_first_ns"] <= t[0] and t[-1] <= result["t_last_ns"]
    assert result["event_rate_hz"] == pytest.approx(result["events"] / result["duration_s"])
    assert {"rate_hz", "hot_pixels"} <= set(result["noise"]) and result["sharpness"]["dispersion"] > 1
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_for_people(turning, capsys):
    """One line per measure, none of them a long list."""
    assert command.run(parse(turning, "--no-rotation")) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("event_rate_hz") for line in lines) and max(map(len, lines)) < 400


def test_recording_without_events(tmp_path, capsys):
    """No event: no rate and no speed, and no error."""
    path = tmp_path / "empty.npz"
    empty = np.empty(0, np.int64)
    with open_writer(path, 120, 100) as writer:
        writer.write(Events.of(empty, empty, empty, empty))
    assert command.run(parse(path, "--json")) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["events"] == 0 and result["event_rate_hz"] is None and result["rotation"]["omega_rad_s"] is None


def test_wrong_use(turning, tmp_path):
    """One line that says what to do."""
    with pytest.raises(ValueError, match="name a recording, or --topic"):
        command.run(parse())
    with pytest.raises(ValueError, match=r"writes a \.png file"):
        command.run(parse(turning, "--png", "speed.jpg"))
    with pytest.raises(ValueError, match="does not exist; make it first"):
        command.run(parse(turning, "--png", tmp_path / "nowhere" / "a.png"))
    with pytest.raises(SystemExit):
        parse(turning, "--window", "0")
