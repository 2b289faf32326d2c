"""Runs a whole plan within the test's own process."""

import threading

from evis.runtime.executor import Executor
from evis.runtime.plan import Plan


def run_in_threads(plan: Plan, timeout: float = 120.0) -> dict[str, BaseException]:
    """Runs every process of a plan as a thread; returns what each of them raised."""
    errors: dict[str, BaseException] = {}
    executors = {process: Executor(plan, process) for process in plan.processes()}

    def life(process: str) -> None:
        executor = executors[process]
        try:
            executor.setup()
            executor.wait_connected(60.0)
            executor.run()
        except BaseException as error:
            errors[process] = error
            for other in executors.values():
                other.stop()
        finally:
            executor.close()

    threads = [threading.Thread(target=life, args=(p,), daemon=True) for p in executors]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout)
    assert not any(t.is_alive() for t in threads), "the graph hangs"
    return errors
