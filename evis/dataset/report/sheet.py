"""Makes the contact sheet of a data set, and its page."""

from __future__ import annotations

import base64
import html
import io
import os
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from evis.dataset.making.store import is_remote
from evis.dataset.report.summary import opened, summary, value_text
from evis.dataset.report.tiles import tiles
from evis.files.whole_file import whole_file

TILE = 200
"""Width of one picture [px]."""
CAPTION = 16
GAP = 6
WIDEST = 1400
"""Sequences stand beside each other up to this width [px]."""


def write_sheet(out: str, prefix: str | None, most: int) -> list[str]:
    """Draws a contact sheet and writes a page of it; returns the two files. Raises DatasetError, OSError.

    Args:
        out: the data set.
        prefix: of the files; None = contact_sheet in the data set's folder, or here where that lies elsewhere.
        most: sequences that are shown, spread over all.
    """
    store, index = opened(out)
    entries = index["sequences"]
    places = np.linspace(0, len(entries) - 1, min(most, len(entries))).round().astype(int)
    chosen = [entries[place] for place in places]
    strips = []
    for entry in chosen:
        with store.local(entry["path"]) as folder:
            strips.append(_strip(tiles(folder, index["layout"]), _title(entry)))
    prefix = prefix or ("contact_sheet" if is_remote(out) else os.path.join(out, "contact_sheet"))
    files = [f"{prefix}.png", f"{prefix}.html"]
    with whole_file(files[0]) as partial:
        _sheet(strips).save(partial, "PNG")
    with whole_file(files[1]) as partial:
        partial.write_text(_page(out, summary(out), chosen, strips))
    return files


def _title(entry: dict[str, Any]) -> str:
    return f"{entry['path']}  {entry['events'] / 1e6:.2f} M events in {entry['duration_s']:g} s"


def _strip(pictures: dict[str, np.ndarray], title: str) -> Image.Image:
    """The pictures of one sequence in a row, each with its name."""
    scaled = {name: _scaled(picture) for name, picture in pictures.items()}
    height = max(picture.height for picture in scaled.values())
    strip = Image.new("RGB", ((TILE + GAP) * len(scaled), height + 2 * CAPTION), "white")
    draw = ImageDraw.Draw(strip)
    draw.text((0, 1), title, fill="black")
    for column, (name, picture) in enumerate(scaled.items()):
        strip.paste(picture, (column * (TILE + GAP), CAPTION))
        draw.text((column * (TILE + GAP), CAPTION + height + 1), name, fill="gray")
    return strip


def _scaled(picture: np.ndarray) -> Image.Image:
    image = Image.fromarray(picture)
    return image.resize((TILE, max(1, round(TILE * image.height / image.width))))


def _sheet(strips: list[Image.Image]) -> Image.Image:
    """All sequences, in as many columns as fit."""
    if not strips:
        return Image.new("RGB", (TILE, CAPTION), "white")
    width, height = (max(getattr(strip, side) for strip in strips) for side in ("width", "height"))
    columns = max(1, min(len(strips), WIDEST // (width + 2 * GAP)))
    rows = -(-len(strips) // columns)
    sheet = Image.new("RGB", (columns * (width + 2 * GAP), rows * (height + GAP)), "white")
    for n, strip in enumerate(strips):
        sheet.paste(strip, (GAP + n % columns * (width + 2 * GAP), n // columns * (height + GAP)))
    return sheet


def _page(out: str, told: dict[str, Any], entries: list[dict[str, Any]], strips: list[Image.Image]) -> str:
    """The sheet as a page, each sequence with its arguments; the pictures are in it."""
    name = html.escape(os.path.basename(out.rstrip("/")) or out)
    facts = {
        "recipe": told["recipe"],
        "layout": told["layout"],
        "sequences": f"{told['sequences']} of {told['of_recipe']}",
        "splits": ", ".join(f"{split} {count}" for split, count in told["splits"].items()) or "none",
        "duration": f"{told['duration_s']:g} s",
        "events": f"{told['events']:,}",
        "failed": len(told["failed"]),
        **told["arguments"],
    }
    table = "".join(f"<tr><th>{html.escape(key)}<td>{html.escape(str(value))}" for key, value in facts.items())
    parts = []
    for entry, strip in zip(entries, strips):
        data = io.BytesIO()
        strip.save(data, "PNG")
        said = ", ".join(
            f"{key} {value_text(value)}" for key, value in {"seed": entry["seed"], **entry["arguments"]}.items()
        )
        parts.append(
            f'<figure><img alt="{html.escape(entry["name"])}" '
            f'src="data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}">'
            f"<figcaption>{html.escape(said)}</figcaption></figure>"
        )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{name}</title><style>'
        "body{font:14px sans-serif;margin:16px}th{text-align:left;padding-right:16px;font-weight:normal;color:#666}"
        "figure{display:inline-block;margin:0 16px 16px 0;vertical-align:top}figcaption{color:#666;max-width:640px}"
        f"</style><h1>{name}</h1><table>{table}</table>{''.join(parts)}</html>\n"
    )
