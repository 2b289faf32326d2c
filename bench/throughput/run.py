"""Runs one graph with a meter in it: the program of the process of each row of `python -m bench.gpu_graph`."""

from __future__ import annotations

import json
import sys
from typing import Any

from evis.launch.planner import Options, plan_launch
from evis.launch.target import read_target
from evis.supervisor.supervisor import Supervisor

METERED = "bench.throughput.meter:PhysicsNode"


def run(
    scene: str, args: dict[str, Any], meter: dict[str, Any], duration_s: float, record: str | None
) -> dict[str, Any]:
    """Runs a scene in one process, as `evis launch --compose --no-view` does, with a meter in it.

    Args:
        scene: what may stand after `evis launch`.
        args: of the launch file and the scene.
        meter: parameters of the metered source.
        duration_s: simulated time [s] at most.
        record: bag to record to.

    Returns the run's summary, with `failure`.
    """
    target = read_target(scene, args)
    options = Options(duration_s=duration_s, record=record, view=False, grouping="compose")
    plan = plan_launch(target.launch, target.given, options, frozenset())
    physics = plan.nodes["physics"]
    physics.target = METERED
    physics.params = dict(physics.params) | meter
    report = Supervisor(plan).run()
    return report.summary | {"failure": report.failure}


def main() -> None:
    """Runs what the first argument says, arguments of `run` as JSON, and prints the summary as one line of JSON."""
    print(json.dumps(run(**json.loads(sys.argv[1]))))
