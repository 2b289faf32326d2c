"""Measures the albedo scale of surfaces: the lengths over which ln albedo goes up or down."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.media.colour import REC709
from evis.scene.model import Material, Scene
from nodes.renderer.geometry.triangles import Geometry

ONE_COLOUR = 1.0e30
"""Stands for the albedo scale of what is of one colour [m]."""
DARKEST = 1e-3
"""Albedo below which differences do not matter."""
SWING = 1.0
"""Change of ln albedo that counts as a whole swing, where a texture has more."""
MOST_TEXELS = 1024
"""Texels along a side of a texture that are looked at; of a larger one every n-th, and windows of neighbouring ones."""
WINDOW = 64
"""Texels along a side of a window, of which there is one in each of BLOCKS x BLOCKS parts of a large texture."""
BLOCKS = 16
"""Parts along each side of a texture, of which the one with the finest scale counts."""

BENT = 0.25
"""Part of the length over which colours of corners go up or down that counts as their scale: they bend at every edge,
and no filter rounds that, as one does with textures. A lump whose triangles are 1.5 px wide has errors of 0.090, 0.049
and 0.021 with 0.8, 0.3 and 0.1 ms, and of 0.122, 0.069 and 0.034 with all of that length, in the same time."""

SPACING, FINEST_SPACING = 0.6, 0.15
"""Least ways between two samples, of a pixel's width along that way, for textures are filtered to that: peaks between
two of them are found by halving. The first is that with 0.3 ms; with 0.5 tunnel_exit has 5 % more samples, and 0.033 in
place of 0.034."""
WHOLE_NS = 140_000
"""Tolerance of time [ns] below which the way is shorter in proportion. With 0.1 ms and 0.43 px a torus with a fine
checker has an error of 0.070 in place of 0.109 in the same time, tunnel_exit 0.032 in place of 0.034 in 1.15 of it, the
disk at 346x260 0.0056 in place of 0.0060 in 1.12. With 0.3 px these two have a tenth less in a fifth more time."""


def least_spacing(tolerance_ns: float) -> float:
    """Computes the least way between two samples over what is painted, of a pixel's width, for a tolerance of time."""
    return max(SPACING * min(tolerance_ns / WHOLE_NS, 1.0), FINEST_SPACING)


def albedo_scale_of(scene: Scene, geometry: Geometry, least: float) -> np.ndarray:
    """Computes over which length float32 [T] [m] ln albedo goes up or down on each triangle, ONE_COLOUR without that.

    It is the swing of a texture, or of a triangle's colours, over the mean of its gradient's magnitude, or how wide
    things on the texture are, if that is less. least: change of ln albedo that matters.
    """
    albedo_scale = np.full(len(geometry.triangles), ONE_COLOUR, np.float32)
    corners = geometry.vertices[geometry.triangles].astype(np.float64)
    known: dict[int, tuple[float, float] | None] = {}
    for number, instance in enumerate(scene.instances):
        own = slice(int(geometry.first[number]), int(geometry.first[number + 1]))
        if instance.material not in known:
            known[instance.material] = _of_texture(scene.materials[instance.material], least)
        fine = known[instance.material]
        if fine is not None and instance.mesh.uv is not None:
            along_u, along_v = _per_unit(corners[own], np.asarray(instance.mesh.uv, np.float64))
            albedo_scale[own] = np.minimum(np.minimum(along_u * fine[0], along_v * fine[1]), ONE_COLOUR)
        if instance.mesh.colours is not None:
            albedo_scale[own] = np.minimum(albedo_scale[own], _of_colours(corners[own], instance.mesh.colours, least))
    return albedo_scale


