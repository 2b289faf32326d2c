"""Kernels of the readout, on a CPU and in C++: a single-server queue, counter-based Gaussian delays, keys in order."""

import math

import warp as wp

from nodes.event_sensor.cpu.simd_kernels import LOG, filled_in
from nodes.event_sensor.model.pixel_kernels import Sensor

wp.set_module_options({"enable_backward": False})

REACH = wp.constant(wp.float64(3.0))
"""Standard deviations by which the jitter is centred and at which it is cut."""
STREAM = 0x7265_6164_6F75_74
"""Keeps these random numbers apart from others of the same seed."""
TERMS = 10
"""Of the series of the sine, up to the 19th power: to 3e-16 in a quarter of a turn."""


@wp.struct
class Queue:
    """Times in units of 2^-fraction ns after t_base. capacity 0: no limit. sigma [ns]."""

    service: wp.int64
    fraction: wp.int64
    capacity: wp.int64
    sigma: wp.float64
    seed: wp.uint64
    width: wp.int64
    height: wp.int64


QUEUE = """
    const wp::int64* asks = t.data;
    wp::int64* leaves_at = stamps.data;
    const int fraction = (int)queue.fraction;
    const wp::int64 up = ((wp::int64)1 << fraction) - 1;
    const wp::int64 longest = queue.capacity * queue.service;
    wp::int64 ready = free.data[env];
    wp::int64 waited = 0, together = 0, most = 0, dropped = 0;
    for (wp::int64 i = begin; i < end; i++) {
        const wp::int64 arrival = (asks[i] - t_base) << fraction;
        if (queue.capacity > 0 && ready - arrival > longest) {
            leaves_at[i] = -1;
            dropped++;
            continue;
        }
        const wp::int64 leaves = arrival > ready ? arrival : ready;
        ready = leaves + queue.service;
        // Up to the next whole ns: nothing leaves before its turn.
        const wp::int64 late = leaves > arrival ? t_base + ((leaves + up) >> fraction) - asks[i] : 0;
        leaves_at[i] = asks[i] + late;
        waited += leaves > arrival;
        together += late;
        most = late > most ? late : most;
    }
    free.data[env] = ready;
    wp::int64* found = statistics.data + 4 * env;
    found[0] = waited;
    found[1] = together;
    found[2] = most;
    found[3] = dropped;
"""


@wp.func_native(QUEUE)
def served(
    queue: Queue, env: wp.int32, begin: wp.int64, end: wp.int64, t_base: wp.int64, t: wp.array(dtype=wp.int64),
    free: wp.array(dtype=wp.int64), stamps: wp.array(dtype=wp.int64), statistics: wp.array2d(dtype=wp.int64),
):  # fmt: skip
    """Event i leaves at D_i = max(t_i, D_{i-1} + service); `free` is D_{i-1} + service."""
    ...


MIX = """
    // SplitMix64's output function (Steele, Lea and Flood, OOPSLA 2014).
    const auto mix = [](wp::uint64 h) {
        h += 0x9E3779B97F4A7C15ull;
        h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ull;
        h = (h ^ (h >> 27)) * 0x94D049BB133111EBull;
        return h ^ (h >> 31);
    };
    // In (0, 1), from the upper 53 bits.
    const auto uniform = [](wp::uint64 h) { return ((double)(wp::int64)(h >> 11) + 0.5) * 0x1p-53; };
"""
SINE = "0.0"
for _power in reversed(range(TERMS)):
    SINE = f"({(-1) ** _power * (2.0 * math.pi) ** (2 * _power + 1) / math.factorial(2 * _power + 1)!r} + q * {SINE})"
DELAY = """
    const wp::int64* asks = t.data;
    const wp::uint16* xs = x.data;
    const wp::uint16* ys = y.data;
    const wp::uint8* ps = p.data;
    const wp::uint8* cs = c.shape[0] > 0 ? c.data : nullptr;
    wp::int64* leaves_at = stamps.data;
    const wp::uint64 mine = mix(queue.seed + (wp::uint64)env) ^ STREAM;
    const double sigma = queue.sigma;
    const auto delayed = [&](wp::int64 i, wp::int64 channel) __attribute__((always_inline)) {
#pragma clang fp contract(off)
        const wp::int64 pixel = (channel * queue.height + ys[i]) * queue.width + xs[i];
        const wp::uint64 h = mix(mix(mine ^ (wp::uint64)(2 * pixel + ps[i])) ^ (wp::uint64)asks[i]);
        // Box and Muller; the cosine of a turn is the sine of a quarter less.
        const double radius = __builtin_sqrt(-2.0 * log_of(uniform(h)));
        const double w = __builtin_fabs(uniform(mix(h)) - 0.5) - 0.25;
        const double q = w * w;
        double normal = radius * (w * SINE);
        normal = normal > -REACH ? normal : -REACH;
        normal = normal < REACH ? normal : REACH;
        const wp::int64 late = (wp::int64)(sigma * (REACH + normal) + 0.5);
        leaves_at[i] = leaves_at[i] < 0 ? leaves_at[i] : leaves_at[i] + late;
    };
    if (cs)
        for (wp::int64 i = begin; i < end; i++) delayed(i, cs[i]);
    else
#pragma clang loop vectorize(assume_safety) vectorize_width(8) interleave_count(2)
        for (wp::int64 i = begin; i < end; i++) delayed(i, 0);
"""


