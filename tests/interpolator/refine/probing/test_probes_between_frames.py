"""Z-buffers between the coarse frames: as many as what moves asks for, each of its own instant."""

import numpy as np
import pytest
from refine_rig import keyframes_of_gap
from rigid_rig import FOCAL, GAP, HEIGHT, START, closed_form, luminance, painted, plain, pose, quad, world

from evis.runtime.clock import subframe_stamps
from evis.scene.model import Material, Mesh
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin
from nodes.interpolator.refine.instants import instants_of
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.refine.probing.probes import LEAST, order_of
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import Renderer

DEPTH, K = 2.0, 4


def strip(width_px):
    """A strip so wide in the image at DEPTH, and as high as the image."""
    half = 0.5 * width_px * DEPTH / FOCAL
    corners = np.array([[-half, -2, 0], [half, -2, 0], [half, 2, 0], [-half, 2, 0]], np.float32)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def passing(width_px, speed_px, background=None, along_px=0.0, beside_px=0.0):
    """A strip that goes so many pixels per gap across and along itself, and is in the middle of the image at half of
    it, or beside it."""
    speed = np.array([speed_px, along_px, 0.0]) * DEPTH / FOCAL / (GAP * 1e-9)
    x, y, _ = -speed * (START + GAP / 2) * 1e-9
    x += beside_px * DEPTH / FOCAL
    flight = Prescribed(pose(x, y, DEPTH), [Linear(speed)])
    wall = (quad(8.0), background or plain(0.2), Prescribed(pose(z=3.0)))
    return world([wall, (strip(width_px), plain(0.9), flight)])


def gap_of(scene, envs=1, paths=None, threads=1, tolerance_ns=50_000):
    """`Refined`, with 4 frames, after one gap; paths: of the last body, by environment."""
    view = scene.cameras[0]
    keys = keyframes_of_gap(scene, envs, paths or ())
    rigid = Rigid(scene, view, envs, K, threads=threads, options=RigidOptions(single=True))
    method = Refined(rigid, tolerance_ns, threads)
    method.between(*keys, np.zeros(envs, bool), np.empty((envs, K, view.height, view.width), np.float32))
    return method


def drawn(method):
    """Z-buffers per gap that each environment goes by."""
    return (method.refinement._probes.each.numpy() * K).tolist()


@pytest.mark.parametrize(
    ("width", "speed", "wanted"),
    [
        (8, 40, LEAST),  # 5 are enough.
        (4, 40, 16),  # 10 are.
        (3, 150, 64),  # It is there for a fiftieth of the gap.
        (3, 300, 128),
        (40, 150, LEAST),  # What is wide is seen anyway.
    ],
)
def test_as_many_as_a_thing_that_passes_is_wide(width, speed, wanted):
    """A strip at a speed [px per gap] is on a pixel for width / speed of it: so many times in a gap is looked at least,
    rounded up to a power of two."""
    assert drawn(gap_of(passing(width, speed))) == [wanted]


# In the middle of the gap the strip is at 47.8 + beside [px], by the camera's centre; at the coarse frames, a quarter
# of the gap apart, as far from the next pixel, for it goes whole pixels in between.
@pytest.mark.parametrize("beside", [0.0, 0.5, 0.75])
@pytest.mark.parametrize(("speed", "tolerance_ns", "wanted"), [(20, 150_000, 64), (20, 50_000, 128), (8, 50_000, 32)])
def test_as_many_as_what_is_on_no_pixel_is_wide(speed, tolerance_ns, wanted, beside):
    """A strip of 0.3 px is more than half of that beside a pixel in each coarse frame: whether it is on one there says
    nothing. At 20 px per gap it is on each that it passes for a 67th of it: of 28 % of the image 32 z-buffers would
    leave 52 % unseen, 64 leave 4 %, 128 none; at 8 px of 11 % of it 16 would leave 40 %, 32 leave none. Up to 3 % of
    all pixels may be with a tolerance of 0.3 ms or more, 1.5 % with half of that, 0.5 % with a sixth. Every pixel that
    it passes has two samples for each of its edges."""
    found = gap_of(passing(0.3, speed, beside_px=beside), tolerance_ns=tolerance_ns)
    assert drawn(found) == [wanted]
    assert found.further is not None and found.further.offset.size == 4 * speed * HEIGHT


