"""--explain says what the run will warn of at its start, in the run's own words."""

import pytest

import evis
from evis.cli import main

SCENE = """
cameras: {cam0: {fov: 40 deg, position: [0, 0, 2], look_at: [0, 0, 0], up: [0, 1, 0]}}
materials: {grey: {albedo: 0.5}}
world: [{shape: box, material: grey, size: [1, 1, 0.1]}]
lights: {lamp: {kind: point, position: [0, 0, 2], intensity: 5, flicker: {kind: sine, frequency: RATE, depth: 0.5}}}
"""


@pytest.mark.parametrize("word", ["crossing:=cubic", "crossing:=linear", "defocus:=0.5", "model:=v2e"])
def test_samples_that_the_sensor_does_not_take_are_told_beforehand(word, capfd):
    """Curves, blur and other event models are for frames alone; a line through samples is not told of."""
    words = ["launch", "spinning_disk", word, "time_tolerance:=0.001", "width:=32", "height:=24", "--no-view"]
    assert main([*words, "--explain"]) == 0
    explained = capfd.readouterr().out
    assert main([*words, "--duration", "0.05", "--compose"]) == 0
    out, err = capfd.readouterr()
    line = "event_sensor: time_tolerance is for samples between frames, and "
    assert (f"warnings\n  {line}" in explained) == (word != "crossing:=linear")
    assert (line.replace("sensor: ", "sensor: warning: ") in out + err) == (word != "crossing:=linear")


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


@pytest.mark.parametrize("image", ["true", "false"])
def test_a_lamp_that_images_do_not_follow_is_told_beforehand(tmp_path, image, capfd):
    """Samples between frames follow it for events; a 12.5 ms image under 240 Hz would have the frames' phase alone."""
    path = tmp_path / "lamp.yaml"
    path.write_text(SCENE.replace("RATE", "240"))
    words = ["launch", str(path), "time_tolerance:=0.0001", f"image:={image}", "width:=32", "height:=24", "--no-view"]
    assert main([*words, "--explain"]) == 0
    explained = capfd.readouterr().out
    line = "frame_camera: images are of frames alone: light 'lamp' flickers at 240 Hz and frames come at 240 Hz"
    assert (line in explained) == (image == "true") and "renderer: light" not in explained


def test_images_without_events_warn_of_a_lamp_too(tmp_path):
    path = tmp_path / "lamp.yaml"
    path.write_text(SCENE.replace("RATE", "240"))
    with (
        pytest.warns(evis.SimulationWarning, match="images are of frames alone: light 'lamp' flickers at 240 Hz"),
        evis.Simulation(str(path), time_tolerance=1e-4, width=32, height=24, outputs=["image"]),
    ):
        pass


CAMERA = "{fov: 40 deg, position: [0, 0, 2], look_at: [0, 0, 0], up: [0, 1, 0]}"
CAMERAS = f"cameras: {{a: {CAMERA}, b: {CAMERA}, c: {CAMERA}}}"


@pytest.mark.parametrize("rates", ["", "camera_rate:=b=15"])
def test_what_all_cameras_show_falsely_is_told_once(tmp_path, rates, capfd):
    """With the names of their renderers; a camera with a rate of its own, which is enough or not, has its own line."""
    path = tmp_path / "lamp.yaml"
    path.write_text(SCENE.replace(SCENE.splitlines()[1], CAMERAS).replace("RATE", "200"))
    words = ["launch", str(path), "width:=32", "height:=24", "--no-view", *filter(None, [rates])]
    assert main([*words, "--explain"]) == 0
    explained = capfd.readouterr().out
    assert main([*words, "--duration", "0.02", "--compose"]) == 0
    out, err = capfd.readouterr()
    others = "renderer_c" if rates else "renderer_b, renderer_c"
    for text in (explained, out + err):
        lines = [line for line in text.splitlines() if "light 'lamp' flickers at 200 Hz" in line]
        assert sum(line.endswith(f"(the same in {others})") for line in lines) == 1
        assert len(lines) == (1 if not rates else len({line.partition("light")[2] for line in lines}))


@pytest.mark.parametrize("envs", [1, 2])
def test_topics_that_a_bag_will_not_have_are_told_beforehand(envs, tmp_path, capfd):
    """There are no inertial samples of several environments."""
    words = ["launch", "spinning_disk", f"envs:={envs}", "width:=32", "height:=24", "--no-view"]
    words += ["--record", str(tmp_path / "a.mcap"), "--record-topics", "/cam0/imu,/cam0/depth"]
    assert main([*words, "--explain"]) == 0
    explained = capfd.readouterr().out
    assert main([*words, "--duration", "0.05", "--compose"]) == 0
    out, err = capfd.readouterr()
    line = "recorder: no node of this graph publishes a topic like '/cam0/imu'"
    assert (f"warnings\n  {line}" in explained) == (envs == 2)
    assert (line.replace("recorder: ", "recorder: warning: ") in out + err) == (envs == 2)
    with evis.open(tmp_path / "a.mcap") as bag:
        assert any("imu" in name for name in bag.topics) == (envs == 1)
        assert any("depth" in name for name in bag.topics)
