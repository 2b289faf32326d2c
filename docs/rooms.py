"""Draws docs/rooms.svg, the rooms of the code, from the folders of this checkout: `python docs/rooms.py`."""

from __future__ import annotations

from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = Path(__file__).with_suffix(".svg")
WIDTH = 1120
EDGE, GAP, LINE = 16, 12, 15
LAYERS: tuple[tuple[str, str, tuple[tuple[str, ...], ...]], ...] = (
    (
        "what users start",
        "#fdf3e3",
        (
            (
                "evis/cli",
                "evis/simulation",
                "evis/env",
                "evis/dataset",
                "evis/client",
                "evis/remote",
                "evis/demo",
                "bench",
            ),
        ),
    ),
    (
        "nodes: the data's way, left to right",
        "#e6f1ea",
        (
            (
                "nodes/physics",
                "nodes/renderer",
                "nodes/interpolator",
                "nodes/event_sensor",
                "nodes/frame_camera",
                "nodes/recorder",
            ),
            (
                "nodes/camera",
                "nodes/labeler",
                "nodes/imu",
                "nodes/audit",
                "nodes/replayer",
                "nodes/visualizer",
            ),
            ("nodes/rate_divider", "nodes/environment_share", "nodes/environment_join", "nodes/foxglove"),
        ),
    ),
    (
        "evis: what nodes stand on",
        "#e8eef7",
        (
            (
                "evis/launch",
                "evis/supervisor",
                "evis/runtime",
                "evis/bus",
                "evis/shares",
                "evis/config",
                "evis/console",
                "evis/web",
            ),
            (
                "evis/scene",
                "evis/geometry",
                "evis/events",
                "evis/media",
                "evis/bag",
                "evis/recordings",
                "evis/files",
                "evis/gpu",
            ),
        ),
    ),
    ("msgs: what travels", "#f1e9f6", (("msgs",),)),
)
"""Title, colour, and rows of rooms, from the top to the bottom: imports run downwards."""
TELLS = {
    "bench": "figures of docs/",
    "evis/cli": "commands",
    "evis/simulation": "a graph in Python",
    "evis/env": "Gymnasium",
    "evis/dataset": "labelled data",
    "evis/demo": "demo, gallery",
    "evis/client": "a running graph",
    "evis/remote": "topics elsewhere",
    "evis/shares": "parts of messages",
    "nodes/physics": "/state",
    "nodes/recorder": "a bag",
    "nodes/rate_divider": "every n-th state",
    "nodes/environment_share": "a device's environments",
    "nodes/environment_join": "all devices' as one",
    "nodes/labeler": "/labels",
    "nodes/imu": "/imu",
    "nodes/audit": "error of a run",
    "nodes/replayer": "a bag again",
    "nodes/visualizer": "web page",
    "nodes/foxglove": "Foxglove, Lichtblick",
    "nodes/camera": "a real camera: /events",
    "nodes/renderer": "/keyframe, /depth, ...",
    "nodes/interpolator": "/frames",
    "nodes/event_sensor": "/events",
    "nodes/frame_camera": "/image",
    "evis/launch": "YAML to a plan",
    "evis/supervisor": "a plan, running",
    "evis/runtime": "runs a node",
    "evis/bus": "ZeroMQ, memory",
    "evis/config": "YAML, parameters",
    "evis/scene": "files to a Scene",
    "evis/geometry": "poses, cameras",
    "evis/events": "event streams",
    "evis/media": "pictures",
    "evis/bag": "MCAP, ROS 2",
    "evis/recordings": "evis.open",
    "evis/console": "terminal, signals",
    "evis/files": "safe files",
    "evis/gpu": "CUDA graphs",
    "evis/web": "a page's server",
    "msgs": "topic table, a dataclass per message, wire codec",
}
"""What a room holds, in a few words."""


def rooms_in(folder: Path) -> list[str]:
    """Names of the packages in a folder, sorted."""
    return sorted(path.parent.name for path in folder.glob("*/__init__.py"))


def picture() -> str:
    """Draws the layers. Raises ValueError where the table above and the folders differ."""
    drawn = {room for _, _, rows in LAYERS for row in rows for room in row}
    there = {f"{top}/{name}" for top in ("evis", "nodes") for name in rooms_in(ROOT / top)} | {"bench", "msgs"}
    if drawn != there:
        raise ValueError(f"the picture of rooms and the folders differ in {', '.join(sorted(drawn ^ there))}")
    parts, y = [], EDGE
    for title, colour, rows in LAYERS:
        boxes, below = _layer(rows, y + 26)
        parts.append(_box(EDGE, y, WIDTH - 2 * EDGE, below - y, colour, "none"))
        parts.append(_text(EDGE + GAP, y + 18, title, "bold 14px"))
        parts += boxes
        y = below + 2 * GAP
        if title != LAYERS[-1][0]:
            parts.append(_arrow(WIDTH // 2, below + 2, y - 2))
            parts.append(_text(WIDTH // 2 + 14, below + 16, "imports", "12px", "#555555"))
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{y}" viewBox="0 0 {WIDTH} {y}">'
    return "\n".join([head, f'<rect width="{WIDTH}" height="{y}" fill="#ffffff"/>', *parts, "</svg>"]) + "\n"


def _layer(rows: tuple[tuple[str, ...], ...], y: int) -> tuple[list[str], int]:
    parts = []
    for row in rows:
        width = (WIDTH - 2 * EDGE - GAP * (len(row) + 1)) // len(row)
        inside = [_lines(rooms_in(ROOT / room), width) for room in row]
        height = 44 + LINE * max(map(len, inside))
        for n, (room, lines) in enumerate(zip(row, inside)):
            x = EDGE + GAP + n * (width + GAP)
            parts.append(_box(x, y, width, height, "#ffffff", "#8fa3bf"))
            parts.append(_text(x + 8, y + 17, room, "bold 13px"))
            parts.append(_text(x + 8, y + 33, TELLS[room], "12px", "#555555"))
            parts += [_text(x + 8, y + 50 + LINE * i, line, "12px", "#1f4e8c") for i, line in enumerate(lines)]
        y += height + GAP
    return parts, y


def _lines(names: list[str], width: int) -> list[str]:
    """Names of sub-rooms, as many on a line as there is room for."""
    lines: list[str] = []
    for name in names:
        if lines and len(lines[-1]) + len(name) + 2 < (width - 16) / 6.3:
            lines[-1] += f", {name}"
        else:
            lines.append(name)
    return lines


def _box(x: int, y: int, width: int, height: int, fill: str, line: str) -> str:
    return f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="{fill}" stroke="{line}"/>'


def _text(x: int, y: int, words: str, font: str, colour: str = "#1a1a2e") -> str:
    return f'<text x="{x}" y="{y}" style="font: {font} sans-serif" fill="{colour}">{escape(words)}</text>'


def _arrow(x: int, top: int, bottom: int) -> str:
    return (
        f'<path d="M{x} {top} V{bottom - 6} M{x - 6} {bottom - 8} L{x} {bottom} L{x + 6} {bottom - 8}" fill="none" '
        'stroke="#1a1a2e" stroke-width="1.5"/>'
    )


if __name__ == "__main__":
    PICTURE.write_text(picture())
    print(PICTURE)