@pytest.mark.parametrize(("speed", "told"), [(40, False), (60, True)])
def test_what_a_close_tolerance_asks_for_and_may_not_have_is_told_as_with_any_other(speed, told):
    """There are 128 instants. At 40 px per gap the strip of 0.3 px is on a pixel for a 133rd of it: of 42 % of the
    image these leave 4 % unseen, 1.7 % of all pixels, where 0.5 % is wanted and 3 % need not be told; at 60 px 22 %."""
    found = gap_of(passing(0.3, speed))
    assert drawn(found) == [128] and found.refinement.unseen.tolist() == [told]


@pytest.mark.parametrize(("speed", "wanted"), [(20, 128), (8, 32)])
def test_a_strip_on_no_pixel_counts_as_well_where_the_camera_moves(speed, wanted):
    """The same strip stands still, and the camera goes as far the other way, before a wall of one colour: nothing else
    is seen to move. On a body that could move it is the same."""
    velocity = np.array([-speed * DEPTH / FOCAL / (GAP * 1e-9), 0.0, 0.0])
    eye = Prescribed(pose(*(-velocity * (START + GAP / 2) * 1e-9)), [Linear(velocity)])
    wall = (quad(8.0), plain(0.2), Prescribed(pose(z=3.0)))
    scene = world([wall, (strip(0.3), plain(0.9), Prescribed(pose(z=DEPTH)))], camera_motion=eye)
    found = gap_of(scene)
    assert drawn(found) == [wanted]
    assert found.further is not None and found.further.offset.size == 4 * speed * HEIGHT


def test_what_stands_still_and_is_wide_asks_for_no_more_where_the_camera_moves():
    """A strip of 4 px, and the wall, which is flat and seen from the front."""
    eye = Prescribed(pose(), [Linear(np.array([0.5 * LEAST * DEPTH / FOCAL / (GAP * 1e-9), 0.0, 0.0]))])
    wall = (quad(8.0), plain(0.2), Prescribed(pose(z=3.0)))
    scene = world([wall, (strip(4.0), plain(0.9), Prescribed(pose(z=DEPTH)))], camera_motion=eye)
    assert drawn(gap_of(scene)) == [LEAST]


@pytest.mark.parametrize("beside", [0.1, 0.25])
@pytest.mark.parametrize(("speed", "wanted"), [(20, 128), (8, 64)])
def test_what_one_pixel_alone_shows_counts_as_an_eighth_of_it_wide(speed, wanted, beside):
    """The same strip, but less than half its width beside a pixel in each coarse frame: how wide it is these do not
    tell. Of the 160 z-buffers for 20 px there are as many as there are instants."""
    assert drawn(gap_of(passing(0.3, speed, beside_px=beside))) == [wanted]


def slit(width_px):
    """Two plates far wider than the image, with a slit between them."""
    half = 0.5 * width_px * DEPTH / FOCAL
    corners = [[x, y, 0] for side in (-1, 1) for x in (side * half, side * 40.0) for y in (-8, 8)]
    faces = [face for n in (0, 4) for face in ((n, n + 2, n + 3), (n, n + 3, n + 1))]
    both = [*faces, *((a, c, b) for a, b, c in faces)]
    return Mesh(np.array(corners, np.float32), np.array(both, np.int32))


@pytest.mark.parametrize(("width", "speed", "wanted"), [(4, 40, 16), (3, 150, 64), (3, 300, 128), (80, 150, LEAST)])
def test_as_many_as_a_slit_that_passes_is_wide(width, speed, wanted):
    """What is behind it is on a pixel for as long as a strip of its width and speed would be."""
    scene = passing(width, speed)
    scene.instances[1].mesh = slit(width)
    assert drawn(gap_of(scene)) == [wanted]


@pytest.mark.parametrize("slant", [0.5, 1.0, -0.7])
@pytest.mark.parametrize(("width", "speed", "wanted"), [(1, 12, 128), (3, 150, 64), (3, 300, 128)])
def test_a_slit_that_passes_at_a_slant_counts_as_one_that_goes_across(width, speed, wanted, slant):
    """It goes so far along itself too, by which a pixel sees nothing else. What one pixel alone shows counts as an
    eighth of it wide."""
    scene = passing(width, speed, along_px=slant * speed)
    scene.instances[1].mesh = slit(width)
    assert drawn(gap_of(scene)) == [wanted]


