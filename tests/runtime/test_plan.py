"""The plan of a run as others read it while it is written."""

import threading
from pathlib import Path

from evis.runtime.plan import NodePlan, Plan


def test_a_plan_is_read_whole_while_it_is_written(tmp_path: Path) -> None:
    """Who looks for running graphs would take one with half a plan for none."""
    nodes = {f"node{k}": NodePlan(f"node{k}", "a.b:C", {"x": k}, "p") for k in range(200)}
    plan, path = Plan("many", "run", "", nodes=nodes), tmp_path / "plan.json"
    plan.save(path)
    written = threading.Event()

    def write() -> None:
        for _ in range(100):
            plan.save(path)
        written.set()

    writer = threading.Thread(target=write)
    writer.start()
    looks = 0
    while not written.is_set():
        assert len(Plan.load(path).nodes) == 200
        looks += 1
    writer.join()
    assert looks > 3 and [p.name for p in tmp_path.iterdir()] == ["plan.json"]
