"""Gathers the light of an exposure, and reads it out as pixels: EMVA 1288's linear camera model."""

import warp as wp

from nodes.frame_camera.noise_kernels import electrons_of, stream_of_pixel, two_normals

wp.set_module_options({"enable_backward": False})

IDLE = wp.constant(0)
BEGIN = wp.constant(1)
GO_ON = wp.constant(2)
"""What a gap does to an environment's exposure."""
CLIPPED = wp.constant(0)
NONFINITE = wp.constant(1)
LEVEL = wp.constant(2)
"""What a readout sums up for each environment: pixels, pixels, and levels of all pixels in LEVEL_STEPS."""
LEVEL_STEPS = wp.constant(wp.float64(65536.0))


@wp.struct
class Readout:
    """Holds what the readout knows of the sensor. Electrons, and shares of full scale."""

    sensitivity: wp.float64  # electrons per second and radiance
    full_well: wp.float64
    dark_current: wp.float64  # electrons per second
    read_noise: wp.float64  # electrons
    photon_noise: wp.int32
    gain: wp.float64
    black_level: wp.float64
    inverse_gamma: wp.float64
    largest: wp.float64  # of a pixel's values, 2^bits - 1
    shift: wp.uint32  # to the upper bits of 16
    metered: wp.int32  # whether levels are summed up, for auto-exposure


@wp.kernel
def expose(
    frames: wp.array3d(dtype=wp.float32),
    before: wp.array2d(dtype=wp.float32),
    weights: wp.array3d(dtype=wp.float64),
    span: wp.array2d(dtype=wp.int32),
    row: wp.int32,
    mode: wp.array(dtype=wp.int32),
    slot: wp.array(dtype=wp.int32),
    light: wp.array3d(dtype=wp.float64),
):
    """Adds the light of a gap to exposures. frames [E, K, P]; before [E, P], the frame at the gap's start; weights
    [E, R, K + 1]; span [E, 2], the first and last weight that is not 0; row: values in a row of the image, where each
    has weights of its own; light [S, E, P], one of whose slots each environment adds to.
    """
    env, pixel = wp.tid()
    if mode[env] == IDLE:
        return
    line = wp.int32(0)
    if weights.shape[1] > 1:
        line = pixel / row
    total = wp.float64(0.0)
    if mode[env] == GO_ON:
        total = light[slot[env], env, pixel]
    k = span[env, 0]
    while k <= span[env, 1]:
        weight = weights[env, line, k]
        if weight != wp.float64(0.0):
            value = wp.float32(0.0)
            if k == 0:
                value = before[env, pixel]
            else:
                value = frames[env, k - 1, pixel]
            total += weight * wp.float64(value)
        k += 1
    light[slot[env], env, pixel] = total


@wp.kernel
def remember(
    frames: wp.array3d(dtype=wp.float32), moved: wp.array(dtype=wp.int32), before: wp.array2d(dtype=wp.float32)
):
    """Keeps the last frame of environments that have moved on, for the start of the next gap."""
    env, pixel = wp.tid()
    if moved[env] != 0:
        before[env, pixel] = frames[env, frames.shape[1] - 1, pixel]


@wp.func
def electrons_read(sensor: Readout, mean: wp.float64, seed: wp.uint64, value: wp.int32, number: wp.int64):
    """Draws the electrons in the well, before saturation, and the read noise in electrons, of a value of an image."""
    electrons = mean
    noise = wp.float64(0.0)
    if sensor.photon_noise != 0 or sensor.read_noise > wp.float64(0.0):
        stream = stream_of_pixel(seed, value)
        z = two_normals(stream, number)
        noise = sensor.read_noise * z[1]
        if sensor.photon_noise != 0:
            electrons = electrons_of(wp.min(mean, wp.float64(1.0e15)), z[0], stream, number)
    return electrons, noise


@wp.kernel
def read_out(
    light: wp.array3d(dtype=wp.float64),
    slot: wp.array(dtype=wp.int32),
    over: wp.array(dtype=wp.int32),
    exposure: wp.array(dtype=wp.float64),
    seed: wp.array(dtype=wp.uint64),
    number: wp.array(dtype=wp.int64),
    channels: wp.int32,
    sensor: Readout,
    pixels: wp.array2d(dtype=wp.uint16),
    sums: wp.array2d(dtype=wp.int64),
):
    """Makes pixels of gathered light. light [S, E, P], radiance times seconds; over [E], whose exposure has ended;
    exposure [s]; seed: stream of each environment; number: of the image, which keys its noise; channels: values of
    a pixel, side by side in P; pixels [E, P]; sums [E, 3]: clipped pixels, pixels whose light is not finite, levels.
    """
    env, pixel = wp.tid()
    if over[env] == 0:
        return
    strange = wp.int32(0)
    full = wp.int32(0)
    for value in range(pixel * channels, (pixel + 1) * channels):
        gathered = light[slot[env], env, value]
        if not wp.isfinite(gathered):
            # An infinite light is too bright like any other; what is no number has no level.
            strange = wp.int32(1)
            if gathered > wp.float64(0.0):
                gathered = wp.float64(1.0e30)
            else:
                gathered = wp.float64(0.0)
        mean = wp.max(gathered, wp.float64(0.0)) * sensor.sensitivity + sensor.dark_current * exposure[env]
        electrons, noise = electrons_read(sensor, mean, seed[env], value, number[env])
        if electrons > sensor.full_well:
            electrons = sensor.full_well
            full = wp.int32(1)
        level = sensor.gain * (electrons + noise) / sensor.full_well + sensor.black_level
        if level > wp.float64(1.0):
            level = wp.float64(1.0)
            full = wp.int32(1)
        level = wp.max(level, wp.float64(0.0))
        if sensor.metered != 0:
            wp.atomic_add(sums, env, LEVEL, wp.int64(level * LEVEL_STEPS))
        if sensor.inverse_gamma != wp.float64(1.0):
            level = wp.pow(level, sensor.inverse_gamma)
        read = wp.uint32(wp.floor(level * sensor.largest + wp.float64(0.5)))
        pixels[env, value] = wp.uint16(read << sensor.shift)
    # A pixel counts once, however many of its channels are at full scale.
    if strange != 0:
        wp.atomic_add(sums, env, NONFINITE, wp.int64(1))
    if full != 0:
        wp.atomic_add(sums, env, CLIPPED, wp.int64(1))
