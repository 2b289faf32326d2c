"""A benchmark by itself: `python -m bench.NAME [--quick] [--json]`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from typing import Any


def run(measure: Callable[[bool], dict[str, Any]], description: str) -> None:
    """Print the sections of `measure(quick)`, each a title, rows and a note, or all of it as JSON."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="less data, fewer repetitions")
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args()
    result = measure(args.quick)
    if args.json:
        print(json.dumps(result))
        return
    for section in result.values():
        print(section["title"])
        for row in section["rows"]:
            print("  " + "   ".join(f"{k}: {v}" for k, v in row.items()))
        print(section["note"])
