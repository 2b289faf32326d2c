"""Puts counters into the code that Warp generates: bytes of arrays that are read and written, and operations.

Every statement of that code is one call, as `var_3 = wp::mul(var_1, var_2);`, so its cost follows from the function's
name and the types of its arguments (counts.h). What a thread does is counted where it does it: branches that are not
taken and loops that end early cost nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

COSTS = Path(__file__).with_name("counts.h")
STATEMENT = re.compile(r"^(\s+)(?:(var_\w+) = )?(wp::)?(\w+)\((.*)\);$")
COMPARISON = re.compile(r"^\s+var_\w+ = \(var_\w+ (?:<|>|<=|>=|==|!=) var_\w+\);$")
MEMBER = re.compile(r"^\s+(var_\w+) = &\(+(var_\w+)\)?(?:->|\.)\w+\);$")
INSIDE = re.compile(r"^\s+(var_\w+) = &\(\(\*?(var_\w+)\)\.\w+\);$")
NOTHING = re.compile(
    r"(?!\s*(?:return|goto)\b)(?:\s*(?://.*)?|\s+var_\w+ = [^()]*;|\s+(?:const )?[\w:<>, ]+\*? var_\w+(?: = [^()]*)?;)$"
)
"""Comments, moves and declarations: they cost nothing and change no way of the control."""
FREE = frozenset(
    "address load copy extract assign where select array range iter_next iter_cmp tid shape unot float float16 float32 "
    "float64 int int8 int16 int32 int64 uint8 uint16 uint32 uint64 bool view index len lower_bound printf vec_t mat_t "
    "quat_t transpose cast reinterpret_cast rand_init zero_init block_dim".split()
)
"""Functions of Warp that move and rename."""
QUERIES = re.compile(r"(mesh|bvh|hash_grid|volume|tile|texture)_")
"""Functions of Warp whose work is hidden in its library."""
PRODUCTS = frozenset(("mul",))


BRANCHES = re.compile(r"#if defined\(__CUDA_ARCH__\)\n(.*?)#else\n(.*?)#endif", re.DOTALL)
READ, ONE, HIDDEN = "reads an element", "one operation", "more"


def kind_of(body: str, takes_array: bool, on_gpu: bool = True) -> str:
    """Tells what a native C++ function does from the part of its body for a GPU or a CPU: READ, ONE or HIDDEN.

    One with a loop or with more than eight statements does more than one thing, and is not counted.
    """
    if (parts := BRANCHES.search(body)) is not None:
        body = body[: parts.start()] + parts[1 if on_gpu else 2] + body[parts.end() :]
    if re.search(r"\b(for|while|do|goto)\b", body) or body.count(";") > 8:
        return HIDDEN
    return READ if takes_array else ONE


def cost(name: str, args: list[str]) -> str:
    """Writes how many operations a function of Warp is, as a constant of C++; "" for none. A root counts as one."""
    if name in FREE or not args[0]:
        return ""
    first = f"EVIS_NUMBERS({args[0]})"
    if name in PRODUCTS and len(args) == 2:
        return f"EVIS_PRODUCT({args[0]}, {args[1]})"
    if name in ("dot", "length_sq"):
        return f"(2 * {first} - 1)"
    if name == "length":
        return f"(2 * {first})"
    if name == "normalize":
        return f"(3 * {first} + 1)"
    if name == "cross":
        return "9"
    if name == "outer":
        return f"({first} * EVIS_NUMBERS({args[1]}))"
    if name in ("clamp", "lerp"):
        return f"({2 + (name == 'lerp')} * {first})"
    if name in ("quat_rotate", "quat_rotate_inv", "transform_point"):
        return "30"
    return first


def counted(source: str, counters: int, native: Mapping[str, str]) -> str:
    """Puts counters into a module's source.

    Args:
        source: what Warp generates for a module, C++ or CUDA.
        counters: address of three uint64, where the code runs: bytes, operations, calls of native functions.
        native: of the functions whose bodies are no code of Warp's, what each does (`kind_of`).
    """
    begin = source.index("#define builtin_tid1d")
    head = f"#define EVIS_COUNTERS {counters}ull\n{COSTS.read_text()}\n"
    return source[:begin] + head + "\n".join(_counted_lines(source[begin:].split("\n"), native))


def _counted_lines(lines: list[str], native: Mapping[str, str]) -> list[str]:
    made: list[str] = []
    pending: tuple[list[str], list[str], list[str]] = ([], [], [])
    in_arrays: set[str] = set()
    """Pointers to elements of arrays; others are to what a thread has in its registers."""
    forward = False

    def flush(indent: str) -> None:
        for i, costs in enumerate(pending):
            if costs:
                made.append(f"{indent}EVIS_ADD({i}, {' + '.join(costs)});")
            costs.clear()

    indent = ""
    for line in lines:
        if line[:1] not in ("", " ", "\t"):
            in_arrays.clear()
            forward = False
        if line.strip() in ("// forward", "// reverse"):
            forward = line.strip() == "// forward"
        statement = STATEMENT.match(line) if forward and "adj_" not in line else None
        if statement is not None and statement[4] not in ("if", "for", "while", "switch"):
            indent = statement[1]
            _add(statement, pending, in_arrays, native)
        elif forward and COMPARISON.match(line):
            pending[1].append("1")
        elif forward and (member := MEMBER.match(line) or INSIDE.match(line)):
            if member[2] in in_arrays:
                in_arrays.add(member[1])
        elif not NOTHING.match(line):
            flush(indent or "    ")
        made.append(line)
    return made


def _add(
    statement: re.Match[str], pending: tuple[list[str], list[str], list[str]], in_arrays: set[str],
    native: Mapping[str, str],
) -> None:  # fmt: skip
    """Adds the cost of a statement to what is to be counted before the control goes elsewhere."""
    to, of_warp, name = statement[2], statement[3], statement[4]
    args = [arg.strip() for arg in statement[5].split(",")]
    moved, done, hidden = pending
    if not of_warp:
        kind = native.get(name)
        if kind == READ and to:
            moved.append(f"sizeof({to})")
        elif kind is not None:
            (done if kind == ONE else hidden).append("1")
    elif name == "address":
        in_arrays.add(to)
    elif name == "load":
        if args[0] in in_arrays:
            moved.append(f"sizeof(*{args[0]})")
    elif name == "store":
        if args[0] in in_arrays:
            moved.append(f"sizeof({args[-1]})")
    elif name == "array_store":
        moved.append(f"sizeof({args[-1]})")
    elif name.startswith("atomic_"):
        moved.append(f"2 * sizeof({args[-1]})")
        done.append("1")
    elif QUERIES.match(name):
        hidden.append("1")
    elif found := cost(name, args):
        done.append(found)
