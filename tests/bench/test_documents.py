"""The tables of a page are those of reports, and those of the pages of docs/ are what is kept of them."""

import json
from pathlib import Path

import pytest

from bench import documents, report
from evis.cli import main

ROOT = Path(__file__).parents[2]
PAGE = """# T

<!-- bench drawn/s: b | a -->
<!-- /bench -->

<!-- bench other.gpu/t -->
<!-- /bench -->
"""
MACHINE = {"cpu": "X", "cores": 2, "python": "3", "system": "Linux"}
ROWS = [{"a": 1, "b": "x|y"}, {"b": 2}]


def made(subject, section, rows=ROWS):
    sections = {section: {"title": "T", "command": "evis bench drawn", "rows": rows, "note": "n"}}
    return {"machine": MACHINE, "date": "2026-01-02", "quick": True, "subjects": {subject: sections}}


def test_a_table_has_the_columns_that_its_mark_names(tmp_path):
    page = tmp_path / "p.md"
    page.write_text(PAGE)
    assert documents.update(page, [made("drawn", "s")], "loaded") == ["drawn/s"]
    text = page.read_text()
    assert "| b | a |\n| --- | --- |\n| x\\|y | 1 |\n| 2 |  |\n\n`evis bench drawn --quick`, X, 2 cores" in text
    assert "2026-01-02; loaded." in text and "<!-- bench other.gpu/t -->\n\n<!-- /bench -->" in text


def test_what_a_report_lacks_stays_as_it_was(tmp_path):
    """And a page that is written once more is the same."""
    page = tmp_path / "p.md"
    page.write_text(PAGE)
    documents.update(page, [made("drawn", "s")])
    first = page.read_text()
    documents.update(page, [made("other.gpu", "t", [{"c": 5}])])
    second = page.read_text()
    assert "x\\|y" in second and "| c |" in second and second != first
    assert documents.update(page, []) == [] and page.read_text() == second


@pytest.mark.parametrize(
    "text",
    [
        "<!-- bench a/b -->\nno end\n",
        "<!-- bench a -->\n<!-- /bench -->\n",
        "text <!-- bench a/b -->\n<!-- /bench -->\n",
        "<!-- /bench -->\n",
    ],
)
def test_marks_that_make_no_table_are_refused(text):
    with pytest.raises(ValueError, match="marks for 0 tables"):
        documents.tables(text)


def test_a_column_that_is_not_there_is_named(tmp_path, capsys):
    page = tmp_path / "p.md"
    page.write_text(PAGE)
    (tmp_path / "r.json").write_text(json.dumps(made("drawn", "s", [{"a": 1}])))
    with pytest.raises(SystemExit) as end:
        documents.main([str(tmp_path / "r.json"), "--page", str(page)])
    assert end.value.code == 1 and "drawn/s has no column 'b'" in capsys.readouterr().err
    assert page.read_text() == PAGE


def test_the_command_writes_the_page(tmp_path, monkeypatch):
    """`evis bench --docs`, with the report that it has just made."""
    page = tmp_path / "p.md"
    page.write_text(PAGE)
    monkeypatch.setattr(report, "run", lambda *given: made("drawn", "s") | {"notes": [], "failures": []})
    assert main(["bench", "graph", "--out", str(tmp_path), "--docs", str(page)]) == 0
    assert "x\\|y" in page.read_text()
    assert main(["bench", "graph", "--out", str(tmp_path), "--docs", str(tmp_path / "none.md")]) == 2


@pytest.mark.parametrize("page", documents.PAGES)
def test_a_page_of_figures_is_what_is_kept(page):
    """Every table of it is filled, by a command of this program, and written again is the same."""
    text = (ROOT / page).read_text()
    kept = json.loads((ROOT / page).with_suffix(".json").read_text())
    wanted = documents.tables(text)
    assert len(wanted) > 4 and [table.key for table in wanted] == list(kept)
    assert documents.written(text, kept) == text
    for table in wanted:
        section = kept[table.key]
        assert section["rows"] and section["date"] and section["machine"]["cpu"], table.key
        subject = table.key.split("/")[0]
        ours = f"evis bench {subject}" if subject in report.SUBJECTS else f"python -m bench.{subject}"
        assert section["command"].removesuffix(" --quick") == ours, table.key
