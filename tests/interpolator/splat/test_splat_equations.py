"""The warp against its equations, written out pixel by pixel in float64."""

import math

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.keyframe import KeyframeView
from nodes.interpolator.splat.cpu import SplatCpu
from nodes.interpolator.splat.cuda import SplatCuda
from nodes.interpolator.splat.splat import Splat

H, W = 11, 14
RTOL = 2e-6
"""Sums of float32: a dozen roundings of 6e-8."""

CUDA = pytest.param("cuda", marks=pytest.mark.gpu)


def sources(depth, other, motion, sign, a):
    """(x, y, z) of every pixel of a keyframe at fraction a of the way to the other one."""
    for y in range(H):
        for x in range(W):
            dx, dy = sign * float(motion[y, x, 0]), sign * float(motion[y, x, 1])
            z = float(depth[y, x])
            cx, cy = math.floor(x + dx + 0.5), math.floor(y + dy + 0.5)
            there = float(other[cy, cx]) if 0 <= cx < W and 0 <= cy < H else math.inf
            if math.isinf(there):
                there = z
            yield y, x, x + a * dx, y + a * dy, z if math.isinf(z) else (1 - a) * z + a * there


def splatted(image, depth, other, motion, sign, a):
    """Per target the average of the nearest sources (nan where there is none), and the nearest depth."""
    reached = [[[] for _ in range(W)] for _ in range(H)]
    for y, x, qx, qy, z in sources(depth, other, motion, sign, a):
        for ty in (math.floor(qy), math.floor(qy) + 1):
            for tx in (math.floor(qx), math.floor(qx) + 1):
                weight = (1 - abs(qx - tx)) * (1 - abs(qy - ty))
                if weight > 0 and 0 <= tx < W and 0 <= ty < H:
                    reached[ty][tx].append((z, weight, float(image[y, x])))
    value, nearest = np.full((H, W), np.nan), np.full((H, W), np.nan)
    for y in range(H):
        for x in range(W):
            if reached[y][x]:
                z_min = min(z for z, _, _ in reached[y][x])
                chosen = [(w, v) for z, w, v in reached[y][x] if z <= 1.01 * z_min]
                value[y, x] = sum(w * v for w, v in chosen) / sum(w for w, _ in chosen)
                nearest[y, x] = z_min
    return value, nearest


def filled(value, depth):
    """Unknown pixels from the farther of the next known ones in the row, else in the column."""
    result = value.copy()
    for y, x in np.argwhere(np.isnan(value)):
        for line, where in ((slice(None), "row"), (slice(None), "column")):
            values = value[y, line] if where == "row" else value[line, x]
            depths = depth[y, line] if where == "row" else depth[line, x]
            at = x if where == "row" else y
            known = np.flatnonzero(~np.isnan(values))
            if known.size:
                near = [k for k in (known[known < at][-1:], known[known > at][:1]) if k.size]
                picks = [int(k[0]) for k in near]
                if len(picks) == 2:
                    low, high = sorted(depths[p] for p in picks)
                    same = low == high or high <= 1.01 * low
                    picks.sort(key=lambda p: abs(p - at) if same else -depths[p])
                result[y, x] = values[picks[0]]
                break
    return result


def frame(a, b, f):
    """Equations (5) to (7): B first, A where B has nothing, the background where neither has."""
    from_b, z_b = splatted(b["image"], b["depth"], a["depth"], b["motion"], 1.0, 1 - f)
    from_a, z_a = splatted(a["image"], a["depth"], b["depth"], a["motion"], -1.0, f)
    holes = np.isnan(from_b)
    value = np.where(holes, from_a, from_b)
    return filled(value, np.where(holes, z_a, z_b)), int(np.isnan(value).sum())


def keyframe(rng, kind):
    """Blocks at three depths (one of them sky) with a little relief, moving by multiples of 1/64 px."""
    layer = rng.integers(0, 3, (3, 4)).repeat(4, 0).repeat(4, 1)[:H, :W]
    depth = np.array([1.0, 2.5, np.inf])[layer] * rng.uniform(1, 1.003, (H, W))
    step = rng.integers(-384, 384, (3, 4, 2)).repeat(4, 0).repeat(4, 1)[:H, :W] / 64.0
    if kind == "relief":
        step = step + rng.integers(-20, 20, (H, W, 2)) / 64.0
    if kind == "part":
        step = np.where((layer == 0)[..., None], step, 0.0)
    image = np.exp(rng.uniform(-9, 9, (H, W)))
    return {"image": image.astype(np.float32), "depth": depth.astype(np.float32), "motion": step.astype(np.float32)}


