"""`evis events fit` from a file to a preset that a sensor takes, and its errors."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from evis.cli import main
from nodes.event_sensor.parameters import resolve_sensor

sys.path.insert(0, str(Path(__file__).parents[1] / "event_sensor" / "fit"))
import wheel_film as film


@pytest.mark.slow
def test_a_recording_becomes_a_preset(tmp_path, capsys):
    t, x, y, p = film.record(threshold=0.3, bandwidth_hz=60.0, refractory_us=500, shot_rate=1.0, seed=5)
    recording = tmp_path / "wheel.npz"
    np.savez(recording, t=t, x=x, y=y, p=p, width=film.SIZE[1], height=film.SIZE[0])
    out, picture = tmp_path / "mine.yaml", tmp_path / "fit.png"
    asked = ["events", "fit", str(recording), "--scene", "wheel", "--out", str(out), "--png", str(picture), "--json"]
    assert main(asked) == 0
    report = json.loads(capsys.readouterr().out)
    values = resolve_sensor("sensor", str(out), {})
    for name, value in report["values"].items():
        assert values[name] == pytest.approx(value, rel=1e-3), name
    assert abs(values["threshold_on"] / 0.3 - 1) < 0.1
    assert report["assumed"]["contrast"] == 2.1 and report["deviation"]["threshold_on"] > 0.05
    one = report["recordings"][0]
    assert one["fitted"] and all(abs(value) < 0.2 for value in one["off_by"].values())
    text = out.read_text()
    assert "Assumed: a contrast ln(white / black) of 2.1 +- 0.4" in text and "wheel.npz" in text
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "more, code, text",
    [
        (["--out", "mine.txt"], 2, "a preset is a .yaml file"),
        (["--out", "nowhere/mine.yaml"], 2, "folder does not exist"),
        (["--contrast-error", "0.2"], 2, "goes with --contrast"),
        (["--contrast", "0"], 2, "above 0"),
        (["--contrast", "80"], 1, "it is 0.05 to 12, being ln(white / black)"),
        (["--contrast", "0.001"], 1, "it is 0.05 to 12, being ln(white / black)"),
        (["--lux", "1e-6"], 1, "in 1e-06 lux the black has a radiance of 2.2e-10"),
        (["--scene", "whel"], 2, "whel"),
        ([], 1, "too few for a turning wheel"),
    ],
)
def test_errors_are_one_line(tmp_path, capsys, more, code, text):
    recording = tmp_path / "few.npz"
    np.savez(recording, t=np.arange(9) * 1000, x=np.arange(9, dtype=np.uint16), y=np.zeros(9, np.uint16),
             p=np.ones(9, np.uint8), width=20, height=20)  # fmt: skip
    try:
        got = main(["events", "fit", str(recording), *more])
    except SystemExit as end:
        got = end.code
    error = capsys.readouterr().err
    assert got == code and text in error and "Traceback" not in error
