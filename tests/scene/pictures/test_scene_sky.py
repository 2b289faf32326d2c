"""Environment maps: EXR files written by the reference library, and skies by code against closed forms."""

import numpy as np
import OpenEXR
import pytest

from evis.scene import SceneError, load_scene
from evis.scene.images.sky import directions, mean_radiance, solid_angles

HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def box(low, high):
    """A window of a header, from its first pixel to its last."""
    return np.array(low, "i4"), np.array(high, "i4")


WHOLE = box((0, 0), (15, 7))


@pytest.fixture
def load(tmp_path):
    def load(environment_map, more=""):
        (tmp_path / "s.yaml").write_text(f"cameras: {{cam0: {{fov: 1}}}}\nenvironment_map: {environment_map}\n{more}")
        return load_scene(str(tmp_path / "s.yaml"))

    return load


def write(path, channels, **more):
    with OpenEXR.File(HEADER | more, {k: np.ascontiguousarray(v) for k, v in channels.items()}) as file:
        file.write(str(path))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_comes_as_it_is(load, tmp_path, dtype):
    """Half and float, linear, row 0 first; beyond the range of 8 bits."""
    image = np.random.default_rng(1).uniform(0, 5e4, (8, 16, 3)).astype(dtype)
    write(tmp_path / "sky.exr", {"RGB": image})
    scene = load("sky.exr")
    assert scene.environment_map.dtype == np.float32 and np.array_equal(scene.environment_map, image.astype(np.float32))
    write(tmp_path / "grey.exr", {"Y": image[..., 0]})
    assert np.array_equal(load("grey.exr").environment_map, np.repeat(image[..., :1].astype(np.float32), 3, axis=2))


@pytest.mark.parametrize("rows, columns", [(slice(2, 7), slice(3, 12)), (slice(0, 3), slice(9, 16))])
def test_a_map_stored_in_part_lies_where_it_is(load, tmp_path, rows, columns):
    """Programs leave out what is black round a picture, or store more than it: the same map either way."""
    image = np.zeros((8, 16, 3), np.float32)
    image[rows, columns] = np.random.default_rng(2).uniform(1, 9, image[rows, columns].shape)
    low, high = (columns.start, rows.start), (columns.stop - 1, rows.stop - 1)
    write(tmp_path / "part.exr", {"RGB": image[rows, columns]}, dataWindow=box(low, high), displayWindow=WHOLE)
    assert np.array_equal(load("part.exr").environment_map, image)
    wide = np.pad(image, ((1, 2), (3, 1), (0, 0)), constant_values=5)
    write(tmp_path / "wide.exr", {"RGB": wide}, dataWindow=box((-3, -1), (16, 9)), displayWindow=WHOLE)
    assert np.array_equal(load("wide.exr").environment_map, image)


def test_the_mean_is_over_directions(load, tmp_path):
    """A map that is z^2 has the mean 1/3; it becomes the environment unless the scene gives one."""
    image = np.repeat(directions(64)[..., 2:].astype(np.float32) ** 2, 3, axis=2)
    write(tmp_path / "sky.exr", {"RGB": image})
    assert np.allclose(load("sky.exr").environment, 1 / 3, atol=1e-3)
    assert np.allclose(load("sky.exr", "environment: 7\n").environment, 7)


def test_bad_exr_files_are_one_line(load, tmp_path):
    """Not there, no EXR, cut off, NaN, infinite, negative, no colour: each names the file."""
    image = np.ones((8, 16, 3), np.float32)
    write(tmp_path / "good.exr", {"RGB": image})
    (tmp_path / "text.exr").write_text("sky")
    (tmp_path / "short.exr").write_bytes((tmp_path / "good.exr").read_bytes()[:-40])
    for name, value in (("nan", np.nan), ("inf", np.inf), ("dark", -1.0)):
        bad = image.copy()
        bad[2, 3, 1] = value
        write(tmp_path / f"{name}.exr", {"RGB": bad})
    write(tmp_path / "depth.exr", {"Z": image[..., 0]})
    for name, words in (
        ("gone.exr", "which is not in"),
        ("text.exr", "cannot be read as EXR.*convert it"),
        ("short.exr", "cannot be read as EXR"),
        ("nan.exr", "has 1 texels that are not finite, the first in row 2, column 3"),
        ("inf.exr", "has 1 texels that are not finite"),
        ("dark.exr", "has radiance below 0"),
        ("depth.exr", "has no R, G and B, and no Y, of half or float; it has Z .float."),
    ):
        with pytest.raises(SceneError, match=rf"s\.yaml:2: .*{name}.*{words}") as caught:
            load(name)
        assert "\n" not in str(caught.value)