@pytest.mark.parametrize("tilt", [0.0, 0.1])
def test_the_steps_of_a_silhouette_are_no_slits(tilt):
    """A square wider than the image that goes nearly along its edge: of that nothing but steps of pixels goes by."""
    speed = 60 * DEPTH / FOCAL / (GAP * 1e-9)
    way = speed * np.array([np.cos(tilt + 0.02), np.sin(tilt + 0.02), 0.0])
    turn = np.array([0.0, 0.0, np.sin(tilt / 2), np.cos(tilt / 2)])
    half = 5.0
    edge = half * np.array([np.sin(tilt), -np.cos(tilt), 0.0])
    middle = -way * (START + GAP / 2) * 1e-9 + edge + np.array([0.0, 0.0, DEPTH])
    flight = Prescribed(np.concatenate([middle, turn]), [Linear(way)])
    scene = world([(quad(8.0), plain(0.2), Prescribed(pose(z=3.0))), (quad(half), plain(0.9), flight)])
    # With a closer tolerance the few pixels count that seem to be slits there.
    assert drawn(gap_of(scene, tolerance_ns=300_000)) == [LEAST]


def test_a_small_thing_counts_although_the_image_hardly_changes():
    """A square of 4 px on its way over 200 px is on a pixel for a fiftieth of the gap."""
    scene = passing(4, 200)
    scene.instances[1].mesh = quad(2.0 * DEPTH / FOCAL)
    assert drawn(gap_of(scene)) == [64]


@pytest.mark.parametrize("camera_turns", [False, True])
def test_a_thing_that_comes_and_goes_between_two_looks_is_seen(camera_turns):
    """It is in the image for a 26th of the gap, between two of the 8 z-buffers that there are in any case, and 150 us
    on a pixel."""
    speed = 4000 * DEPTH / FOCAL / (GAP * 1e-9)
    start = pose(-speed * (START + 0.593 * GAP) * 1e-9, 0, DEPTH)
    flight = Prescribed(start, [Linear(np.array([speed, 0.0, 0.0]))])
    things = [(quad(8.0), plain(0.2), Prescribed(pose(z=3.0))), (strip(60), plain(0.9), flight)]
    turn = Prescribed(pose(), [Spin(np.array([0.0, 0.0, 1.0]), 1.0)]) if camera_turns else None
    method = gap_of(world(things, camera_motion=turn))
    first, offset, value = method.further.arrays(False)
    pixels = np.repeat(np.arange(len(first) - 1), np.diff(first))
    bright = value > 0.15
    # Z-buffers are as close as that in the end, or a little less.
    assert len(np.unique(pixels[bright])) > 0.9 * (len(first) - 1)
    assert 0.56 * GAP < offset[bright].min() and offset[bright].max() < 0.63 * GAP


def test_what_stays_in_the_image_or_out_of_it_asks_for_no_more():
    speed = 20 * DEPTH / FOCAL / (GAP * 1e-9)
    for away in (0.0, 5.0):
        start = pose(away - speed * START * 1e-9, 0, DEPTH)
        flight = Prescribed(start, [Linear(np.array([speed, 0.0, 0.0]))])
        things = [(quad(8.0), plain(0.2), Prescribed(pose(z=3.0))), (strip(20), plain(0.9), flight)]
        assert drawn(gap_of(world(things))) == [LEAST]


def test_a_textured_wall_that_goes_fast_needs_no_more_than_the_least():
    speed = 150 * DEPTH / FOCAL / (GAP * 1e-9)
    flight = Prescribed(pose(-speed * START * 1e-9, 0, DEPTH), [Linear(np.array([speed, 0.0, 0.0]))])
    assert drawn(gap_of(world([(quad(40.0), painted(), flight)]))) == [LEAST]


