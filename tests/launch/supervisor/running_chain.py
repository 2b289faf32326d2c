"""A graph of four processes as `evis launch` runs it, and what is left of it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from launcher import LIMIT_S, Launcher

Write = Callable[..., Path]


Launch = Callable[..., Launcher]


CHAIN = """
args:
  n: {default: 0}
  out: {default: ''}
  sleep: {default: 0.001}
  setup_s: {default: 0.0}
  fail_at: {default: -1}
  die_at: {default: -1}
  how: {default: 9}
  once: {default: ''}
  respawn: {default: false}
  marker: {default: ''}
  mark_at: {default: 0}
nodes:
  ticker:
    type: graph_nodes:Ticker
    params:
      {count: "${n}", sleep: "${sleep}", setup_s: "${setup_s}", marker: "${marker}", mark_at: "${mark_at}"}
  relay:
    type: graph_nodes:Relay
    respawn: ${respawn}
    params: {fail_at: "${fail_at}", die_at: "${die_at}", how: "${how}", once: "${once}"}
  collector: {type: "graph_nodes:Collector", params: {path: "${out}"}}
  viewer: {type: "graph_nodes:Viewer", tap: true}
"""


NAMES = {"ticker", "relay", "collector", "viewer"}


def running(launcher: Launcher) -> bool:
    """All four processes are there and the graph has gone."""
    return {p.cmdline()[-1] for p in launcher.children() if p.is_running()} == NAMES


def nothing_left(launcher: Launcher, runtime: Path) -> None:
    assert launcher.survivors() == []
    end = time.monotonic() + LIMIT_S
    while (left := list((runtime / "evis").iterdir())) and time.monotonic() < end:
        time.sleep(0.02)
    assert left == [], "the run's directory is gone"
    assert not [name for name in os.listdir("/dev/shm") if "evis" in name]


def last_json(out: str) -> dict[str, Any]:
    return json.loads(out.splitlines()[-1])
