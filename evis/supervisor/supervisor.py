"""Starts the processes of a plan, lets them begin together, watches them, and ends them in order."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from evis.config.secret import Redactor
from evis.console.printable import printable
from evis.console.voice import Voice
from evis.runtime.hosting.wiring import load_class
from evis.runtime.plan import NodePlan, Plan
from evis.runtime.process.control import ControlServer, control_address
from evis.supervisor import silence
from evis.supervisor.child import Child
from evis.supervisor.early import EarlyStart
from evis.supervisor.failure_cause import cause_unheard, describe_failure, ended_by_force, first_cause, last_words
from evis.supervisor.interrupts import Interrupts
from evis.supervisor.logs import Logs
from evis.supervisor.node_process import PLAN
from evis.supervisor.report import Report, summarise
from evis.supervisor.run_directory import RunDirectory, writing

DRAIN_S = 5.0
"""Time that the graph may take to end by itself after a stop before it gets SIGTERM, and then SIGKILL [s]."""
START_DRAIN_S = 1.0
"""DRAIN_S of a graph that has not begun, when there is nothing to lose yet [s]."""
SETTLE_S = 0.4
"""Time to listen after a failure, so that the cause is named and not its consequences [s]."""
CAUSE_S = 3.0
"""SETTLE_S while only consequences are known: who left has closed its sockets, and its process may end later [s]."""
LAST_WORD_S = 0.2
"""Time to listen for what a process wrote before it ended [s]; it waits for the answer, but not for ever."""
MAX_RESPAWNS = 5
BUSY_S = 30.0
"""A node that has been in one call for so long is mentioned, once [s]."""
HELD_S = 1.0
"""A turn of the supervisor's own loop that took longer was held up: by Ctrl-Z, or by a busy machine [s]."""
_TICK_S = 0.05