def view(key, device):
    return KeyframeView(
        *(wp.array(key[n][None], dtype=wp.float32, device=device) for n in ("image", "depth", "motion"))
    )


def make(where, upsampling):
    """`gpu kernels` are those of the GPU, run on the CPU."""
    if where == "cpu":
        return SplatCpu(H, W, 1, upsampling, 0, 1)
    return SplatCuda(H, W, 1, upsampling, 0, 1, "cuda" if where == "cuda" else "cpu")


@pytest.mark.parametrize("where", ["cpu", "gpu kernels", CUDA])
@pytest.mark.parametrize("kind", ["blocks", "relief", "part"])
@pytest.mark.parametrize("seed", range(3))
def test_frames_are_those_of_the_equations(seed, kind, where):
    rng = np.random.default_rng(seed)
    a, b = keyframe(rng, kind), keyframe(rng, kind)
    if kind == "part":
        b["depth"][a["motion"][..., 0] == 0] = a["depth"][a["motion"][..., 0] == 0]
    device = "cuda" if where == "cuda" else "cpu"
    upsampling = 4
    out = np.empty((1, upsampling, H, W), np.float32)
    report = make(where, upsampling).between(view(a, device), view(b, device), [False], out)
    # The GPU's whole numbers have 28 bits below the brightest source of a target.
    atol = 0.0 if where == "cpu" else 2.0**-28 * max(a["image"].max(), b["image"].max())
    unknown = 0
    for i in range(1, upsampling):
        expected, count = frame(a, b, i / upsampling)
        unknown += count
        np.testing.assert_allclose(out[0, i - 1], expected, RTOL, atol, err_msg=f"frame {i}")
    assert report.filled == unknown
    np.testing.assert_array_equal(out[0, -1], b["image"])


@pytest.mark.parametrize("where", ["cpu", "gpu kernels", CUDA])
@pytest.mark.parametrize(("apart", "share"), [(0.0095, 0.5), (0.0105, 0.0)])
def test_a_surface_is_one_percent_deep(apart, share, where):
    """Columns at two depths move by half a pixel, so that two of them meet in every target: both count up to 1 %."""
    far = np.arange(W) % 2 == 1
    motion = np.zeros((H, W, 2), np.float32)
    motion[..., 0] = 1.0
    image = np.tile(np.where(far, 8.0, 2.0), (H, 1)).astype(np.float32)
    depth = [np.tile(np.where(way, 1 + apart, 1.0), (H, 1)).astype(np.float32) for way in (~far, far)]
    device = "cuda" if where == "cuda" else "cpu"
    views = [view({"image": image, "depth": d, "motion": motion}, device) for d in depth]
    out = np.empty((1, 2, H, W), np.float32)
    make(where, 2).between(*views, [False], out)
    np.testing.assert_allclose(out[0, 0, :, 1:-1], 2.0 + 6.0 * share, rtol=1e-5)


def test_the_cases_have_holes_and_fills():
    """The random keyframes above exercise A and the fill: otherwise the comparison would say little."""
    rng = np.random.default_rng(0)
    a, b = keyframe(rng, "blocks"), keyframe(rng, "blocks")
    from_b, _ = splatted(b["image"], b["depth"], a["depth"], b["motion"], 1.0, 0.5)
    assert np.isnan(from_b).sum() > 5
    assert frame(a, b, 0.5)[1] > 0


