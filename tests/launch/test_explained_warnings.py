"""--explain says what the run will warn of at its start, in the run's own words."""

import pytest

from evis.cli import main

SCENE = """
cameras: {cam0: {fov: 40 deg, position: [0, 0, 2], look_at: [0, 0, 0], up: [0, 1, 0]}}
materials: {grey: {albedo: 0.5}}
world: [{shape: box, material: grey, size: [1, 1, 0.1]}]
lights: {lamp: {kind: point, position: [0, 0, 2], intensity: 5, flicker: {kind: sine, frequency: RATE, depth: 0.5}}}
"""


@pytest.mark.parametrize("rate", [20, 200])
def test_a_lamp_that_flickers_too_fast_is_told_beforehand(tmp_path, rate, capfd):
    path = tmp_path / "lamp.yaml"
    path.write_text(SCENE.replace("RATE", str(rate)))
    words = ["launch", str(path), "width:=32", "height:=24", "--no-view"]
    assert main([*words, "--explain"]) == 0
    explained = capfd.readouterr().out
    assert main([*words, "--duration", "0.05", "--compose"]) == 0
    out, err = capfd.readouterr()
    line = "renderer: light 'lamp' flickers at 200 Hz and frames come at 240 Hz"
    assert (f"warnings\n  {line}" in explained) == (rate == 200)
    assert (line.replace("renderer: ", "renderer: warning: ") in out + err) == (rate == 200)
