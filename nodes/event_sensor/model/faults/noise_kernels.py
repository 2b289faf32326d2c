"""Draws shot noise and hot pixels: one Poisson process per pixel in continuous time, thinned with the light.

The light is that at each candidate's time, linear between frames; polarity is drawn evenly unless `shot_on_share` says
otherwise. Every event resets the pixel, as in silicon: after a shot, hot-pixel or coin event the reference is L at its
time, so that no later crossing is lost and no pixel goes deaf, and noise shifts the signal's events as it does in a
real pixel. Nothing of this knows the frame rate.
"""

import warp as wp

from evis.random_number_kernels import draw, mix, uniform
from nodes.event_sensor.model.faults.random_kernels import stream_of, waiting_time
from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})


@wp.func
def shot_accepted(mark: wp.float64, light: wp.float64, sensor: Sensor):
    """Tells whether a candidate of the shot noise fires, whose rate is shot_rate (1 - clip(I / white, 0, 1))."""
    return mark < wp.float64(1.0) - wp.clamp(light / sensor.shot_white, wp.float64(0.0), wp.float64(1.0))


@wp.func
def stream_here(sensor: Sensor, env: wp.int32, inner: wp.int32, episodes: wp.array2d(dtype=wp.int32), k: wp.int32):
    """Returns the stream of a pixel in the episode of frame k."""
    return stream_of(sensor.seed + wp.int64(env), inner, episodes[wp.min(k, 1), env])


@wp.func
def noise_candidate(
    sensor: Sensor, stream: wp.uint64, draws: wp.int64, rate: wp.float64, hot_share: wp.float64, light: wp.float64
):
    """Draws candidate number `draws` of the noise: whether it fires, whether ON, and the wait for the next [ns].

    Odd draws are marks (what the candidate is), even ones waiting times.
    """
    bits = draw(stream, wp.int64(2) * draws + wp.int64(1))
    mark = uniform(bits)
    on = (mix(bits) & wp.uint64(1)) != wp.uint64(0)
    fires = bool(True)
    if mark >= hot_share:
        if sensor.shot_on_share != wp.float64(0.5):
            on = uniform(mix(bits)) < sensor.shot_on_share
        fires = shot_accepted((mark - hot_share) / (wp.float64(1.0) - hot_share), light, sensor)
    wait = waiting_time(draw(stream, wp.int64(2) * (draws + wp.int64(1))), rate)
    return fires, on, wait


@wp.func
def candidate_after(
    here: wp.int64, stream: wp.uint64, candidate: wp.int64, draws: wp.int64, rate: wp.float64
):  # fmt: skip
    """Finds the first candidate of the noise that is later than `here`, and its number."""
    following = candidate
    number = draws
    while following <= here:
        number = number + wp.int64(1)
        following = following + waiting_time(draw(stream, wp.int64(2) * number), rate)
    return following, number