class Supervisor:
    """Runs one plan to its end.

    say: takes one line for the user. tick: called with the progress so far. early: what was started before the plan.
    stop_after_s: when to stop a graph that has begun, on the wall clock [s]; None = its sources end by themselves.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        say: Callable[[str], None] | None = None,
        tick: Callable[[dict[str, Any]], None] | None = None,
        debug: bool = False,
        early: EarlyStart | None = None,
        stop_after_s: float | None = None,
    ) -> None:
        self.plan = plan
        self._stop_after_s = stop_after_s
        self._early = early
        self._voice = Voice(say, tick)
        self._tell, self._tick = self._voice.say, self._voice.tick
        self._redactor = Redactor(plan.secrets)
        self._debug = debug
        self._children: dict[str, Child] = {}
        self._interrupts = Interrupts()
        self._stopped_at = 0.0
        self._signals_sent = 0
        self._failed_at = 0.0
        self._cause: str | None = None
        self._started = 0.0
        self._running_since = 0.0
        self._ended_at = 0.0
        self._last_turn_at = 0.0
        self._logs = Logs(self._say, debug)

    def run(self) -> Report:
        """Runs until everything has ended, and reports the outcome; nothing is left behind."""
        self._started = time.monotonic()
        directory = self._early.directory() if self._early is not None else RunDirectory()
        self.plan.run_id = directory.run_id
        self.plan.directory = str(directory.path)
        try:
            with writing(directory.path):
                self.plan.save(directory.path / PLAN)
            with self._control(), self._interrupts.counted():
                for name, nodes in self.plan.processes().items():
                    self._add(name, nodes)
                for child in self._children.values():
                    child.start(self._early.process(child.name) if self._early is not None else None)
                if self._early is not None:
                    self._early.close()  # nobody has that name, if it was not taken
                self._loop()
            return summarise(
                self.plan,
                [child.summary for child in self._children.values()],
                startup_s=(self._running_since or time.monotonic()) - self._started,
                wall_s=self._ended_at - self._running_since if self._running_since else 0.0,
                failure=None if self._cause is None else self._redactor.text(self._cause),
                interrupted=self._interrupts.count > 0,
            )
        finally:
            self._kill_all()
            directory.close()
            self._voice.close()

    # -- set-up ------------------------------------------------------------------------------------------------------

    def _add(self, name: str, nodes: list[NodePlan]) -> Child:
        child = Child(name, nodes, Path(self.plan.directory), service=all(self._is_service(n) for n in nodes))
        self._children[name] = child
        return child

    def _is_service(self, node: NodePlan) -> bool:
        """Tells whether a node is neither a source nor fed by declared inputs: then it lives until the others have
        ended."""
        if load_class(node.target).SOURCE:
            return False
        edges = [e for topics in node.inputs.values() for t in topics if t in self.plan.topics
                 for e in self.plan.topics[t].edges if e.node == node.name]  # fmt: skip
        return all(edge.kind == "tap" for edge in edges)

    @contextlib.contextmanager
    def _control(self) -> Iterator[None]:
        self._server = ControlServer(control_address(self.plan.directory))
        try:
            yield
        finally:
            self._server.close()

    # -- the loop ----------------------------------------------------------------------------------------------------

    def _loop(self) -> None:
        while not all(child.ended and not child.alive() for child in self._children.values()):
            for process, message in self._server.poll(_TICK_S):
                self._handle(process, message)
            self._excuse_own_pause()
            for child in list(self._children.values()):
                self._check_alive(child)
            self._start_together()
            self._end_in_order()
            self._logs.forward(self._children.values())
            self._tick(self._progress())
        self._logs.drain(self._children.values())
        if self._cause is None:
            self._name_cause()

    def _excuse_own_pause(self) -> None:
        """Shifts the deadlines of others by the time for which this process itself was held up and heard nobody."""
        now = time.monotonic()
        pause, self._last_turn_at = now - (self._last_turn_at or now), now
        if pause > HELD_S:
            for child in self._children.values():
                child.heard_at = min(now, child.heard_at + pause)
            if self._stopped_at:
                self._stopped_at = min(now, self._stopped_at + pause)

    def _handle(self, process: str, message: dict[str, Any]) -> None:
        if "want" in message:
            self._start_dormant(str(message["want"]))
            return
        child = self._children.get(process)
        if child is None:
            return
        child.heard_at = time.monotonic()
        if "tell" in message:
            self._tell(f"{message.get('node')}: {message['tell']}")
        elif "ready" in message and child.state == "starting":
            child.state = "ready"
            if self._running_since:
                self._set_running(child)
        elif "heartbeat" in message:
            child.stats = message.get("stats") or {}
            child.busy_s = float(message.get("busy_s") or 0.0)
            if self._stopped_at and (not child.service or self._workers_ended()):
                self._server.send(process, {"stop": 1})  # the first one came before the process could hear it
        elif "done" in message:
            child.state = "done"
            child.summary = message.get("summary") or {}
            if not child.service:
                self._ended_at = time.monotonic()
            self._server.send(process, {"bye": 1})
        elif "failed" in message:
            child.state = "failed"
            child.failure = (str(message.get("node")), " ".join(str(message.get("text")).split()))
            self._server.send(process, {"bye": 1})
            self._on_failure(child)

    def _start_together(self) -> None:
        """Starts all processes once all are ready, unless the graph was told to end before."""
        if (
            not self._running_since
            and not self._stopped_at
            and all(c.state == "ready" for c in self._children.values())
        ):
            self._running_since = self._ended_at = time.monotonic()
            for child in self._children.values():
                self._set_running(child)

    def _set_running(self, child: Child) -> None:
        child.state, child.busy_s = "running", 0.0
        self._server.send(child.name, {"go": 1})

    def _start_dormant(self, topic: str) -> None:
        """Starts the dormant node that publishes a topic, again if it has died, and those whose topics it reads."""
        planned = self.plan.topics.get(topic)
        node = self.plan.nodes.get(planned.node) if planned else None
        if node is None or not node.dormant or self._stopped_at:
            return
        child = self._children.get(node.process)
        if child is not None:
            self._check_alive(child)  # it may have died just now
        if child is None:
            child = self._add(node.process, [node])
        elif child.state == "failed" and not child.alive() and child.respawns < MAX_RESPAWNS:
            child.respawns += 1
            child.failure, child.spared = None, False
        else:
            child = None
        if child is not None and self._start_again(child):
            for read in (name for topics in node.inputs.values() for name in topics):
                self._start_dormant(read)

    def _start_again(self, child: Child) -> bool:
        """Starts a process while the graph runs. Where the system refuses, as it does where there are too many, that is
        the failure of this process, and the others end in order; gives whether it was started."""
        try:
            child.start()
        except OSError as error:
            child.failure = (child.name, f"it cannot be started: {error.strerror or error}")
            child.state = "failed"
            self._on_failure(child)
            return False
        return True

    def _check_alive(self, child: Child) -> None:
        """Handles the death or silence of a process, and mentions one that is in a single call for long."""
        if child.ended:
            return
        if not child.alive():
            # What it wrote last may still be under way to us.
            end = time.monotonic() + LAST_WORD_S
            while not child.ended and time.monotonic() < end:
                for process, message in self._server.poll(LAST_WORD_S):
                    self._handle(process, message)
            if not child.ended and not child.alive():  # unless it was wanted meanwhile, and started again
                child.state = "failed"
                self._on_failure(child)
            return
        if child.busy_s > BUSY_S and child.state != "ready" and not child.mentioned:
            child.mentioned = True
            step = f"in one step of {child.where}" if child.where else "in one step"
            doing = step if child.state == "running" else "getting ready (kernels may be compiling)"
            self._say(f"{child.title}: {doing} for {BUSY_S:g} s now")
        if silence.end_if_frozen(child):
            self._on_failure(child)

    def _on_failure(self, child: Child) -> None:
        """Starts a failed process again where it may, goes on without a service, or notes the failure."""
        if self._signals_sent and child.failure is None:
            return  # our own signal
        if all(node.respawn for node in child.nodes) and child.respawns < MAX_RESPAWNS and not self._stopped_at:
            child.respawns += 1
            self._say(f"{describe_failure(child)}; started again ({child.respawns} of {MAX_RESPAWNS})")
            if child.process is not None:
                child.process.wait(10)
            child.failure = None
            self._start_again(child)
            return
        if child.service and self._running_since:
            child.spared = True
            self._say(f"{describe_failure(child)}; the graph goes on without it")
        elif not self._failed_at:
            self._failed_at = time.monotonic()

    # -- the end -----------------------------------------------------------------------------------------------------

    def _end_in_order(self) -> None:
        """Stops the graph where it is due: first by message, then by SIGTERM, then by SIGKILL."""
        now = time.monotonic()
        if self._failed_at and not self._stopped_at and now - self._failed_at > self._settle_s():
            self._name_cause()
            self._stop(now)
        elif (self._interrupts.count or self._time_is_up(now)) and not self._stopped_at:
            self._stop(now)
        elif not self._stopped_at and self._workers_ended():
            if self._failed_at:
                self._name_cause()  # nobody is left from whom another one could come
            self._stop(now)
        if self._stopped_at and self._workers_ended():
            self._stop_services()
        if not self._stopped_at:
            return
        waited, patience = now - self._stopped_at, DRAIN_S if self._running_since else START_DRAIN_S
        if self._signals_sent == 0 and (waited > patience or self._interrupts.count > 1):
            self._signals_sent, self._stopped_at = 1, now
            self._signal_all(signal.SIGTERM)
        elif self._signals_sent == 1 and (waited > patience or self._interrupts.count > 2):
            self._signals_sent = 2
            self._signal_all(signal.SIGKILL)

    def _settle_s(self) -> float:
        """Gives how long to listen after a failure [s]."""
        unheard = cause_unheard(self._failed()) and not self._interrupts.count
        return CAUSE_S if unheard and not silence.suspects(self._children.values()) else SETTLE_S

    def _failed(self) -> list[Child]:
        return [child for child in self._children.values() if child.state == "failed" and not child.spared]

    def _time_is_up(self, now: float) -> bool:
        return (
            bool(self._running_since)
            and self._stop_after_s is not None
            and now - self._running_since >= self._stop_after_s
        )

    def _workers_ended(self) -> bool:
        """Tells whether only services are left. A graph of services alone lives until it is stopped."""
        workers = [c for c in self._children.values() if not c.service]
        return all(c.ended for c in workers) and (bool(workers) or self._stopped_at > 0)

    def _stop(self, now: float) -> None:
        """Stops the sources: the end of their streams then passes through, and recorders close their files whole."""
        self._stopped_at = now
        for child in self._children.values():
            if not child.service:
                self._server.send(child.name, {"stop": 1})

    def _stop_services(self) -> None:
        stop: dict[str, Any] = {"stop": 1}
        if self._cause is not None:
            stop["cause"] = printable(self._redactor.text(self._cause))
        for child in self._children.values():
            if child.service and not child.ended:
                self._server.send(child.name, stop)

    def _signal_all(self, number: signal.Signals) -> None:
        for child in self._children.values():
            child.signal(number)

    def _kill_all(self) -> None:
        self._signal_all(signal.SIGKILL)
        for child in self._children.values():
            if child.process is not None:
                with contextlib.suppress(Exception):
                    child.process.wait(10)

    def _name_cause(self) -> None:
        """Finds the cause of a failure, and shows the last words of its process."""
        if self._failed_at:
            silence.end_suspects(self._children.values())
        failed = self._failed()
        if not failed:
            return
        if not self._failed_at:
            # One that is stopped before it has begun has nothing to lose.
            self._cause = ended_by_force(failed, DRAIN_S, self._interrupts.count > 1) if self._running_since else None
            return
        child = first_cause(failed)
        self._cause = describe_failure(child)
        if child.failure is None and not self._debug:
            for line in last_words(child):
                self._say(line)

    # -- what the user sees ------------------------------------------------------------------------------------------

    def _say(self, line: str) -> None:
        """Shows one line to the user, without the secrets of the run, for it may be kept in a file."""
        self._tell(printable(self._redactor.text(line)))

    def _progress(self) -> dict[str, Any]:
        stats = [child.stats for child in self._children.values()]
        total = {key: sum(int(s.get(key, 0)) for s in stats) for key in ("events", "keyframes", "frames")}
        return total | {
            "stamp_ns": max((int(s.get("stamp_ns", 0)) for s in stats), default=0),
            "running": bool(self._running_since),
        }