def test_a_header_that_promises_too_much_is_refused_unread(load, tmp_path):
    """The data window says 2^40 texels; nothing of that size is asked for."""
    image = np.ones((8, 16, 3), np.float32)
    write(tmp_path / "huge.exr", {"RGB": image})
    data = bytearray((tmp_path / "huge.exr").read_bytes())
    at = data.index(b"dataWindow\x00box2i\x00") + len(b"dataWindow\x00box2i\x00") + 4
    data[at + 8 : at + 16] = np.array([(1 << 20) - 1] * 2, "<i4").tobytes()
    (tmp_path / "huge.exr").write_bytes(data)
    with pytest.raises(SceneError, match=r"huge\.exr (is of 1048576 x 1048576 px|cannot be read)"):
        load("huge.exr")


def test_rows_and_columns():
    """Row 0 is up; the first columns are at +x and turn to +y; solid angles add up to the sphere."""
    d = directions(90)
    assert d.shape == (90, 180, 3) and np.allclose(np.linalg.norm(d, axis=-1), 1)
    assert d[0, :, 2].min() > 0.999 and np.allclose(d[45, [0, 45]], [[1, 0, 0], [0, 1, 0]], atol=0.02)
    assert np.isclose(solid_angles(90).sum() * 180, 4 * np.pi)
    assert np.allclose(mean_radiance(np.full((90, 180, 3), 2.0)), 2)


@pytest.mark.parametrize("size", ["0.533 deg", "8 deg"])
def test_the_sun_has_its_irradiance(load, size):
    """However small it is next to a texel: the integral of radiance times cosine over the disc, on a facing surface."""
    towards = np.array([0.6, 0.0, 0.8])
    sun = f"{{towards: [3, 0, 4], irradiance: 900, size: {size}}}"
    image = load(f"{{kind: sky, zenith: 0, horizon: 0, ground: 0, rows: 128, sun: {sun}}}").environment_map
    weight = np.maximum(directions(128) @ towards, 0) * solid_angles(128)[:, None]
    assert np.isclose((image[..., 1] * weight).sum(), 900, rtol=3e-3)  # the cosine over 4 deg is 0.998 on average
    row, column = np.unravel_index(image[..., 0].argmax(), image.shape[:2])
    assert directions(128)[row, column] @ towards > np.cos(np.radians(5))


def test_sky_studio_and_tunnel(load):
    """Colours where they were asked for."""
    sky = load("{kind: sky, zenith: [1, 2, 3], horizon: [4, 5, 6], ground: 0.5, rows: 256}").environment_map
    assert np.allclose(sky[0, 0], [1, 2, 3], rtol=1e-3) and np.allclose(sky[127, 9], [4, 5, 6], rtol=0.1)
    assert np.all(sky[128:] == 0.5)
    panel = "{towards: [0, 1, 0], size: [40 deg, 20 deg], radiance: 9}"
    studio = load(f"{{kind: studio, wall: 0.1, rows: 180, panels: [{panel}]}}").environment_map[..., 0]
    # On the equator 40 of 360 degrees, one texel per degree; up and down at its middle 20 of 180.
    assert (studio[90] == 9).sum() == 40 and (studio[:, 90] == 9).sum() == 20 and (studio[90, 70:110] == 9).all()
    tunnel = "{kind: tunnel, wall: 0.01, outside: 1e4, towards: [0, 0, 1], size: 60 deg, rows: 180}"
    tunnel = load(tunnel).environment_map
    assert (tunnel[:29] == 1e4).all() and (tunnel[32:] == np.float32(0.01)).all()


@pytest.mark.parametrize(
    "value, words",
    [
        ("{kind: skye}", "kind is 'skye'; did you mean 'sky'"),
        ("{kind: sky, sum: 1}", "sum is not known here"),
        ("{kind: sky, sun: {towards: [0, 0, 0], irradiance: 1}}", "towards is zero"),
        ("{kind: sky, sun: {towards: [0, 0, 1], irradiance: 1, size: 200 deg}}", "size must lie between"),
        ("{kind: studio, panels: {towards: [0, 0, 1], radiance: 1, size: [1, 4]}}", "size must be two angles"),
        ("{kind: studio, panels: {towards: [0, 0, 1], radiance: 1, size: 0.6}}", "size must be two angles"),
        ("{kind: tunnel, wall: -1}", "wall is -1; the least is 0"),
    ],
)
def test_mistakes(load, value, words):
    """One line with file and line."""
    with pytest.raises(SceneError, match=rf"s\.yaml:2: .*{words}"):
        load(value)
