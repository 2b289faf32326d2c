"""Starts the processes of a plan, watches them, ends them in order, and leaves nothing behind.

The way of a run:

1. `run_directory.py` makes its directory, which `cleanup.py` removes whatever happens; `early.py` starts the process
   that takes longest to get ready before there is a plan.
2. `supervisor.py` starts the others (`child.py`, `node_process.py`), lets all begin together, watches them, ends those
   that are frozen (`silence.py`), and passes on what they write (`logs.py`).
3. At the end, or on a signal (`interrupts.py`), it stops them in order; `failure_cause.py` names the cause of a
   failure.
4. `report.py` makes the summary, with the error of `audits.py` and the pace of `paces.py`.
"""
