"""Reads elements of arrays whose place in memory is known, where an index would be looked at for its sign and stride.

Nobody writes to these arrays while a kernel reads them, so a GPU may keep them in its read-only cache.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

ELEMENT = """
#if defined(__CUDA_ARCH__)
    return __ldg(values.data + at);
#else
    return values.data[at];
#endif
"""


@wp.func_native(ELEMENT)
def number(values: wp.array(dtype=wp.float32), at: wp.int32) -> wp.float32:
    """Reads an element of an array that nobody writes to meanwhile: fewer instructions than by its index."""
    ...


@wp.func_native(ELEMENT)
def whole_number(values: wp.array(dtype=wp.int32), at: wp.int32) -> wp.int32:
    """Reads an element of an integer array as `number` does."""
    ...


@wp.func_native(ELEMENT)
def entry(values: wp.array3d(dtype=wp.uint64), at: wp.int32) -> wp.uint64:
    """Reads a z-buffer entry by its place in memory, which is known, rather than by three indices."""
    ...


@wp.func_native("return values.data[at];")
def vector_at(values: wp.array2d(dtype=wp.vec3), at: wp.int32) -> wp.vec3:
    """Reads an element of a table of vectors by its place in memory."""
    ...


@wp.func_native("return values.data[at];")
def matrix_at(values: wp.array2d(dtype=wp.mat33), at: wp.int32) -> wp.mat33:
    """Reads an element of a table of matrices by its place in memory."""
    ...


@wp.func_native("return values.data[at];")
def corners_at(values: wp.array(dtype=wp.vec3i), at: wp.int32) -> wp.vec3i:
    """Reads which vertices a triangle has by its place in memory."""
    ...


WHOLE_FOUR = """
#if defined(__CUDA_ARCH__)
    const int4 all = __ldg(reinterpret_cast<const int4*>(values.data) + at);
    return wp::vec_t<4, wp::int32>(all.x, all.y, all.z, all.w);
#else
    return values.data[at];
#endif
"""


@wp.func_native(WHOLE_FOUR)
def whole_four(values: wp.array(dtype=wp.vec4i), at: wp.int32) -> wp.vec4i:
    """Reads four integers at once, as `number` does."""
    ...


@wp.func_native(WHOLE_FOUR)
def whole_four_in(values: wp.array2d(dtype=wp.vec4i), at: wp.int32) -> wp.vec4i:
    """Reads four integers of a table at once, by their place in memory."""
    ...


TWO_AT_ONCE = """
#if defined(__CUDA_ARCH__)
    const float2 both = __ldg(reinterpret_cast<const float2*>(values.data) + at);
    return wp::vec_t<2, wp::float32>(both.x, both.y);
#else
    return values.data[at];
#endif
"""


@wp.func_native(TWO_AT_ONCE)
def vector_two(values: wp.array(dtype=wp.vec2), at: wp.int32) -> wp.vec2:
    """Reads two numbers at once, as `number` does."""
    ...


FOUR_AT_ONCE = """
#if defined(__CUDA_ARCH__)
    const float4 all = __ldg(reinterpret_cast<const float4*>(values.data) + at);
    return wp::vec_t<4, wp::float32>(all.x, all.y, all.z, all.w);
#else
    return values.data[at];
#endif
"""


@wp.func_native(FOUR_AT_ONCE)
def vector_four(values: wp.array3d(dtype=wp.vec4), at: wp.int32) -> wp.vec4:
    """Reads four numbers at once, as `number` does, by their place in memory."""
    ...


PAIR = """
    const float* first = values.data + at;
#if defined(__CUDA_ARCH__)
    return wp::vec_t<2, wp::float32>(__ldg(first), __ldg(first + 1));
#else
    return wp::vec_t<2, wp::float32>(first[0], first[1]);
#endif
"""


@wp.func_native(PAIR)
def pair(values: wp.array(dtype=wp.float32), at: wp.int32) -> wp.vec2:
    """Reads two elements in a row as `number` does."""
    ...


WHOLE_PAIR = PAIR.replace("float", "int")


@wp.func_native(WHOLE_PAIR)
def whole_pair(values: wp.array(dtype=wp.int32), at: wp.int32) -> wp.vec2i:
    """Reads two elements of an integer array in a row as `number` does."""
    ...


@wp.func
def pair_of(values: wp.array(dtype=wp.float32), at: int):
    """Reads two elements in a row."""
    both = pair(values, at)
    return both[0], both[1]


@wp.func
def pair_of(values: wp.array(dtype=Any), at: int):  # noqa: F811 - overloaded by its type
    return values[at], values[at + 1]


FOUR = """
    const float* first = values.data + at;
#if defined(__CUDA_ARCH__)
    return wp::vec_t<4, wp::float32>(__ldg(first), __ldg(first + 1), __ldg(first + 2), __ldg(first + 3));
#else
    return wp::vec_t<4, wp::float32>(first[0], first[1], first[2], first[3]);
#endif
"""


@wp.func_native(FOUR)
def four(values: wp.array(dtype=wp.float32), at: wp.int32) -> wp.vec4:
    """Reads four elements in a row as `number` does."""
    ...


@wp.func
def weighted(values: wp.array(dtype=wp.float32), at: int, w: wp.vec4):
    """Weights four elements in a row, from `at` on."""
    r = four(values, at)
    return w[0] * r[0] + w[1] * r[1] + w[2] * r[2] + w[3] * r[3]


@wp.func
def weighted(values: wp.array(dtype=Any), at: int, w: wp.vec4):  # noqa: F811 - overloaded by its type
    return w[0] * values[at] + w[1] * values[at + 1] + w[2] * values[at + 2] + w[3] * values[at + 3]


@wp.func
def element(values: wp.array(dtype=Any), at: int):
    """Reads an element of any type."""
    return values[at]
