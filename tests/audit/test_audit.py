"""What an audit says of whole runs, and what it does at their ends."""

import numpy as np
import pytest
from audit_rig import audited, gaps, small

from evis.scene.model import Waveform
from nodes.audit.audit import Audit, AuditOptions
from nodes.audit.causes import cause_of, nothing_changes
from nodes.audit.node import AuditNode


def same(a: Audit, b: Audit) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(vars(a.units()).values(), vars(b.units()).values()))


def test_dense_rendering_has_next_to_no_error_and_rigid_has_some() -> None:
    """The drum of the matte box: keyframes 4000 times a second against 30 with 32 frames."""
    scene = small("matte_box")
    dense = audited(scene, 128, seconds=0.05, rate=4000, k=1, method="none").report()
    coarse = audited(scene, 128, seconds=0.05, rate=120, k=1, method="none").report()
    assert dense.vp.value < 0.05 < 0.2 < coarse.vp.value
    assert dense.wrong.value < 0.02 and dense.events > 100


def test_what_samples_between_frames_buy_is_the_error_of_an_audit_of_the_frames() -> None:
    """Two audits of the same pixels and frames, one of which is not told of the samples between them."""
    scene = small("matte_box")
    both, frames = (
        Audit(scene, scene.cameras[0], AuditOptions(64, horizon_ns=70_000_000, between=between))
        for between in (True, False)
    )
    for *gap, further in gaps(scene, 0.07, 30, 4, "rigid", time_tolerance=1e-4):
        both.push(*gap, further)
        frames.push(*gap)
    both.finish(), frames.finish()
    told, alone = both.report(), frames.report()
    assert told.frames == alone.vp.value == alone.frames
    assert told.vp.value < 0.3 * told.frames and told.frames > 0.2


def test_pulses_between_two_looks_are_no_error_of_a_run_that_has_them() -> None:
    """A lamp on for 0.1 ms of 10.3: samples between the frames have its pulses, frames at 240 Hz alone next to none."""
    scene = small("matte_box", 16, 12)
    scene.lights[0].waveform = Waveform("square", 97.0, 0.9, 0.3, 0.01)
    audit = Audit(scene, scene.cameras[0], AuditOptions(32, horizon_ns=70_000_000, between=True))
    for *gap, further in gaps(scene, 0.07, 30, 8, "rigid", time_tolerance=1e-4):
        audit.push(*gap, further)
    audit.finish()
    report = audit.report()
    assert report.vp.value < 0.05 and report.frames > 0.5 and report.events > 1000


def test_the_same_seed_gives_the_same_and_another_one_other_pixels() -> None:
    scene = small("fan_shadow", 32, 24)
    a, b, c = (audited(scene, 16, seed=seed, seconds=0.07) for seed in (4, 4, 5))
    assert same(a, b) and not np.array_equal(a.units().x, c.units().x)


def test_slots_change_nothing() -> None:
    scene = small("finned_shaft", 32, 24)
    assert same(*(audited(scene, 12, seconds=0.07, given={"slots": slots}) for slots in (5, 500)))


def test_more_pixels_than_there_are() -> None:
    audit = audited(small("matte_box", 12, 9), 1000, seconds=0.07)
    report = audit.report()
    assert report.pixels == 108 and report.vp.low == report.vp.value == report.vp.high


def test_a_scene_without_events_has_no_error() -> None:
    report = audited(small("matte_box", 16, 12, w=0), 20, seconds=0.07).report()
    assert report.events == 0 and np.isnan(report.vp.value) and report.worst == []


def test_episodes_are_drawn_anew_and_added_up() -> None:
    scene = small("matte_box", 32, 24)
    audit = Audit(scene, scene.cameras[0], AuditOptions(24, horizon_ns=70_000_000))
    for episode in range(2):
        for gap in gaps(scene, 0.07, 30, 8, "rigid", episode):
            audit.push(*gap)
    audit.finish()
    units = audit.units()
    assert len(units.x) == 48 and not np.array_equal(units.x[:24], units.x[24:])
    alone = Audit(scene, scene.cameras[0], AuditOptions(24, horizon_ns=70_000_000))
    for gap in gaps(scene, 0.07, 30, 8, "rigid"):
        alone.push(*gap)
    alone.finish()
    assert np.array_equal(alone.units().vp, units.vp[:24])


def test_environments_share_the_pixels() -> None:
    scene = small("matte_box", 32, 24)
    audit = Audit(scene, scene.cameras[0], AuditOptions(7, envs=3, horizon_ns=70_000_000))
    for frames, t, episodes, state, _, _ in gaps(scene, 0.07, 30, 8, "rigid"):
        tall = type(state).dense(
            state.header, state.t, *(np.repeat(v, 3, 0) for v in state.rows()), np.repeat(episodes, 3)
        )
        audit.push(np.repeat(frames, 3, 0), t, np.repeat(episodes, 3), tall)
    audit.finish()
    units = audit.units()
    assert np.bincount(units.env).tolist() == [3, 2, 2]
    assert units.chance.sum() == pytest.approx((units.chance * 1).sum()) and units.events.sum() > 0


def test_light_that_is_not_a_number_is_passed_over() -> None:
    scene = small("matte_box", 32, 24)
    audit = Audit(scene, scene.cameras[0], AuditOptions(64, horizon_ns=70_000_000))
    for frames, *rest in gaps(scene, 0.07, 30, 8, "rigid"):
        broken = frames.copy()
        broken[:, ::3] = np.nan
        audit.push(broken, *rest)
    audit.finish()
    assert 0 < audit.report().vp.value < 1


def test_the_cause_is_named() -> None:
    scene = small("fan_shadow", 32, 24)
    report, better = (audited(scene, 64, seconds=0.1, k=k).report() for k in (4, 32))
    assert "light or shadow on 'wall'" in cause_of(scene, "cam0", report)
    assert "interpolator:=none reuses nothing" in cause_of(scene, "cam0", report)
    assert "interpolator:=none" not in cause_of(scene, "cam0", report, "keyframe"), "it is that already"
    assert report.worst and report.vp.value > 0.5 > 2 * better.vp.value


def test_there_is_none_on_a_gpu_unless_it_is_asked_for() -> None:
    params = {"scene": "spinning_disk", "device": "cuda", "audit": None}
    assert "audit:=64" in AuditNode.pointless(params)
    assert not AuditNode.pointless(params | {"audit": 64})
    assert not AuditNode.pointless(params | {"device": "cpu"})


def test_there_is_none_where_keyframes_are_far_apart_unless_it_is_asked_for() -> None:
    """Of 100 keyframes 1000 s apart it took more than a thousand times as long as the run."""
    params = {"scene": "spinning_disk", "audit": None, "keyframe_rate": 0.001}
    assert "1000 s apart" in AuditNode.pointless(params) and "audit:=16" in AuditNode.pointless(params)
    assert not AuditNode.pointless(params | {"audit": 16})
    assert not AuditNode.pointless(params | {"keyframe_rate": 1.0})


def test_what_never_changes_is_told() -> None:
    assert not nothing_changes(small("matte_box"))
    scene = small("matte_box")
    scene.bodies = [body for body in scene.bodies if body.name == "cam0"]
    assert nothing_changes(scene)
