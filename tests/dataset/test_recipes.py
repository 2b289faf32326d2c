"""The recipes that come with evis: each is planned at the ends of its ranges, and a tiny sequence of each is made.

Its labels are compared with poses in closed form, depth and meshes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import evis
from evis.config import paths
from evis.dataset.errors import DatasetError
from evis.dataset.layouts import reader_of
from evis.dataset.making.make import check
from evis.dataset.making.worker import Maker
from evis.dataset.recipe import Plan
from evis.dataset.recipe_file import find_recipe, read_recipe
from evis.dataset.report.tiles import tiles
from evis.geometry import pinhole, se3
from evis.launch.target import read_target
from evis.scene import load_scene
from evis.scene.load import drawn_places, scene_args

SIZE = {"width": 64, "height": 48}
TINY: dict[str, dict[str, Any]] = {
    "flying_shapes": {"shapes": 4},
    "warehouse": {"bays": 3, "picker": -45, "speed": 0.5},
    "balls": {"balls": 3},
}
"""Arguments that make a scene small, in the place of a recipe's ranges."""


def tiny(name: str, folder: Path, scene: str, duration: float = 0.1, **arguments: Any) -> Plan:
    """The first sequence of one scene of a recipe, short and of few pixels; draws nothing else than the recipe does."""
    recipe = yaml.safe_load(find_recipe(name).read_text())
    recipe |= {"duration": duration, "sequences": 4}
    recipe["arguments"] |= SIZE
    only = recipe["scenes"][scene]
    only["arguments"] |= TINY.get(scene, {}) | arguments
    recipe["scenes"] = {scene: only}
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(recipe))
    return read_recipe(folder / f"{name}.yaml").sequence(0)


def made(plan: Plan, folder: Path) -> Any:
    """A reader of the sequence, made as a worker makes it."""
    maker = Maker(str(folder / "d"))
    entry = maker.make(plan)
    maker.close()
    assert entry.events > 0
    return reader_of(plan.layout)(folder / "d" / plan.path)


def truth(plan: Plan, *labels: str) -> list[Any]:
    """The steps of the same simulation with other labels; its world is told apart from labels by what draws it."""
    drop = ("box_of", "box_classes")
    given = {name: value for name, value in plan.given.items() if name not in drop}
    outputs = ["events", "info", *(f"labels.{kind}" for kind in labels)]
    with evis.Simulation(plan.scene, outputs=outputs, seed=plan.seed, **given) as sim:
        return [sim.reset(), *sim.run(plan.duration_s)]


def world_of(plan: Plan) -> Any:
    known = scene_args(plan.scene)
    return load_scene(plan.scene, {k: v for k, v in plan.given.items() if k in known}, seed=plan.seed, textures=False)


def test_they_are_all_there() -> None:
    wanted = {"rotation", "flow", "detection", "stereo", "tracking", "hdr_tunnel"}
    assert wanted <= set(paths.names("recipes"))


def test_an_unknown_recipe_is_refused_with_the_names_of_all() -> None:
    """Or with the nearest one."""
    with pytest.raises(DatasetError, match=r"there is no recipe zzz; there are detection, flow, .*tracking"):
        find_recipe("zzz")
    with pytest.raises(DatasetError, match=r"there is no recipe flov; did you mean 'flow'\?"):
        find_recipe("flov")


@pytest.mark.parametrize("name", paths.names("recipes"))
def test_every_recipe_is_planned_at_the_ends_of_its_ranges(name: str) -> None:
    """Sensor, world and motion are drawn: two sequences of a scene have nothing drawn in common."""
    recipe = read_recipe(name)
    check(recipe)
    assert recipe.description and recipe.count >= 100 and recipe.labels
    for scene in recipe.scenes:
        plans = [plan for plan in recipe.sequences(20) if plan.scene == scene.target][:2]
        first, second = plans
        assert first.seed != second.seed
        ranges = [axis.name for axis in scene.axes if not axis.choices and not axis.whole]
        assert ranges and all(first.arguments[key] != second.arguments[key] for key in ranges)
        known = {k: v for k, v in first.arguments.items() if k in scene_args(scene.target)}
        assert name == "rotation" or (drawn_places(scene.target, known) and "threshold" in ranges)
        read_target(scene.target, first.given)