def test_a_thing_that_turns_a_hundred_times_in_a_gap_is_fast():
    """Although it is where it was at every frame."""
    turns = Spin(np.array([0.0, 0.0, 1.0]), 2 * np.pi * 100 * 4 / (GAP * 1e-9))
    blade = (strip(3), plain(0.9), Prescribed(pose(0, 0, DEPTH), [turns]))
    scene = world([(quad(8.0), plain(0.2), Prescribed(pose(z=3.0))), blade])
    assert drawn(gap_of(scene)) == [K << instants_of(GAP, K, 50_000, 1, 8, True).depth]


@pytest.mark.parametrize(("speed", "unseen"), [(150, False), (300, False), (3000, True)])
def test_what_is_too_fast_is_told(speed, unseen):
    """3 px wide: at 3000 px per gap it is on a pixel for 10 us, a fifth of the tolerance."""
    assert gap_of(passing(3, speed)).refinement.unseen.tolist() == [unseen]


@pytest.mark.parametrize(("when", "unseen"), [(0.5 + 0.5 / 128, True), (1.5, False)])
def test_what_passes_the_image_between_two_instants_is_told(when, unseen):
    """A strip that is 480 px further at each of the 128 instants of a gap, in the middle of the image at a part of
    it."""
    speed = 480 * 128 * DEPTH / FOCAL / (GAP * 1e-9)
    flight = Prescribed(pose(-speed * (START + when * GAP) * 1e-9, 0, DEPTH), [Linear(np.array([speed, 0.0, 0.0]))])
    scene = world([(quad(8.0), plain(0.2), Prescribed(pose(z=3.0))), (strip(20), plain(0.9), flight)])
    assert gap_of(scene).refinement.unseen.tolist() == [unseen]


def fast_wall(speed, material):
    """A wall that fills the image and goes so many pixels per gap."""
    pace = speed * DEPTH / FOCAL / (GAP * 1e-9)
    start = pose(-pace * (START + GAP / 2) * 1e-9, 0, DEPTH)
    return world([(quad(80.0), material, Prescribed(start, [Linear(np.array([pace, 0.0, 0.0]))]))])