@pytest.mark.parametrize("device", ["cpu", CUDA])
def test_the_kernels_of_a_gpu_give_the_frames_of_a_cpu(device):
    """Colour, a margin, environments of which one begins an episode, values of every size and some that are none."""
    rng = np.random.default_rng(11)
    keys = [[keyframe(rng, kind) for kind in ("blocks", "relief", "part")] for _ in range(3)]
    images = np.exp(rng.uniform(-25, 12, (3, 3, H, W, 3))).astype(np.float32)
    images[1, 0, 4, 5, 1], images[1, 1, 2, 2, 0] = np.nan, np.inf
    views = {}
    for where in ("cpu", device):
        stacked = lambda k, name: np.stack([key[name] for key in keys[k]])
        arrays = [(images[k], stacked(k, "depth"), stacked(k, "motion")) for k in range(3)]
        views[where] = [KeyframeView(*(wp.array(a, dtype=wp.float32, device=where) for a in group)) for group in arrays]
    methods = [SplatCpu(H, W, 3, 5, 2, 3), SplatCuda(H, W, 3, 5, 2, 3, device)]
    for k, held in enumerate(([False] * 3, [False, True, False])):
        out = np.empty((2, 3, 5, H - 4, W - 4, 3), np.float32)
        both = zip(methods, ("cpu", device), out)
        reports = [method.between(views[w][k], views[w][k + 1], held, frames) for method, w, frames in both]
        assert reports[0] == reports[1]
        assert (np.isfinite(out[0]) == np.isfinite(out[1])).all()
        assert np.isfinite(out).mean() > 0.9 and (k == 1 or not np.isfinite(out).all())
        # A dark pixel beside a bright one is a sum of both in float32 on the CPU.
        finite = np.isfinite(out[0])
        np.testing.assert_allclose(out[1][finite], out[0][finite], rtol=RTOL, atol=2.0**-50 * np.exp(12))


def ramps(where, stamps):
    """Frames [4, H, W] of each gap of a ramp that moves by 4 px in 20 ms, and what they should be."""
    device = "cuda" if where == "cuda" else "cpu"
    method = Splat(make(where, 4), 1)
    flat, columns = np.ones((H, W), np.float32), np.broadcast_to(np.arange(W, dtype=np.float64), (H, W))
    path = np.asarray(stamps) * 4 / 20_000_000
    views = []
    for k, at in enumerate(path):
        motion = np.zeros((H, W, 2), np.float32)
        motion[..., 0] = path[max(k - 1, 0)] - at
        views.append(view({"image": (100 + columns - at).astype(np.float32), "depth": flat, "motion": motion}, device))
        views[-1].stamp_ns = int(stamps[k])
    made = []
    for k in range(1, len(views)):
        out = np.empty((1, 4, H, W), np.float32)
        method.between(views[k - 1], views[k], [False], out)
        made.append(out[0])
    places = [path[k - 1] + (path[k] - path[k - 1]) * np.arange(1, 5) / 4 for k in range(1, len(views))]
    return made, [100 + columns - place[:, None, None] for place in places]


@pytest.mark.parametrize("where", ["cpu", "gpu kernels", CUDA])
def test_what_a_fills_goes_on_at_its_speed_whatever_the_gap_before(where):
    """What comes in from the right is A's alone, and goes as far as in the gap's own time."""
    made, expected = ramps(where, np.array([0, 20, 40, 80, 120, 140, 160]) * 1_000_000)
    for frames, truth in list(zip(made, expected))[1:]:
        # Positions lie on a grid of 1/4096 px.
        np.testing.assert_allclose(frames[:, :, 8:], truth[:, :, 8:], atol=1e-3)


@pytest.mark.parametrize("where", ["cpu", "gpu kernels", CUDA])
def test_gaps_that_differ_by_rounding_are_equal_and_an_episode_has_none_before(where):
    """Frames are those of A's motion as it is, bit for bit."""
    method, plain = Splat(make(where, 4), 1), make(where, 4)
    device = "cuda" if where == "cuda" else "cpu"
    rng = np.random.default_rng(5)
    # The third keyframe begins an episode, the gap after which is longer than that before it.
    views = [view(keyframe(rng, "relief"), device) for _ in range(5)]
    for one, stamp in zip(views, (0, 33_333_333, 66_666_667, 130_000_000, 193_333_334)):
        one.stamp_ns = stamp
    for k in range(1, 5):
        outs = [np.empty((1, 4, H, W), np.float32) for _ in range(2)]
        for made_by, out in zip((method, plain), outs):
            made_by.between(views[k - 1], views[k], [k == 2], out)
        assert outs[0].tobytes() == outs[1].tobytes(), k
