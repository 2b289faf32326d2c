"""Turns measurements into 8-bit colours: tone mapping, depth, flow, instance and normal maps. Pure numpy."""

from __future__ import annotations

import functools

import numpy as np

from evis.media.colour import srgb_from_linear

UNKNOWN = np.array([214, 64, 214], np.uint8)
"""Colour of a value that is not a number, so that it cannot be taken for data."""
EMPTY = np.array([18, 20, 26], np.uint8)
"""Colour of sky, background and unlabelled pixels."""


@functools.cache
def _srgb_table() -> np.ndarray:
    return np.round(255 * srgb_from_linear(np.arange(4096) / 4095)).astype(np.uint8)


def oklch(lightness: np.ndarray, chroma: np.ndarray, hue: np.ndarray) -> np.ndarray:
    """Converts OKLCh colours (Ottosson 2020) to sRGB uint8 [..., 3]; hue in radians; clips what is out of gamut."""
    a, b = chroma * np.cos(hue), chroma * np.sin(hue)
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    middle = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = np.stack(
        [
            4.0767416621 * long - 3.3077115913 * middle + 0.2309699292 * short,
            -1.2684380046 * long + 2.6097574011 * middle - 0.3413193965 * short,
            -0.0041960863 * long - 0.7034186147 * middle + 1.7076147010 * short,
        ],
        axis=-1,
    )
    return np.round(255 * srgb_from_linear(np.clip(linear, 0, 1))).astype(np.uint8)


@functools.cache
def ramp() -> np.ndarray:
    """Makes 256 colours uint8 [256, 3] of monotone lightness: dark violet (0) over teal to light yellow (255)."""
    s = np.linspace(0, 1, 256)
    return oklch(0.24 + 0.71 * s, 0.10 + 0.10 * np.sin(np.pi * s), np.radians(295 - 190 * s))


@functools.cache
def _wheel() -> np.ndarray:
    """Makes flow colours uint8 [256 directions, 64 speeds, 3]: hue is the direction, brightness the speed."""
    angle = np.linspace(-np.pi, np.pi, 256, endpoint=False)[:, None]
    speed = np.linspace(0, 1, 64)[None, :]
    return oklch(0.19 + 0.61 * speed + 0 * angle, 0.19 * speed + 0 * angle, angle + 0 * speed)


@functools.cache
def _palette() -> np.ndarray:
    """Makes instance colours uint8 [256, 3]; 0 is the background. Neighbouring ids are a golden angle apart in hue."""
    k = np.arange(256)
    colours = oklch(0.68 + 0.09 * ((k % 3) - 1), np.full(256, 0.145), k * np.radians(137.50776))
    colours[0] = EMPTY
    return colours


class Smoothed:
    """Smooths display limits over time, so that the picture does not flicker; the first are taken at once."""

    def __init__(self, rate: float = 0.15) -> None:
        self._rate = rate
        self._value: np.ndarray | None = None

    def update(self, *limits: float) -> np.ndarray:
        """Takes the limits of a new frame and returns the smoothed ones, same length."""
        new = np.array(limits, np.float64)
        self._value = new if self._value is None else self._value + self._rate * (new - self._value)
        return self._value

    def value(self, *otherwise: float) -> np.ndarray:
        """Returns the limits as they are, or `otherwise` where there are none yet."""
        return np.array(otherwise) if self._value is None else self._value


