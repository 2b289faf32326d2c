"""Embeds C++ in Warp's kernels, kept in headers that editors and formatters read.

A header holds `static const auto name = [](...) {...};`, which is C++ both in a file and inside a function, where
`wp.func_native` puts it. So the text that is compiled is the text of the header, and Warp's cache of compiled kernels
knows when it has changed. Headers include each other for an editor; what a snippet holds, its Python names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Value = bool | int | float | np.float32 | np.uint64


def native_code(headers: Sequence[Path], call: str, constants: Mapping[str, Value] | None = None) -> str:
    """Returns the body of a function in C++: the constants, the text of the headers in this order, and a call.

    call: the last statement, mostly `return name(argument, ...);`. constants: name -> value; a float is a double, and
    np.float32 a float there. Raises OSError for a header that is not there.
    """
    lines = [_constant(name, value) for name, value in (constants or {}).items()]
    for header in headers:
        lines += [line for line in header.read_text().splitlines() if not line.startswith(("#pragma once", "#include"))]
    return "\n".join([*lines, call, ""])


def _constant(name: str, value: Any) -> str:
    """The definition of a constant in C++, exact to the last bit."""
    if isinstance(value, bool):
        return f"constexpr bool {name} = {str(value).lower()};"
    if isinstance(value, np.uint64):
        return f"constexpr wp::uint64 {name} = {int(value)}ull;"
    if isinstance(value, np.float32):
        return f"constexpr float {name} = {float(value)!r}f;"
    if isinstance(value, float):
        return f"constexpr double {name} = {value!r};"
    return f"constexpr int {name} = {int(value)};"
