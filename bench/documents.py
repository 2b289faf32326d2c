"""Writes the tables of docs/performance.md and docs/dynamics.md from reports of `evis bench`.

    evis bench graph --quick --docs docs/performance.md
    python -m bench.documents [REPORT.json ...] [--page PAGE] [--remark TEXT]

A table stands between two marks of the page, of which the first names a section of a report and, after a colon, the
columns that are shown (all of them when there is none):

    <!-- bench graph/arrangements: run | real-time factor | overhead -->
    <!-- /bench -->

What the tables show is kept beside the page, in a .json of its name, with command, machine and date, so that tables of
several machines stand on one page and each is made anew by itself. Without a report the page is written from that file.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench import command
from bench.sections import as_markdown, columns

PAGES = (Path("docs/performance.md"), Path("docs/dynamics.md"))
"""The pages with tables."""
MARK = re.compile(r"^<!-- bench (?P<key>[\w.]+/[\w .]+?)(?:: (?P<columns>.+?))? -->\n(?P<body>.*?)^<!-- /bench -->$",
                  re.M | re.S)  # fmt: skip
Kept = dict[str, dict[str, Any]]
"""Sections by `subject/section`, each with title, command, rows, machine, date and perhaps a remark."""


@dataclass(frozen=True)
class Table:
    """Describes a table that a page asks for: the section's key, and its columns, all when there are none."""

    key: str
    columns: tuple[str, ...]


def tables(text: str) -> list[Table]:
    """Finds the tables that a page asks for. Raises ValueError for a mark that is not closed or not understood."""
    found = [Table(m["key"], _names(m["columns"])) for m in MARK.finditer(text)]
    marks = len(re.findall(r"<!--\s*/?\s*bench\b", text))
    if marks != 2 * len(found):
        raise ValueError(f"{marks} marks for {len(found)} tables: each table needs `<!-- bench SUBJECT/SECTION -->` "
                         "and `<!-- /bench -->` on lines of their own")  # fmt: skip
    return found


def collect(report: Mapping[str, Any], wanted: Sequence[Table], remark: str = "") -> Kept:
    """Takes the wanted sections out of a report. Raises ValueError where one lacks a column that is to be shown."""
    about = {name: report[name] for name in ("machine", "date", "quick")} | ({"remark": remark} if remark else {})
    kept: Kept = {}
    for table in wanted:
        subject, _, name = table.key.partition("/")
        section = report["subjects"].get(subject, {}).get(name)
        if section is None:
            continue
        if missing := set(table.columns) - set(columns(section["rows"])):
            raise ValueError(f"{table.key} has no column {sorted(missing)[0]!r}")
        kept[table.key] = {name: section[name] for name in ("title", "command", "rows")} | about
    return kept


def written(text: str, kept: Kept) -> str:
    """Makes every table of a page anew; one of which nothing is kept stays empty."""

    def table(mark: re.Match[str]) -> str:
        first = mark[0].split("\n", 1)[0]
        section = kept.get(mark["key"])
        body = "\n" if section is None else f"{_body(section, _names(mark['columns']))}\n"
        return f"{first}\n{body}<!-- /bench -->"

    return MARK.sub(table, text)


def update(page: Path, reports: Sequence[Mapping[str, Any]], remark: str = "") -> list[str]:
    """Takes what a page shows out of the reports, keeps it, and writes the page; returns the keys of what was taken."""
    text, store = page.read_text(), page.with_suffix(".json")
    wanted = tables(text)
    kept: Kept = json.loads(store.read_text()) if store.exists() else {}
    taken: Kept = {}
    for report in reports:
        taken |= collect(report, wanted, remark)
    kept = {table.key: (kept | taken)[table.key] for table in wanted if table.key in kept | taken}
    store.write_text(json.dumps(kept, indent=1, ensure_ascii=False, default=str) + "\n")
    page.write_text(written(text, kept))
    return list(taken)


def _names(text: str | None) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split("|")) if text else ()


def _body(section: Mapping[str, Any], names: Sequence[str]) -> str:
    machine = section["machine"]
    command = section["command"] + (" --quick" if section["quick"] and "--quick" not in section["command"] else "")
    about = [f"`{command}`, {machine['cpu']}, {machine['cores']} cores, {section['date']}"]
    if "remark" in section:
        about.append(section["remark"])
    return f"\n{as_markdown(section['rows'], names)}\n\n{'; '.join(about)}.\n"


def main(argv: Sequence[str] | None = None) -> None:
    """Takes the command line's reports into the page."""
    parser = command.parser_of("bench.documents", __doc__ or "")
    parser.add_argument(
        "reports", nargs="*", type=Path, metavar="REPORT.json", help="of `evis bench`, or of --out FILE"
    )
    pages = " and ".join(map(str, PAGES))
    parser.add_argument("--page", type=Path, action="append", help=f"{pages} when not given")
    parser.add_argument("--remark", default="", help="what is said beside the figures of these reports")
    args = parser.parse_args(argv)
    for page in args.page or PAGES:
        try:
            taken = update(page, [json.loads(path.read_text()) for path in args.reports], args.remark)
        except (ValueError, OSError) as error:
            parser.exit(1, f"{parser.prog}: {error}\n")
        print(f"{page}: " + (", ".join(taken) or "written from what is kept"))


if __name__ == "__main__":
    main()