@pytest.mark.parametrize(("speed", "unseen"), [(2500, False), (6000, True)])
def test_what_is_painted_and_passes_between_two_instants_is_told(speed, unseen):
    """Of stripes 32 px wide 78 or 188 edges pass a pixel in a gap of 128 instants, which show all of them or not."""
    stripes = np.where(np.arange(2048) * 200 // 2048 % 2 == 0, 0.2, 0.8).astype(np.float32)
    picture = np.broadcast_to(stripes[None, :, None], (8, 2048, 3)).copy()
    method = gap_of(fast_wall(speed, Material("stripes", np.ones(3), picture, two_sided=True)))
    first, _, value = method.further.arrays(False)
    middle = len(first) // 2
    edges = np.count_nonzero(np.diff(value[first[middle] : first[middle + 1]] > 0.15))
    assert (edges < 0.95 * speed / 32) == unseen
    assert method.refinement.unseen.tolist() == [unseen]


@pytest.mark.parametrize(("speed", "unseen"), [(24, False), (100, True)])
def test_what_is_painted_so_finely_that_samples_miss_its_peaks_is_told(speed, unseen):
    """Stripes 1 px wide: of 24 of them each is on a pixel for 5.3 of the gap's 128 instants, of 100 for 1.3."""
    count = 4096
    stripes = np.where(np.arange(4 * count) // 4 % 2 == 0, 0.2, 0.8).astype(np.float32)
    picture = np.broadcast_to(stripes[None, :, None], (4, 4 * count, 3)).copy()
    pace = speed * DEPTH / FOCAL / (GAP * 1e-9)
    start = pose(-pace * (START + GAP / 2) * 1e-9, 0, DEPTH)
    wall = quad(count * DEPTH / FOCAL / 2), Material("stripes", np.ones(3), picture, two_sided=True)
    method = gap_of(world([(*wall, Prescribed(start, [Linear(np.array([pace, 0.0, 0.0]))]))]))
    first, _, value = method.further.arrays(False)
    middle = len(first) // 2
    light = value[first[middle] : first[middle + 1]]
    edges = np.count_nonzero(np.diff(light > 0.5 * (light.min() + light.max())))
    assert method.refinement.unseen.tolist() == [unseen]
    # What is followed is there as often as it passes, but for peaks at the frames, which are not among the samples.
    assert unseen or speed - 2 * K <= edges <= speed


def test_a_wall_of_one_colour_is_told_of_at_no_speed():
    assert gap_of(fast_wall(6000, plain(0.5))).refinement.unseen.tolist() == [False]


@pytest.mark.parametrize("swings", ["thing", "camera"])
def test_what_is_back_at_every_frame_is_followed_in_between(swings):
    """A painted wall, or the camera before it, that swings by 1.5 px as often as there are frames."""
    sway = [Sinusoid(np.array([1.5 * 3.0 / FOCAL, 0.0, 0.0]), K / (GAP * 1e-9))]
    moves, stays = Prescribed(pose(z=3.0), sway), Prescribed(pose(z=3.0))
    if swings == "thing":
        scene = world([(quad(1.5), painted(1024), moves)])
    else:
        scene = world([(quad(1.5), painted(1024), stays)], camera_motion=Prescribed(pose(), sway))
    method = gap_of(scene)
    # In a sixteenth of a period it is 0.03 px off a straight way, in an eighth 0.11.
    assert drawn(method) == [16 * K]
    first, offset, value = method.further.arrays(False)
    stamps = START + np.linspace(0, GAP, 81).astype(np.int64)[1:]
    renderer = Renderer(scene, scene.cameras[0])
    poses = [closed_form(scene, t[None]).pose[:, 0] for t in stamps]
    dense = np.log([luminance(renderer.render(p)["radiance"])[0].ravel() for p in poses])
    frame = dense[-1]
    changing = np.flatnonzero(np.ptp(dense, axis=0) > 0.15)
    assert len(changing) > 0.1 * len(frame)
    off = []
    for pixel in changing[::7]:
        mine = slice(first[pixel], first[pixel + 1])
        at = np.concatenate([offset[mine], np.arange(K + 1) * GAP // K])
        seen = np.concatenate([np.log(value[mine]), np.full(K + 1, frame[pixel])])
        order = np.argsort(at)
        line = np.interp(stamps - START, at[order], seen[order])
        off.append(np.abs(line - dense[:, pixel]).mean() / np.ptp(dense[:, pixel]))
    # But for the wall's border, which passes pixels just at the frames.
    assert np.median(off) < 0.1 and np.mean(np.array(off) > 0.15) < 0.1


def test_each_is_of_its_own_instant():
    """In the order in which window_kernels.entry_at looks for them: each against a z-buffer of its own."""
    scene = passing(3, 150)
    method = gap_of(scene)
    probes = method.refinement._probes
    instants = instants_of(GAP, K, 50_000, 1, 8, True)
    order = order_of(instants, probes.most)
    assert len(order) == len(set(order)) == K * (probes.most - 1)
    stamps = subframe_stamps(START, START + GAP, instants.count)
    every = 1 << instants.depth
    wanted = np.arange(every // probes.most, instants.count, every // probes.most)
    assert sorted(order) == (wanted[wanted % every > 0] - 1).tolist()
    visibility = Visibility(scene, scene.cameras[0])
    packed = probes.packed.numpy()
    for row in (0, 3, 4, 17, 40, len(order) - 1):
        visibility.update(closed_form(scene, stamps[order[row] : order[row] + 1]).pose[:, 0])
        assert (packed[row] == visibility.packed.numpy()[0]).all()
    assert len(np.unique(packed[: len(order)], axis=0)) > 0.5 * len(order)


def test_environments_go_by_their_own():
    """A slow and a fast one side by side have the samples that they have alone."""
    scenes = [passing(3, speed, painted(1024)) for speed in (20, 150)]
    paths = [scene.bodies[1].trajectory for scene in scenes]
    scene = scenes[0]
    scene.bodies[1].trajectory = None

    def samples(chosen):
        method = gap_of(scene, len(chosen), chosen)
        found = method.further
        first, offset, value = found.arrays(False)
        pixels = (len(first) - 1) // len(chosen)
        parts = [slice(first[e * pixels], first[(e + 1) * pixels]) for e in range(len(chosen))]
        return drawn(method), [(offset[p].tobytes(), value[p].tobytes()) for p in parts]

    counts, together = samples(paths)
    assert counts == [LEAST, 64]
    for path, found in zip(paths, together):
        assert samples([path])[1] == [found]


def test_threads_change_nothing():
    scene = passing(3, 150, painted(1024))
    one, three = (gap_of(scene, threads=threads) for threads in (1, 3))
    assert drawn(one) == drawn(three) == [64]
    for a, b in zip(one.further.arrays(False), three.further.arrays(False)):
        assert len(a) > 1000 and (a == b).all()


def test_what_passes_the_near_plane_is_seen_at_the_border_too():
    """A plate of 20 x 20 cm comes from behind the camera at 200 m/s, just after a z-buffer: it fills the image, and is
    gone from its four borders before the next of the 8 that there are in any case, 0.8 and 1.1 ms later."""
    speed = 200.0
    start = pose(0, 0, -speed * (START + 0.51 * GAP) * 1e-9)
    plate = (quad(0.1), plain(0.9), Prescribed(start, [Linear(np.array([0.0, 0.0, speed]))]))
    method = gap_of(world([(quad(30.0), plain(0.2), Prescribed(pose(z=9.0))), plate]))
    first, _offset, value = method.further.arrays(False)
    pixels = np.repeat(np.arange(len(first) - 1), np.diff(first))
    assert len(np.unique(pixels[value > 0.15])) > 0.98 * (len(first) - 1)


def rushing(width_px, reach_px, periods):
    """A strip that swings to and fro so many times in a gap, by so many pixels, and is at rest at every frame."""
    period = GAP * 1e-9 / periods
    # START is a whole number of periods from 0.
    sway = Sinusoid(np.array([reach_px * DEPTH / FOCAL, 0.0, 0.0]), 1 / period, np.pi / 2)
    strips = (strip(width_px), plain(0.9), Prescribed(pose(z=DEPTH), [sway]))
    return world([(quad(8.0), plain(0.2), Prescribed(pose(z=3.0))), strips])


@pytest.mark.parametrize(("width", "reach", "unseen"), [(3, 40, True), (40, 20, False)])
def test_what_is_fast_between_frames_and_at_rest_at_them_is_told(width, reach, unseen):
    """3 px wide, it goes at up to 1005 px per gap, or 8 px from one of 128 instants to the next."""
    assert gap_of(rushing(width, reach, K)).refinement.unseen.tolist() == [unseen]


def test_what_is_fast_between_frames_is_looked_for_as_often_as_it_asks_for():
    """2 px wide and at up to 251 px per gap: it asks for 126 z-buffers where it is fast, to be straight for 64."""
    assert drawn(gap_of(rushing(2, 20, K / 2)))[0] == 128


@pytest.mark.parametrize(("speed", "unseen"), [(150.0, False), (200.0, True)])
def test_what_passes_the_near_plane_within_a_few_instants_is_told(speed, unseen):
    """A painted plate of 20 x 20 cm goes by its own size in 17 of the 128 instants of a gap, or in 13. Over the last 20
    cm it grows from the size of the image to all sizes, and what is painted on it sweeps over every pixel."""
    start = pose(0.02, 0, -speed * (START + 0.51 * GAP) * 1e-9)
    plate = (quad(0.1), painted(), Prescribed(start, [Linear(np.array([0.0, 0.0, speed]))]))
    method = gap_of(world([(quad(30.0), plain(0.2), Prescribed(pose(z=9.0))), plate]))
    assert method.refinement.unseen.tolist() == [unseen]


@pytest.mark.parametrize(("swings", "unseen"), [(1.8, False), (2.6, True)])
def test_what_small_things_lose_is_told_where_z_buffers_are_as_close_as_they_can_be(swings, unseen):
    """A square of 3 px swings by 30 px to and fro. At up to 339 px per gap it asks for 113 of the 128 z-buffers that
    there may be, at 490 for 163: a twentieth or more of what passes is unseen, though few pixels see anything pass."""
    sway = Sinusoid(np.array([30 * DEPTH / FOCAL, 0.0, 0.0]), swings / (GAP * 1e-9))
    still = (quad(8.0), plain(0.2), Prescribed(pose(z=3.0)))
    method = gap_of(world([still, (quad(1.5 * DEPTH / FOCAL), plain(0.9), Prescribed(pose(z=DEPTH), [sway]))]))
    assert method.refinement.unseen.tolist() == [unseen]
