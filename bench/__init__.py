"""Measures error against run time, stability and throughput of the simulator; each subject has a folder.

Each benchmark is a module with `measure(quick) -> dict` of sections; a section is {"title", "command", "rows":
[{column: value}], "note"}. `evis bench` runs those of `bench.report.SUBJECTS` and writes report.json and index.html;
every one, those of `bench.report.BY_THEMSELVES` too, of a GPU among them, runs as `python -m bench.ROOM.NAME`
(`--help`). The tables of docs/performance.md and docs/dynamics.md are written from such reports by `bench.documents`.
"""