def test_flow_is_where_depth_and_poses_take_a_point(tmp_path: Path) -> None:
    """Each valid pixel of forward flow, unprojected by the depth at the interval's start and moved with its body."""
    plan = tiny("flow", tmp_path, "flying_shapes", threshold_mismatch=0.0)
    flow = made(plan, tmp_path).labels("forward_flow", 0, 10**9)
    steps = truth(plan, "depth", "segmentation", "poses")
    info, names = steps[0].info, list(steps[0].labels.names)
    rows, columns = np.mgrid[: SIZE["height"], : SIZE["width"]].astype(np.float64)
    pixels = np.stack((columns, rows), -1)
    compared = moving = 0
    for image, valid, (t0, t1) in zip(flow["forward_flow"], flow["forward_valid"], flow["flow_t"]):
        start, end = (min(steps, key=lambda s: abs(s.stamp_ns - t)).labels for t in (t0, t1))
        pose0, pose1 = (dict(zip(names, labels.pose[0].astype(np.float64))) for labels in (start, end))
        cam0, cam1 = pose0["cam0"], pose1["cam0"]
        point = se3.transform(cam0, pinhole.unproject(info.k, pixels, start.depth[0].astype(np.float64)))
        for number in np.unique(start.segmentation[0]):
            here = (start.segmentation[0] == number) & (valid > 0)
            body = info.instance_bodies[number]
            if not here.any():
                continue
            moved = point[here]
            if body:
                moved = se3.transform(pose1[body], se3.transform(se3.inverse(pose0[body]), moved))
                moving += here.sum()
            seen = se3.transform(se3.inverse(cam1), moved)
            wanted = np.stack([info.k[i, i] * seen[:, i] / seen[:, 2] + info.k[i, 2] for i in range(2)], -1)
            # DSEC has 1/128 px; depth is float32.
            assert np.abs(image[here] - (wanted - pixels[here])).max() < 0.02
            compared += here.sum()
    assert compared > 2 * SIZE["width"] * SIZE["height"] and moving > 100


