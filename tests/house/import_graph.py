"""Reads which file imports which from the sources, and finds the circles among them."""

from __future__ import annotations

import ast
import functools
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("msgs", "evis", "nodes", "bench")

Graph = dict[str, set[str]]
"""Name -> the names that it imports."""


def sources(root: Path = ROOT) -> dict[str, Path]:
    """Gives every Python file of the house by its module name; a package's is that of its `__init__.py`."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(tree: ast.AST, known: Collection[str]) -> Iterator[str]:
    """Yields the modules that a file names, wherever in it: in a function and under TYPE_CHECKING too.

    `from package import part` names the part where that is a file of its own, and else the package.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                part = f"{node.module}.{alias.name}"
                yield part if part in known else str(node.module)


@functools.cache
def import_graph(root: Path = ROOT) -> Graph:
    """Makes the graph of the house's files."""
    files = sources(root)
    return {
        module: {name for name in imports_of(ast.parse(path.read_text()), files) if name in files} - {module}
        for module, path in files.items()
    }


def package_of(module: str) -> str:
    """Names the room at the top that a module lies in: `evis.bus`, `nodes.renderer`, `msgs`.

    What measures the whole chain to choose a method for it stands by itself: it uses all of the chain, and no node it.
    """
    if module.startswith("nodes.interpolator.auto"):
        return "nodes.interpolator.auto"
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] in ("evis", "nodes") else parts[0]


def package_graph(files: Mapping[str, set[str]]) -> Graph:
    """Makes the graph of the packages from that of the files. `evis` and `nodes` themselves hold nothing."""
    graph: Graph = {package_of(module): set() for module in files}
    for module, others in files.items():
        graph[package_of(module)] |= {package_of(other) for other in others} - {package_of(module)}
    return graph


def circles(graph: Mapping[str, Collection[str]]) -> list[set[str]]:
    """Finds the circles: groups in which each leads to every other (R. Tarjan, SIAM J. Comput. 1(2), 1972)."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(name: str) -> None:
        number[name] = lowest[name] = len(number)
        stack.append(name)
        for other in graph[name]:
            if other not in number:
                visit(other)
                lowest[name] = min(lowest[name], lowest[other])
            elif other in stack:
                lowest[name] = min(lowest[name], number[other])
        if lowest[name] == number[name]:
            at = stack.index(name)
            group = set(stack[at:])
            del stack[at:]
            if len(group) > 1:
                found.append(group)

    for name in graph:
        if name not in number:
            visit(name)
    return found