def _sample(array: np.ndarray, most: int = 20000) -> np.ndarray:
    """Returns every n-th value of a flat view, at most about `most`: enough for percentiles."""
    flat = array.reshape(-1)
    return flat[:: max(1, flat.size // most)]


@functools.cache
def _codes() -> np.ndarray:
    """Tabulates the middle of all floats that share their upper 16 bits, 128 per octave: float32 [65536]; 0 of those
    that are not finite."""
    bits = (np.arange(1 << 16, dtype=np.uint32) << np.uint32(16)) | np.uint32(1 << 15)
    values = bits.view(np.float32)
    return np.where(np.isfinite(values), values, 0)


def tone_map(radiance: np.ndarray, exposure: Smoothed) -> tuple[np.ndarray, int]:
    """Maps linear radiance [H, W] or [H, W, 3] to a display image: uint8 of the same shape; counts bad pixels.

    Extended Reinhard curve L (1 + L / w^2) / (1 + L) (Reinhard et al. 2002, eq. 4): the median of the lit pixels goes
    to middle grey and the 99.5th percentile to white. Both limits move slowly. A pixel that is not finite becomes
    UNKNOWN (black in a grey image) and is counted. The curve is looked up by the upper half of each float, which is
    exact to one of the 255 steps and several times faster than computing it.
    """
    image = np.ascontiguousarray(radiance, np.float32)
    code = (image.view(np.uint32) >> np.uint32(16)).astype(np.uint16)
    bad = (code & np.uint16(0x7F80)) == np.uint16(0x7F80)
    count = 0
    if bad.any():
        bad = bad.any(axis=-1) if image.ndim == 3 else bad
        count = int(np.count_nonzero(bad))
    limits = _limits(image)
    middle, white = exposure.value(0.0, 1.0) if limits is None else exposure.update(*limits)
    top = 0.30 * np.exp(white - middle)
    level = np.clip(_codes() * np.float64(0.30 * np.exp(-middle)), 0, 1e6)
    curve = np.minimum(level * (1 + level / top**2) / (1 + level), 1)
    result = _srgb_table()[(curve * 4095).astype(np.uint16)][code]
    if count:
        result[bad] = UNKNOWN if image.ndim == 3 else 0
    return result, count


def _limits(image: np.ndarray) -> tuple[float, float] | None:
    """Returns the natural logs of the middle and the white level of an image [H, W] or [H, W, 3], from about 20 000
    pixels; None without any light."""
    pixels = image.reshape(-1, image.shape[-1]) if image.ndim == 3 else image.reshape(-1, 1)
    light = pixels[:: max(1, len(pixels) // 20000)].max(axis=-1)
    light = light[np.isfinite(light) & (light > 0)].astype(np.float64)
    if light.size == 0:
        return None
    bright = float(np.percentile(light, 99.5))
    middle = float(np.log(np.median(light[light >= 1e-3 * bright])))
    return middle, max(float(np.log(bright)), middle + 0.7)


def depth_colours(depth: np.ndarray, limits: Smoothed) -> tuple[np.ndarray, float, float, int]:
    """Colours depth [H, W] in metres as uint8 [H, W, 3], near bright; returns the limits [m] and the NaN pixels too.

    The scale is 1 / z between the 1st and 99th percentile. +inf (sky) is EMPTY; NaN and what lies behind the camera
    are UNKNOWN and counted.
    """
    z = np.asarray(depth, np.float32)
    known = np.isfinite(z) & (z > 0)
    sky = np.isposinf(z)
    # Of what is nearer 1 / z is no number of float32 any more.
    inverse = 1 / np.maximum(np.where(known, z, 1), np.finfo(np.float32).tiny)
    values = _sample(inverse[known])
    far, near = limits.update(*np.percentile(values, [1, 99])) if values.size else limits.value(0.5, 1.0)
    span = max(near - far, 1e-3 * near)
    index = np.clip((inverse - far) * (235 / span) + 20, 0, 255).astype(np.uint8)
    result = ramp()[index]
    result[sky] = EMPTY
    bad = ~(known | sky)
    result[bad] = UNKNOWN
    return result, float(1 / near), float(1 / far) if far > 0 else float("inf"), int(np.count_nonzero(bad))


def flow_colours(flow: np.ndarray, limit: Smoothed) -> tuple[np.ndarray, float, int]:
    """Colours flow [H, W, 2] as uint8 [H, W, 3]: hue is the direction, brightness the speed.

    Returns the full scale too.

    Full scale is the 99th percentile of the moving pixels. Not finite is EMPTY (sky has no flow) and counted.
    """
    uv = np.asarray(flow, np.float32)
    known = np.asarray(np.isfinite(uv).all(axis=-1))
    uv = np.clip(np.where(known[..., None], uv, 0), -1e9, 1e9)
    speed = np.hypot(uv[..., 0], uv[..., 1])
    moving = _sample(speed[speed > 1e-3])
    (full,) = limit.update(max(float(np.percentile(moving, 99)), 1e-3)) if moving.size else limit.value(1.0)
    direction = np.arctan2(uv[..., 1], uv[..., 0])
    column = ((direction + np.pi) * (256 / (2 * np.pi))).astype(np.int64) % 256
    row = np.minimum(speed * (63 / full), 63).astype(np.int64)
    result = _wheel()[column, row]
    result[~known] = EMPTY
    return result, float(full), int(known.size - np.count_nonzero(known))


def id_colours(ids: np.ndarray) -> np.ndarray:
    """Colours instance ids [H, W] as uint8 [H, W, 3]; 0 (background) is EMPTY, negative ids are UNKNOWN."""
    index = np.where(ids > 0, (np.asarray(ids, np.int64) - 1) % 255 + 1, 0)
    result = _palette()[index]
    result[ids < 0] = UNKNOWN
    return result


def id_colour(instance: int) -> str:
    """Returns the CSS colour of one instance id, as in `id_colours`."""
    r, g, b = id_colours(np.array([[instance]]))[0, 0]
    return f"#{r:02x}{g:02x}{b:02x}"


def normal_colours(normal: np.ndarray) -> tuple[np.ndarray, int]:
    """Colours unit normals [H, W, 3] as uint8 (n + 1) / 2.

    The zero vector (sky) is EMPTY, not finite UNKNOWN and counted.
    """
    n = np.asarray(normal, np.float32)
    bad = np.asarray(~np.isfinite(n).all(axis=-1))
    result = (np.clip(np.where(bad[..., None], 0, n), -1, 1) * 127.5 + 127.5).astype(np.uint8)
    result[(n == 0).all(axis=-1)] = EMPTY
    result[bad] = UNKNOWN
    return result, int(np.count_nonzero(bad))
