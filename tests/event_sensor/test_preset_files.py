"""Presets in files: a graph takes them as it takes names, and what is wrong in one names the file and the remedy."""

import pytest

from evis.cli import main
from evis.config.params import ParamError
from nodes.event_sensor.parameters import resolve_sensor


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("# of my camera\nthreshold_on: 0.31\nthreshold_off: 0.33\nrefractory_us: 450\n")
    return path


def test_a_file_is_a_preset_and_given_values_win(mine):
    values = resolve_sensor("sensor", str(mine), {"refractory_us": 200})
    assert (values["threshold_on"], values["threshold_off"], values["refractory_us"]) == (0.31, 0.33, 200)
    assert values["leak_rate"] == 0  # what it does not say is the ideal sensor's


def test_a_threshold_that_is_given_is_that_of_both_sides(mine):
    values = resolve_sensor("sensor", str(mine), {"threshold": 0.5})
    assert (values["threshold"], values["threshold_on"], values["threshold_off"]) == (0.5, None, None)
    values = resolve_sensor("sensor", str(mine), {"threshold": 0.5, "threshold_on": 0.4})
    assert (values["threshold_on"], values["threshold_off"]) == (0.4, None)


@pytest.mark.parametrize("model, refused", [("evis", True), ("evis-paper", True), ("esim", False)])
def test_a_dark_level_that_the_least_light_hides_is_refused(model, refused):
    """With 1e-9 a step from 0 to 1 has ln(1e9) / 0.2 = 103 events; as 2^-24 took its place it had 83."""
    if not refused:
        assert resolve_sensor("sensor", "ideal", {"model": model, "dark_level": 1e-9})["dark_level"] == 1e-9
        return
    with pytest.raises(ParamError, match=r"sensor: dark_level is 1e-09, below 5\.96e-08 W.* give 0 or more"):
        resolve_sensor("sensor", "ideal", {"model": model, "dark_level": 1e-9})
    for dark in (0.0, 6e-8):
        assert resolve_sensor("sensor", "ideal", {"model": model, "dark_level": dark})["dark_level"] == dark


@pytest.mark.parametrize("given", [{"threshold": 0.005}, {"threshold_off": 0.009}, {"threshold_floor": 0.3}])
def test_a_threshold_below_what_mismatch_leaves_is_refused(given):
    """Every pixel would have the floor, 0.01, in its place."""
    with pytest.raises(ParamError, match=r"sensor: .* threshold_floor, 0\.\d+, but the threshold is 0\.\d+; give"):
        resolve_sensor("sensor", "dvs128", given)
    assert resolve_sensor("sensor", "dvs128", {**given, "threshold_mismatch": 0.0})


def test_errors_name_the_file(mine, tmp_path):
    with pytest.raises(ParamError, match=r"there is no file .*none\.yaml"):
        resolve_sensor("sensor", str(tmp_path / "none.yaml"), {})
    mine.write_text("treshold: 0.2\n")
    with pytest.raises(ParamError, match=r"mine\.yaml.*treshold.*did you mean 'threshold'"):
        resolve_sensor("sensor", str(mine), {})


def test_a_graph_runs_with_it_and_says_so(mine, tmp_path, capsys, monkeypatch):
    """The camera's information in the bag has the file's values, wherever the nodes run."""
    import evis

    monkeypatch.chdir(tmp_path)
    sim = evis.Simulation("spinning_disk", preset="mine.yaml", width=32, height=24, outputs=["events", "info"])
    about = sim.reset().info.sensor
    sim.close()
    assert about["sensor"] == "mine.yaml" and about["threshold_on"] == 0.31 and about["refractory_us"] == 450
    assert about["preset"] == str(mine)
    assert main(["launch", "spinning_disk", "preset:=none.yml", "--explain"]) != 0
    assert "there is no file none.yml" in capsys.readouterr().err
