"""Writes a section of a report (title, command, rows, note) as text for a terminal, as HTML and as Markdown."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]


def columns(rows: Sequence[Row]) -> list[str]:
    """Lists all columns in the order of their first appearance; rows may lack some of them."""
    return list(dict.fromkeys(name for row in rows for name in row))


def cells(rows: Sequence[Row], names: Sequence[str]) -> list[list[str]]:
    """Gives the text of every cell, "" where a row lacks the column or has nothing there."""
    return [["" if row.get(name) is None else str(row[name]) for name in names] for row in rows]


def as_text(section: Mapping[str, Any]) -> str:
    """Writes a section as plain text: title, a table with aligned columns, and note."""
    names = columns(section["rows"])
    table = [names, *cells(section["rows"], names)]
    widths = [max(len(line[i]) for line in table) for i in range(len(names))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in table]
    return "\n".join([section["title"], *lines, section.get("note", ""), ""])


def as_html(section: Mapping[str, Any]) -> str:
    """Writes a section as HTML: heading, command, table and note."""
    names = columns(section["rows"])
    head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in line) + "</tr>"
        for line in cells(section["rows"], names)
    )
    return (
        f"<h3>{html.escape(section['title'])}</h3><p><code>{html.escape(section['command'])}</code></p>"
        f"<table><tr>{head}</tr>{body}</table><p class=note>{html.escape(section.get('note', ''))}</p>"
    )


def as_markdown(rows: Sequence[Row], names: Sequence[str] = ()) -> str:
    """Writes rows as a Markdown table of the columns named, of all when none is named."""
    names = list(names) or columns(rows)
    lines = [names, ["---"] * len(names), *cells(rows, names)]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