def _of_texture(material: Material, least: float) -> tuple[float, float] | None:
    """Computes the albedo scale along u and v, in units of these; None of what is even."""
    if material.texture is None:
        return None
    height, width = material.texture.shape[:2]
    step = -(-max(height, width) // MOST_TEXELS)
    log = _log_albedo(material, slice(None, None, step), slice(None, None, step))
    swing = float(log.max() - log.min())
    scales = [ONE_COLOUR, ONE_COLOUR]
    if swing >= least:
        scales = [_swings_over(*_along(lines, least), swing) for lines in (log, log.T)]
    if step > 1:
        windows = _windows(material)
        swing = max(float(np.ptp(window)) for window in windows)
        for k, size in enumerate((width, height) if swing >= least else ()):
            fine = _swings_over(*_in_windows([(w, w.T)[k] for w in windows], size, least), swing)
            # What repeats every so many texels is even where every n-th is looked at; what is longer is seen there.
            if fine * size < 2 * step:
                scales[k] = min(scales[k], fine)
    return None if min(scales) >= ONE_COLOUR else (scales[0], scales[1])


def _swings_over(steep: float, wide: float, swing: float) -> float:
    """Computes the albedo scale from what `_along` gives, and from the greatest change of ln albedo."""
    return min(swing, SWING) * min(1.0 / max(steep, 1e-12), wide / swing)


def _log_albedo(material: Material, rows: slice, columns: slice) -> np.ndarray:
    """Computes ln albedo float32 of some texels of a material's texture."""
    assert material.texture is not None
    shown = np.asarray(material.texture[rows, columns], np.float32) * np.asarray(material.albedo, np.float32)
    return np.asarray(np.log(np.maximum(shown @ np.array(REC709, np.float32), DARKEST)))


def _windows(material: Material) -> list[np.ndarray]:
    """Gives ln albedo of a window of neighbouring texels in each part of a texture."""
    assert material.texture is not None
    starts = [np.unique(np.arange(BLOCKS) * size // BLOCKS) for size in material.texture.shape[:2]]
    return [_log_albedo(material, slice(y, y + WINDOW), slice(x, x + WINDOW)) for y in starts[0] for x in starts[1]]


def _in_windows(windows: Sequence[np.ndarray], size: int, least: float) -> tuple[float, float]:
    """Computes what `_along` does, of the window in which the gradient is greatest; size: of a line of the texture."""
    steep = [float(np.abs(np.diff(window, axis=1)).mean()) if window.shape[1] > 1 else 0.0 for window in windows]
    finest = windows[int(np.argmax(steep))]
    return max(steep) * size, _width(finest, slice(0, finest.shape[1]), least) / size


def _along(lines: np.ndarray, least: float) -> tuple[float, float]:
    """Computes how ln albedo changes along lines, in units of their length: the mean magnitude of the gradient in the
    block where it is greatest, and how wide things are there.

    Joints between bricks are few, so that the gradient alone tells of a length much greater than their width.
    """
    change = np.abs(np.diff(lines, axis=1, append=lines[:, :1]))
    rows, columns = (np.append(np.unique(np.arange(BLOCKS) * size // BLOCKS), size) for size in lines.shape)
    sums = np.add.reduceat(np.add.reduceat(change, rows[:-1], 0), columns[:-1], 1)
    means = sums / np.outer(np.diff(rows), np.diff(columns))
    row, column = np.unravel_index(means.argmax(), means.shape)
    across, along = slice(rows[row], rows[row + 1]), slice(columns[column], columns[column + 1])
    return float(means.max()) * lines.shape[1], _width(lines[across], along, least) / lines.shape[1]


def _width(lines: np.ndarray, along: slice, least: float) -> int:
    """Computes how wide [texels] things are at most that make half of the change of ln albedo along part of lines.

    A thing is brighter, or darker, than what is on both of its sides, by more than `least`."""
    size = lines.shape[1]
    total = np.abs(np.diff(lines, axis=1, append=lines[:, :1]))[:, along].sum()
    low, high = 0, size
    while total > 0 and high - low > 1:
        width = (low + high) // 2
        # An opening and a closing (Serra, Image Analysis and Mathematical Morphology, 1982) take away what is no wider.
        wider = _extreme(_extreme(lines, width, np.minimum), width, np.maximum)
        wider = _extreme(_extreme(np.roll(wider, width, 1), width, np.maximum), width, np.minimum)
        wider = np.roll(wider, width, 1)
        left = np.where(np.abs(wider - lines) > least, wider, lines)
        remains = np.abs(np.diff(left, axis=1, append=left[:, :1]))[:, along].sum()
        low, high = (low, width) if 2 * remains <= total else (width, high)
    return high


def _extreme(lines: np.ndarray, width: int, of_two: np.ufunc) -> np.ndarray:
    """Finds the least or the greatest of each texel and as many as `width` after it, of lines that repeat."""
    known = 1
    while known <= width:
        step = min(known, width + 1 - known)
        lines = of_two(lines, np.roll(lines, -step, 1))
        known += step
    return lines


def _per_unit(corners: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes the length [m] of a unit of u and of v on triangles, float64 [F]; corners [F, 3, 3], uv [F, 3, 2]."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    (u1, v1), (u2, v2) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1.0 / np.abs(u1 * v2 - u2 * v1)
        along_u = np.linalg.norm(v2[:, None] * first - v1[:, None] * second, axis=1) * over
        along_v = np.linalg.norm(u1[:, None] * second - u2[:, None] * first, axis=1) * over
    return _finite(along_u), _finite(along_v)


def _finite(albedo_scale: np.ndarray) -> np.ndarray:
    """Replaces what no number tells, of triangles without area in space or in the texture, by ONE_COLOUR."""
    return np.nan_to_num(albedo_scale, nan=ONE_COLOUR, posinf=ONE_COLOUR)


def _of_colours(corners: np.ndarray, colours: np.ndarray, least: float) -> np.ndarray:
    """Computes the albedo scale [m] of coloured triangles: BENT of the length over which ln albedo goes from the least
    to the greatest of their corners', and how high they are where it is another one beyond an edge.

    corners, colours [F, 3, 3].
    """
    log = np.log(np.maximum(np.asarray(colours, np.float64) @ np.array(REC709), DARKEST))
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    twice = np.linalg.norm(normal, axis=1)
    rise = log[:, 1:] - log[:, :1]
    steep = np.linalg.norm(rise[:, :1] * np.cross(second, normal) + rise[:, 1:] * np.cross(normal, first), axis=1)
    swing = np.ptp(log, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        albedo_scale = np.where(swing >= least, BENT * np.minimum(swing, SWING) * twice**2 / steep, ONE_COLOUR)
        high = twice / np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    albedo_scale = np.where(_changes_beyond(corners, log) >= least, np.minimum(albedo_scale, high), albedo_scale)
    # What has no area is never seen.
    return np.where(twice > 0, _finite(albedo_scale), ONE_COLOUR)


def _changes_beyond(corners: np.ndarray, log: np.ndarray) -> np.ndarray:
    """Computes the greatest jump of ln albedo over an edge of each triangle, float64 [F]; corners [F, 3, 3], log
    [F, 3]. Triangles share an edge whose ends lie at the same places, turned either way."""
    count = len(corners)
    _, place = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    place = place.reshape(count, 3)
    start, end = place.ravel(), np.roll(place, -1, axis=1).ravel()
    values = np.stack([log.ravel(), np.roll(log, -1, axis=1).ravel()], axis=1)
    turned = start > end
    values[turned] = values[turned, ::-1]
    edge = np.minimum(start, end) * (3 * count) + np.maximum(start, end)
    order = np.argsort(edge, kind="stable")
    edge, values = edge[order], values[order]
    same = edge[1:] == edge[:-1]
    jump = np.where(same, np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0), 0.0)
    over = np.zeros(3 * count)
    # Of two that are neighbours in this order each has the edge.
    np.maximum.at(over, order[1:], jump)
    np.maximum.at(over, order[:-1], jump)
    return over.reshape(count, 3).max(axis=1)
