"""Draws a graph as a PNG: processes as columns of boxes in data-flow order, topics as lines with their names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from evis.files.whole_file import whole_file
from evis.runtime.plan import Plan

BOX = (190, 44)
GAP = (230, 40)
EDGE = 40
LANE = 26
_INK, _PAPER, _FILL, _FRAME, _TAP = "#1a1a2e", "#ffffff", "#e8eef7", "#9db2d1", "#a0a0a0"


def columns(plan: Plan) -> dict[str, int]:
    """Returns the column of each node: one behind the last of those that it reads in lock-step."""
    column = dict.fromkeys(plan.nodes, 0)
    for name in plan.nodes:  # in data-flow order
        for topic in plan.topics.values():
            for edge in topic.edges:
                if edge.node == name and edge.kind != "delayed":
                    column[name] = max(column[name], column[topic.node] + 1)
    return column


def draw(plan: Plan, path: Path) -> None:
    """Draws a graph into a PNG file. Raises OSError when it cannot be written."""
    column = columns(plan)
    links = _links(plan)
    # Lines that pass over other columns run in lanes of their own above the boxes.
    far = [ends for ends in links if column[ends[1]] - column[ends[0]] != 1]
    top = EDGE + LANE * len(far)
    rows: dict[int, int] = {}
    place: dict[str, tuple[int, int]] = {}
    for name, c in column.items():
        row = rows.setdefault(c, 0)
        rows[c] += 1
        place[name] = (EDGE + c * (BOX[0] + GAP[0]), top + row * (BOX[1] + 2 * GAP[1]))
    width = 2 * EDGE + (max(column.values(), default=0) + 1) * (BOX[0] + GAP[0]) - GAP[0]
    height = top + EDGE + max(rows.values(), default=1) * (BOX[1] + 2 * GAP[1]) - 2 * GAP[1]
    image = Image.new("RGB", (width, height), _PAPER)
    pen = ImageDraw.Draw(image)
    font = ImageFont.load_default(14)
    small = ImageFont.load_default(12)
    for (source, target), labels in links.items():
        if (source, target) in far:
            lane = far.index((source, target))
            # Lines leave and arrive side by side: each lane a little further along its box.
            along = BOX[0] * (lane + 1) // (len(far) + 1)
            _lane(pen, small, place[source], place[target], labels, EDGE + LANE * lane, along)
        else:
            _line(pen, small, place[source], place[target], labels)
    for name, (x, y) in place.items():
        node = plan.nodes[name]
        pen.rounded_rectangle((x, y, x + BOX[0], y + BOX[1]), 8, _FILL, _FRAME, 2)
        pen.text((x + BOX[0] / 2, y + 15), name, _INK, font, anchor="mm")
        note = "dormant" if node.dormant else f"process {node.process}"
        pen.text((x + BOX[0] / 2, y + 33), note, _TAP, small, anchor="mm")
    with whole_file(path) as partial:
        image.save(partial, format="PNG")


def _links(plan: Plan) -> dict[tuple[str, str], list[tuple[str, bool]]]:
    links: dict[tuple[str, str], list[tuple[str, bool]]] = {}
    for topic in plan.topics.values():
        for edge in topic.edges:
            links.setdefault((topic.node, edge.node), []).append((topic.name, edge.kind == "lockstep"))
    return links


Place = tuple[int, int]
Labels = list[tuple[str, bool]]


def _colour(labels: Labels) -> str:
    return _INK if any(lockstep for _, lockstep in labels) else _TAP


def _line(pen: Any, font: Any, a: Place, b: Place, labels: Labels) -> None:
    """Straight to the next column; names above it, near the start so that crossing lines keep them apart."""
    start, end = (a[0] + BOX[0], a[1] + BOX[1] // 2), (b[0], b[1] + BOX[1] // 2)
    colour = _colour(labels)
    pen.line((start, end), colour, 2)
    pen.polygon([end, (end[0] - 9, end[1] - 5), (end[0] - 9, end[1] + 5)], colour)
    x = start[0] + GAP[0] / 2
    y = start[1] + (end[1] - start[1]) * (x - start[0]) / (end[0] - start[0])
    for number, (name, _) in enumerate(labels):
        pen.text((x, y - 8 - 13 * (len(labels) - 1 - number)), name, colour, font, anchor="mm")


def _lane(pen: Any, font: Any, a: Place, b: Place, labels: Labels, y: int, along: int) -> None:
    """Up, along a lane at y, and down, its topics' names on the lane."""
    start, end = (a[0] + along, a[1]), (b[0] + along, b[1])
    colour = _colour(labels)
    pen.line((start, (start[0], y), (end[0], y), end), colour, 2)
    pen.polygon([end, (end[0] - 5, end[1] - 9), (end[0] + 5, end[1] - 9)], colour)
    text = "  ".join(name for name, _ in labels)
    middle = ((start[0] + end[0]) / 2, y)
    pen.rectangle(pen.textbbox(middle, text, font, anchor="mm"), _PAPER)
    pen.text(middle, text, colour, font, anchor="mm")
