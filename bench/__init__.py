"""Error against run time, stability and throughput. One module per subject, each with `measure(quick) -> dict`.

A result is a dict of sections; a section is {"title", "command", "rows": [{column: value}], "note"}. `evis bench` runs
the modules, writes report.json and index.html, and every figure in the README comes from there.
"""