def test_boxes_of_the_warehouse_hold_what_is_seen_of_the_body(tmp_path: Path) -> None:
    """Within the extent of its projected meshes, and as large as what the segmentation has of it."""
    plan = tiny("detection", tmp_path, "warehouse", 0.07)
    found = made(plan, tmp_path).labels("boxes", 0, 10**9)
    steps = truth(plan, "segmentation", "poses")
    scene, info = world_of(plan), steps[0].info
    names = list(steps[0].labels.names)
    bodies, at = np.array(info.instance_bodies), {step.stamp_ns // 1000 * 1000: step.labels for step in steps}
    classes = set()
    for t, first, last in zip(found["t"], found["offsets"][:-1], found["offsets"][1:]):
        labels = at[int(t)]
        for box, number in zip(found["box"][first:last], found["box_id"][first:last]):
            classes.add(info.classes[info.semantic[number]])
            parts = np.flatnonzero(bodies == bodies[number])
            rows, columns = np.nonzero(np.isin(labels.segmentation[0], parts))
            assert np.allclose(box, [columns.min(), rows.min(), columns.max(), rows.max()], atol=1e-3)
            body, camera = (labels.pose[0, names.index(n)].astype(np.float64) for n in (bodies[number], "cam0"))
            corners = [se3.transform(scene.instances[p - 1].pose, scene.instances[p - 1].mesh.vertices) for p in parts]
            seen = se3.transform(se3.inverse(camera), se3.transform(body, np.concatenate(corners)))
            if seen[:, 2].min() > 0.1:
                image = seen @ info.k.T
                image = image[:, :2] / image[:, 2:]
                assert (box[:2] > image.min(0) - 1).all() and (box[2:] < image.max(0) + 1).all()
    assert {"load", "pallet"} <= classes <= {"load", "pallet", "carried", "forklift", "wheel", "barrel"}


def test_disparity_is_focal_length_times_baseline_over_depth(tmp_path: Path) -> None:
    plan = tiny("stereo", tmp_path, "stereo_room", 0.07)
    found = made(plan, tmp_path).labels("disparity", 0, 10**9)
    steps = truth(plan, "depth")
    info, depths = steps[0].cameras["left"].info, {s.stamp_ns // 1000: s.cameras["left"].labels.depth[0] for s in steps}
    assert np.isclose(steps[0].cameras["right"].info.baseline, plan.arguments["baseline"])
    assert len(found["t"]) == 3
    for t, disparity in zip(found["t"], found["disparity"]):
        wanted = info.k[0, 0] * plan.arguments["baseline"] / depths[int(t) // 1000]
        assert np.abs(disparity - wanted)[np.isfinite(wanted)].max() <= 0.5 / 256 + 1e-6


def test_tracks_of_balls_are_their_closed_form(tmp_path: Path) -> None:
    """Poses and velocities of the trajectory; the box of a ball is about where its centre is projected."""
    plan = tiny("tracking", tmp_path, "balls", 0.05, sway=1.0)
    reader = made(plan, tmp_path)
    poses, speeds, boxes = (reader.labels(kind, 0, 10**9) for kind in ("poses", "velocities", "boxes"))
    scene, info = world_of(plan), reader.cameras["cam0"]
    assert len(poses["t"]) >= 5
    for n, body in enumerate(scene.bodies):
        assert np.allclose(poses["pose"][:, n, :3], body.trajectory.pose(poses["t"])[:, :3], atol=1e-6)
        assert np.allclose(speeds["velocity"][:, n], body.trajectory.twist(speeds["t"]), rtol=1e-5, atol=1e-5)
    camera, checked = scene.bodies[scene.body_index("cam0")].trajectory, 0
    for t, first, last in zip(boxes["t"], boxes["offsets"][:-1], boxes["offsets"][1:]):
        for box, number in zip(boxes["box"][first:last], boxes["box_id"][first:last]):
            instance = scene.instances[number - 1]
            assert info.classes[info.semantic[number]] == "ball"
            centre = scene.bodies[instance.body].trajectory.pose(np.array([t]))[0, :3]
            seen = se3.transform(se3.inverse(camera.pose(np.array([t]))[0]), centre)
            middle = (info.k @ seen)[:2] / seen[2]
            reach = info.k[0, 0] * np.abs(instance.mesh.vertices).max() / seen[2]
            assert (box[:2] >= middle - reach - 1.5).all() and (box[2:] <= middle + reach + 1.5).all()
            checked += 1
    assert checked >= 5


def test_the_spinner_has_boxes_of_its_hub_and_arms(tmp_path: Path) -> None:
    plan = tiny("tracking", tmp_path, "fidget_spinner", 0.03)
    reader = made(plan, tmp_path)
    found, info = reader.labels("boxes", 0, 10**9), reader.cameras["cam0"]
    assert {info.instance_bodies[n] for n in found["box_id"]} == {"spinner", "arm_0", "arm_1", "arm_2"}


def test_labels_of_the_tunnel_do_not_depend_on_light(tmp_path: Path) -> None:
    """Flow and boxes are those of the geometry; events are others."""
    found = []
    for folder, sun, ambient in (("a", 250, 0.4), ("b", 2500, 0.002)):
        (tmp_path / folder).mkdir()
        plan = tiny("hdr_tunnel", tmp_path / folder, "tunnel_exit", 0.07, sun=sun, ambient=ambient, start=20, speed=20)
        found.append(made(plan, tmp_path / folder))
    for kind in ("forward_flow", "backward_flow", "boxes"):
        first, second = (reader.labels(kind, 0, 10**9) for reader in found)
        assert first.keys() == second.keys()
        assert all(np.array_equal(first[name], second[name], equal_nan=True) for name in first)
    assert found[0].count != found[1].count


def test_a_sheet_shows_the_boxes_of_its_frame(tmp_path: Path) -> None:
    """Of balls that fly ten pixels from one stamp to the next, those at the time of the frame, not of one beside it."""
    plan = tiny("tracking", tmp_path, "balls", 0.05, balls=1, speed=15.0, sway=0.0, shot_rate=0.0)
    reader = made(plan, tmp_path)
    boxes = reader.labels("boxes", 0, 10**9)
    picture = tiles(tmp_path / "d" / plan.path, plan.layout)
    drawn = (picture["boxes"] != picture["frame"]).any(-1)
    at = int(np.flatnonzero(boxes["t"] == 30_000_000)[0])  # of the stamps 0, 10, ... 50 ms
    x0, y0, x1, y1 = boxes["box"][boxes["offsets"][at]].astype(int)
    rows, columns = np.nonzero(drawn)
    assert [columns.min(), rows.min(), columns.max(), rows.max()] == [x0, y0, x1, y1]
    assert len(np.unique(boxes["box"], axis=0)) == len(boxes["box"]) >= 4
