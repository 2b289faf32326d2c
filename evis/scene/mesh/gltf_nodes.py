"""Rewrites the nodes of a glTF file so that trimesh puts each where the file does, in an order that the file tells.

trimesh finds nodes by names: it takes one called `world` for the frame of all, makes up the names of the second and
further primitives of a mesh at random, and leaves out a node with a camera, with its mesh and the way to its children.
"""

from __future__ import annotations

from typing import Any


def name_nodes(tree: dict[str, Any]) -> None:
    """Names all nodes by their rank in the order of the names they have, or else their numbers; none has a camera.

    The nodes form trees. Every mesh has one primitive afterwards, and hangs on a node without children, named by its
    parent and the primitive's number.
    """
    nodes: list[dict[str, Any]] = tree.get("nodes", [])
    parts = _single_primitives(tree)
    tree.pop("cameras", None)
    given = sorted(range(len(nodes)), key=lambda n: (str(nodes[n].get("name") or n), n))
    for rank, number in enumerate(given):
        node = nodes[number]
        node["name"] = f"{rank:08d}"
        node.pop("camera", None)
        if "mesh" in node:
            shown = parts[node.pop("mesh")]
            first = len(nodes)
            node["children"] = [*node.get("children", []), *range(first, first + len(shown))]
            nodes += [{"name": f"{node['name']}_{k:08d}", "mesh": mesh} for k, mesh in enumerate(shown)]


def _single_primitives(tree: dict[str, Any]) -> list[list[int]]:
    """Parts meshes into one for each of their primitives, and returns the numbers of those of each mesh."""
    meshes: list[dict[str, Any]] = tree.get("meshes", [])
    parts: list[list[int]] = []
    for number in range(len(meshes)):
        first, *others = meshes[number].get("primitives", []) or [None]
        if first is None:
            parts.append([])
            continue
        meshes[number]["primitives"] = [first]
        parts.append([number, *range(len(meshes), len(meshes) + len(others))])
        meshes += [{"primitives": [primitive]} for primitive in others]
    return parts
