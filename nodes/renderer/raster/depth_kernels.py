"""Packs depth, triangle and the side that a pixel sees into one uint64 of the z-buffer. The nearest of all threads wins
by its value: depth's float32 above, BACK where the triangle's back is seen, and the triangle below.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

MISS = wp.constant(-1)
"""Triangle index of a pixel that sees no triangle."""
NO_ENTRY = wp.constant(wp.uint64(0))
"""Stands for no z-buffer entry at all: at depth 0 nothing is seen."""
BACK = wp.constant(1 << 30)
"""Bit of the back of a triangle, of which there are fewer."""


@wp.func
def face_of(packed: wp.uint64):
    """Unpacks the face of a z-buffer entry, a triangle with BACK or without, or MISS."""
    return int(wp.uint32(packed & wp.uint64(0xFFFFFFFF)))


@wp.func
def triangle_of(packed: wp.uint64):
    """Unpacks the triangle of a z-buffer entry, or MISS."""
    face = face_of(packed)
    return wp.where(face < 0, face, face & (BACK - 1))


@wp.func
def back_of(packed: wp.uint64):
    """Tells whether a z-buffer entry is of a triangle's back, as 0 or 1."""
    face = face_of(packed)
    return wp.where(face < 0, 0, face >> 30)


@wp.func
def entry_of(z: float, face: int):
    """Packs depth z >= 0 [m] and a face into a z-buffer entry."""
    return (wp.uint64(wp.cast(z, wp.uint32)) << wp.uint64(32)) | wp.uint64(face)


@wp.func
def face_from(triangle: int, offset: float):
    """Gives the face of a triangle that is seen; offset: its normal, (b - a) x (c - a), times a corner seen from the
    eye."""
    return wp.where(offset > 0.0, triangle | BACK, triangle)


@wp.func
def depth_of(packed: wp.uint64):
    """Unpacks the depth of a z-buffer entry [m]."""
    return wp.cast(wp.uint32(packed >> wp.uint64(32)), wp.float32)


LOWER = """
#if defined(__CUDA_ARCH__)
    atomicMin(reinterpret_cast<unsigned long long*>(packed.data) + at, static_cast<unsigned long long>(entry));
#else
    packed.data[at] = entry < packed.data[at] ? entry : packed.data[at];
#endif
"""


@wp.func_native(LOWER)
def lower(packed: wp.array3d(dtype=wp.uint64), at: wp.int64, entry: wp.uint64):
    """Lowers an entry of the z-buffer, by its place in memory: fewer instructions than by three indices. On a CPU no
    other thread has its row."""
    ...


@wp.func
def put_depth(packed: wp.array3d(dtype=wp.uint64), env: int, y: int, x: int, z: float, face: int):
    """Writes a face at depth z >= 0 [m] into a pixel of the z-buffer, unless a nearer one is there."""
    row = wp.int64(env * packed.shape[1] + y)
    lower(packed, row * wp.int64(packed.shape[2]) + wp.int64(x), entry_of(z, face))
