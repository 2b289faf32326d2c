"""Several gaps at once give what they give one by one, bit for bit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rigid_rig import closed_form

from evis.runtime.clock import keyframe_stamp
from evis.scene.load import load_scene
from evis.scene.parts import Parts
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.keyframe import Report
from nodes.interpolator.many_gaps import Arrived, ManyGaps
from nodes.interpolator.refine.refinement import Refinement
from nodes.interpolator.separate import SeparateInterpolators
from nodes.renderer.renderer import Renderer

K = 4
SIZE = {"width": 64, "height": 48}


def arrivals(scene, count, episodes, colour=False, device="cpu"):
    """Keyframes of a scene at 30 Hz, whose time goes on from one episode to the next."""
    view = scene.cameras[0]
    renderer = Renderer(scene, view, device=device)
    stamps = [keyframe_stamp(k, 30.0) for k in range(count)]
    made = []
    for k, (stamp, episode) in enumerate(zip(stamps, episodes, strict=True)):
        t = np.array([stamps[max(k - 1, 0)], stamp])
        states = closed_form(scene, t if k else t[1:])
        output = "radiance" if colour else "luminance"
        image = renderer.render(states.pose[:, -1], None, (output,), {}, stamp)[output].copy()
        made.append(Arrived(stamp, np.array([episode], np.int32), image, states))
    return made


def one_by_one(scene, made, **how):
    interpolator = Interpolator("rigid", K, scene=scene, camera=scene.cameras[0], **how)
    found, reports = [], []
    for one in made:
        t, frames = interpolator.push(one.stamp_ns, one.episodes, one.image, None, None, states=one.states)
        found.append((t.tolist(), frames.copy()))
        reports.append(interpolator.report)
    return found, reports


@pytest.mark.parametrize("name", ["spinning_disk", "flying_shapes", "stereo_room"])
@pytest.mark.parametrize("gaps, at_once", [(4, 4), (3, 7)])
def test_frames_are_the_same_for_any_number_of_gaps(name, gaps, at_once):
    """Also where fewer come than fit, as at the end, and where an episode begins in between."""
    scene = load_scene(name, SIZE)
    made = arrivals(scene, 9, [0, 0, 0, 0, 0, 0, 1, 1, 1])
    want, reports = one_by_one(scene, made)
    many = ManyGaps("rigid", K, gaps, scene=scene, camera=scene.cameras[0])
    many.warm_up_for(1, *made[0].image.shape[1:3])
    found, reshaded = [], 0

    def deliver(some):
        nonlocal reshaded
        found.extend((t.tolist(), f.copy()) for t, f in some.frames)
        reshaded += some.report.reshaded

    for start in range(0, len(made), at_once):
        many.push_all(made[start : start + at_once], deliver)
    reshaded += many.last_report().reshaded
    assert many.gaps == gaps
    assert [t for t, _ in found] == [t for t, _ in want]
    for (_, frames), (_, true) in zip(found, want):
        assert np.array_equal(frames, true)
    assert reshaded == sum(report.reshaded for report in reports)


@pytest.mark.parametrize("tolerance", [0.0, 0.001])
def test_gaps_by_themselves_come_between_several_at_once(tolerance):
    """As where somebody comes who waits for every keyframe."""
    scene = load_scene("flying_shapes", SIZE)
    made = arrivals(scene, 8, [0] * 8)
    want, _ = one_by_one(scene, made, time_tolerance=tolerance)
    many, found = ManyGaps("rigid", K, 3, scene=scene, camera=scene.cameras[0], time_tolerance=tolerance), []
    deliver = lambda some: found.extend(frames.copy() for _, frames in some.frames)
    many.push_all(made[:3], deliver)
    for one in made[3:5]:
        found.append(many.push(one.stamp_ns, one.episodes, one.image, None, None, states=one.states)[1].copy())
    many.push_all(made[5:], deliver)
    for frames, (_, true) in zip(found, want, strict=True):
        assert np.array_equal(frames, true)


def test_reports_that_come_a_gap_late_are_those_of_the_gaps():
    """Of environments side by side, for which nobody need wait; none of a warm-up is among them."""
    scene = load_scene("flying_shapes", SIZE)
    made = arrivals(scene, 6, [0] * 6)

    def reports(late):
        interpolator = Interpolator("rigid", K, scene=scene, camera=scene.cameras[0])
        interpolator.late = late
        interpolator.warm_up_for(1, *made[0].image.shape[1:3])
        found = [interpolator.report]
        for one in made:
            interpolator.push(one.stamp_ns, one.episodes, one.image, None, None, states=one.states)
            found.append(interpolator.report)
        return [report.reshaded for report in found[1:]], interpolator.last_report().reshaded

    (own, nothing), (earlier, last) = reports(False), reports(True)
    assert nothing == 0 and sum(own) > 0
    assert earlier == [0, 0, *own[1:-1]] and last == own[-1]


def test_late_reports_of_worlds_that_look_different_are_added_up():
    """Of two environments with an interpolator each: none of what they count is lost at the end."""
    scene = load_scene("flying_shapes", SIZE)
    made = arrivals(scene, 5, [0] * 5)

    def total(late):
        def make():
            interpolator = Interpolator("rigid", K, scene=scene, camera=scene.cameras[0])
            interpolator.late = late
            return interpolator

        groups = [(scene, np.array([env])) for env in range(2)]
        both, found = SeparateInterpolators(Parts(groups, [make, make]), K, "cpu"), Report()
        assert both.late == late
        for one in made:
            twice = [np.concatenate([values, values]) for values in (one.episodes, one.image)]
            states = one.states.part(np.zeros(2, int))
            both.push(one.stamp_ns, *twice, None, None, states=states)
            found += both.report
        return found, both.last_report()

    (own, nothing), (earlier, last) = total(False), total(True)
    assert nothing == Report() and own.reshaded > 0 and last.reshaded > 0
    assert earlier + last == own


def test_gaps_that_are_known_are_prepared_once(monkeypatch):
    """While those before are made; and a state that is wrong is told when its gap's turn has come, after the others."""
    scene = load_scene("flying_shapes", SIZE)
    made, worked_out = arrivals(scene, 9, [0] * 9), []
    motion = Refinement._motion
    monkeypatch.setattr(Refinement, "_motion", lambda self, gap, *others: (
        worked_out.append(gap.ends.tolist()), motion(self, gap, *others))[1])  # fmt: skip
    many = ManyGaps("rigid", K, 4, scene=scene, camera=scene.cameras[0], time_tolerance=0.001)
    delivered = []
    many.push_all(made, delivered.append)
    assert [len(some.frames) for some in delivered] == [1, 4, 4]
    assert worked_out == [[one.stamp_ns for one in made[start : start + 4]] for start in (1, 5)]
    assert all(found is not None for some in delivered[1:] for found in some.further)

    many, delivered = ManyGaps("rigid", K, 4, scene=scene, camera=scene.cameras[0], time_tolerance=0.001), []
    made[6] = replace(made[6], stamp_ns=made[5].stamp_ns)
    with pytest.raises(ValueError, match="of the same episode"):
        many.push_all(made, delivered.append)
    assert [len(some.frames) for some in delivered] == [1, 4]


@pytest.mark.parametrize(
    "tolerance, cuda, sizes", [(0.001, True, [1, 1, 4, 3]), (0.001, False, [1, 4, 4]), (0.0, True, [1, 4, 4])]
)
def test_the_first_gap_tells_a_gpu_how_much_room_the_others_take(tolerance, cuda, sizes, monkeypatch):
    """It is made by itself where there are samples between frames, and only once."""
    scene = load_scene("flying_shapes", SIZE)
    made = arrivals(scene, 9, [0] * 9)
    many = ManyGaps("rigid", K, 4, scene=scene, camera=scene.cameras[0], time_tolerance=tolerance)

    def parts(keyframes):
        return [end - start for start, end, _ in many._runs(keyframes)]

    device = many._device
    monkeypatch.setattr(many, "_device", SimpleNamespace(is_cuda=cuda))
    assert parts(made) == sizes
    monkeypatch.setattr(many, "_device", device)
    many.push_all(made, lambda some: None)
    monkeypatch.setattr(many, "_device", SimpleNamespace(is_cuda=cuda))
    assert parts(made[1:]) == [4, 4]
