"""Arguments that are parameters of nodes: what a launch file takes from them, passes on, and cannot take."""

from __future__ import annotations

from pathlib import Path

import pytest

from evis.config.document import LaunchError
from evis.launch.expand import expand
from evis.launch.files import LaunchFile, load
from nodes.imu.node import ImuNode

OPTIONS = {"duration": None, "record": None, "record_topics": [], "record_sync": False, "view": False}
IMU = "imu: {type: imu, foreach: {camera: [a]}, lookup: {rate: [a=5]}, params: {from: args, gravity: 3}}"


def read(folder: Path, args: str, nodes: str = IMU) -> LaunchFile:
    path = folder / "own.yaml"
    path.write_text(f"args: {args}\nnodes:\n  {nodes}\n")
    return load(path)


def test_a_node_declares_its_arguments_and_gets_them(tmp_path: Path) -> None:
    """But for what the file sets; a variable of `lookup` is no argument, though a parameter is called like it."""
    launch = read(tmp_path, "{of: [imu], gyro: {of: imu.gyro_noise, help: own}, seed: {default: 4}}")
    assert launch.arguments.keys() == {*ImuNode.PARAMS, "gyro"} - {"gravity", "camera", "rate"}
    assert launch.arguments["accel_noise"].param == ImuNode.PARAMS["accel_noise"]
    gyro = launch.arguments["gyro"].param
    assert (gyro.unit, gyro.help, gyro.maximum) == ("rad/s/sqrt(Hz)", "own", ImuNode.PARAMS["gyro_noise"].maximum)
    node = expand(launch, {"accel_noise": "0.5"}, OPTIONS).nodes[0]
    assert node.params["accel_noise"] == 0.5 and node.params["seed"] == 4
    assert (node.params["camera"], node.params["gravity"]) == ("a", 3) and "rate" not in node.params


@pytest.mark.parametrize(
    ("args", "nodes", "told"),
    [
        ("{of: [imv]}", IMU, "1: `nodes:` has no 'imv'; did you mean 'imu'?"),
        ("{a: {of: imu.gyro_nois}}", IMU, "1: node 'imu' has no parameter 'gyro_nois'; did you mean 'gyro_noise'?"),
        ("{of: [own]}", "own: {type: 'mine:Node'}", "3: `of` and `from` are for node types that come with evis"),
        ("{width: {default: 1, by: own.preset}}", IMU, "1: `nodes:` has no 'own'"),
    ],
)
def test_what_cannot_be_taken_is_said_with_its_line(tmp_path: Path, args: str, nodes: str, told: str) -> None:
    """And no code of others is loaded for it."""
    with pytest.raises(LaunchError) as error:
        read(tmp_path, args, nodes)
    assert f"own.yaml:{told}" in str(error.value)