@wp.func_native(filled_in(MIX + LOG + DELAY, SINE=SINE, STREAM=f"{STREAM}ull", REACH=f"{float(REACH)!r}"))
def jittered(
    queue: Queue, env: wp.int32, begin: wp.int64, end: wp.int64, t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16), y: wp.array(dtype=wp.uint16), p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8), stamps: wp.array(dtype=wp.int64),
):  # fmt: skip
    """Add sigma (REACH + N) [ns], N standard normal cut at +-REACH: never negative, of the event's own fields alone."""
    ...


@wp.kernel(module="unique")
def serve(
    # in
    queue: Queue,
    t_base: wp.int64,
    offsets: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8),
    # in and out: stamps are those of the events at first, -1 for dropped ones after
    free: wp.array(dtype=wp.int64),
    stamps: wp.array(dtype=wp.int64),
    # out: per environment events that waited, ns that all waited, longest wait, drops
    statistics: wp.array2d(dtype=wp.int64),
):
    """One environment per thread."""
    env = wp.tid()
    if queue.service > wp.int64(0):
        served(queue, env, offsets[env], offsets[env + 1], t_base, t, free, stamps, statistics)
    if queue.sigma > wp.float64(0.0):
        jittered(queue, env, offsets[env], offsets[env + 1], t, x, y, p, c, stamps)


PACK = """
    const wp::int32* envs = env.data;
    const wp::int64* ts = t.data;
    const wp::uint16* xs = x.data;
    const wp::uint16* ys = y.data;
    const wp::uint8* ps = p.data;
    const wp::uint8* cs = c.shape[0] > 0 ? c.data : nullptr;
    wp::int64* key = keys.data;
    const int n = t.shape[0];
    const int shift_env = (int)sensor.shift_env;
    const int shift_t = (int)sensor.shift_t;
    const int shift_y = (int)sensor.shift_y;
    const int shift_x = (int)sensor.shift_x;
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < n; i++) {
        const wp::int64 place = (wp::int64)ys[i] << shift_y | (wp::int64)xs[i] << shift_x | (ps[i] != 0);
        key[i] = (wp::int64)envs[i] << shift_env | (ts[i] - t_base) << shift_t | place;
    }
    if (cs)
        for (int i = 0; i < n; i++) key[i] |= (wp::int64)cs[i] << 1;
    bool rising = true;
#pragma clang loop vectorize(assume_safety)
    for (int i = 1; i < n; i++) rising &= key[i] >= key[i - 1];
    return rising;
"""


@wp.func_native(PACK)
def to_keys(
    sensor: Sensor, t_base: wp.int64, env: wp.array(dtype=wp.int32), t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16), y: wp.array(dtype=wp.uint16), p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8), keys: wp.array(dtype=wp.int64),
) -> wp.bool:  # fmt: skip
    """Columns to keys as in packet.KeyLayout; whether they ascend."""
    ...


@wp.kernel(module="unique")
def pack(
    # in
    sensor: Sensor,
    t_base: wp.int64,
    env: wp.array(dtype=wp.int32),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    c: wp.array(dtype=wp.uint8),
    # out: keys, and 0 where they do not ascend
    keys: wp.array(dtype=wp.int64),
    ascending: wp.array(dtype=wp.int32),
):
    """Columns to keys, by one thread."""
    ascending[0] = wp.where(to_keys(sensor, t_base, env, t, x, y, p, c, keys), 1, 0)


TIDY = """
    wp::int64* key = keys.data;
    for (int i = 1; i < count; i++) {
        const wp::int64 one = key[i];
        int j = i;
        for (; j > 0 && key[j - 1] > one; j--) key[j] = key[j - 1];
        key[j] = one;
    }
"""


@wp.func_native(TIDY)
def insertion_sort(count: wp.int32, keys: wp.array(dtype=wp.int64)):
    """Of keys that are in order but for those of one time."""
    ...


@wp.kernel(module="unique")
def tidy(
    # in
    count: wp.int32,
    # in and out
    keys: wp.array(dtype=wp.int64),
):
    """Keys that are in order but for those of one time, by one thread."""
    insertion_sort(count, keys)
