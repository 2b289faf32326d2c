"""Controls a running graph from another program."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from evis.client.requests import ACTION, RESET, Requests, camera_settings, controls_of, taker
from evis.client.resets import environments_of, seeds_of
from evis.client.running import choose, which_of_several
from evis.client.topics import TopicReader
from evis.runtime.outside import ANY_STAMP
from evis.runtime.plan import Plan
from msgs.camera import CameraSettings
from msgs.header import Header
from msgs.world import Action, Reset

PATIENCE_S = 60.0
"""How long a step in lock-step waits for its action before control is lost [s]."""


def connect(run: str | None = None, *, wait_s: float = 0.0) -> Run:
    """Connects to a graph that runs on this machine, as this user.

    Args:
        run: its id, or the beginning of it, as `evis node list` shows; the newest if not given.
        wait_s: how long to wait for one to be started [s].

    Raises:
        ValueError: none is running.
    """
    plan, others = choose(run, wait_s)
    if line := which_of_several(run, plan, others, "evis.connect(ID) takes another"):
        warnings.warn(line, stacklevel=2)
    return Run(plan)


class Run:
    """Holds a running graph: reads its topics, gives it actions, resets its environments. All from one thread.

    id, name: of the run. topics: name -> type. actuators: names, lowest and highest control once it controls /action.
    lockstep: whether every step waits for its action, once it controls /action.
    """

    def __init__(self, plan: Plan) -> None:
        self.id, self.name = plan.run_id, plan.name
        self.topics = {name: plan.topics[name].type for name in plan.open_topics()}
        self.actuators: list[tuple[str, float, float]] = []
        self.lockstep = False
        self._plan = plan
        self._envs = 1
        self._controls = False
        self._requests: dict[str, Requests] = {}
        self._readers: list[TopicReader] = []
        self._closed = False

    def topic(self, name: str, *, every: bool = True) -> TopicReader:
        """Reads a topic from now on: `for packet in run.topic("/cam0/events")`.

        Args:
            name: of the topic.
            every: every message; False: at most 30 in a second (of events 250), as viewers read.

        Raises:
            ValueError: the graph has no such topic.
            ConnectionError: this was closed.
        """
        self._check_open()
        reader = TopicReader(self._plan, name, every=every)
        self._readers.append(reader)
        return reader

    def take(self, *, lockstep: bool | None = None, patience_s: float = PATIENCE_S) -> int:
        """Takes control of /action, until `leave` or the end of this program.

        Args:
            lockstep: whether physics waits for an action at every step; otherwise the latest one holds. None: as the
                run does, which waits unless it keeps to the wall clock.
            patience_s: how long a step waits for its action before control is lost [s].

        Returns:
            The stamp [ns] from which on it has control; in lock-step the one whose action physics waits for.

        Raises:
            ConnectionRefusedError: control is not to be had, with the reason.
        """
        requests = self._to(ACTION)
        self._make_room()
        welcome = requests.attach(ACTION, lockstep, patience_s)
        offer = welcome["offer"]
        self._envs, self.lockstep, self._controls = offer["envs"], bool(welcome["lockstep"]), True
        self.actuators = list(zip(offer["names"], offer["low"], offer["high"]))
        return self._due(requests) if self.lockstep else int(welcome["stamp_ns"])

    def act(self, values: Any, stamp_ns: int | None = None) -> int:
        """Gives an action; takes control first where that has not been done.

        Args:
            values: one control per actuator [nu], for all environments alike, or [E, nu], in the model's units.
            stamp_ns: the step that it is meant for, by the stamp [ns] at which that begins; None = the next.

        Returns:
            The stamp [ns] of the state from which on it holds.

        Raises:
            ValueError: values that are not finite, out of range or of a wrong shape, a stamp that has passed; physics
                then waits for another action in lock-step, and keeps the last one otherwise.
            ConnectionError: control was refused or lost, or the graph has ended.
        """
        requests = self._to(ACTION)
        requests.catch_up()
        self._still_in_control(requests)
        if not self._controls:
            self.take()
        due = self._due(requests) if self.lockstep else None
        controls = controls_of(values, self._envs, len(self.actuators))
        stamp = ANY_STAMP if stamp_ns is None else int(stamp_ns)
        now = requests.send(ACTION, Action(Header(stamp), controls))
        return now if due is None else due

    def due(self) -> int:
        """Waits until physics waits for an action in lock-step, and returns the stamp [ns] of that step.

        Raises:
            ValueError: it controls nothing in lock-step.
            ConnectionError: control was lost, or the graph has ended.
        """
        if not self._controls or not self.lockstep:
            raise ValueError(f"no step of {self.name} waits for this program; run.take() in lock-step makes them wait")
        return self._due(self._to(ACTION))

    def _due(self, requests: Requests) -> int:
        """Wait until a step waits."""
        self._make_room()
        while requests.due_ns is None:
            requests.catch_up(1.0)
            self._still_in_control(requests)
        return requests.due_ns

    def _make_room(self) -> None:
        """Has the newest message of each topic find room, for the graph may stand still until it is answered."""
        for reader in self._readers:
            reader.make_room()

    def _still_in_control(self, requests: Requests) -> None:
        if requests.lost:
            why, requests.lost, self._controls = requests.lost, "", False
            raise ConnectionError(f"{self.name}: {why}")

    def leave(self) -> None:
        """Hands control of /action back; the last action holds until somebody gives another."""
        if self._controls:
            self._controls = False
            self._to(ACTION).leave()

    def reset(self, seed: int | Sequence[int] | None = None, envs: Sequence[int] | None = None) -> int:
        """Begins environments anew at the next step, as the next episode.

        Args:
            seed: of the first environment, the others have the following ones; or one for each. None: they keep theirs.
            envs: which ones, by their numbers; None = all.

        Returns:
            The stamp [ns] of the last state before it.

        Raises:
            ValueError: an environment that is not there, seeds that do not fit, a mask in place of numbers.
            ConnectionError: the run has no physics to reset, or it has ended.
        """
        chosen = np.empty(0, np.int64) if envs is None else environments_of(envs)
        if envs is not None and not chosen.size:
            raise ValueError("a reset of no environment; leave envs out to reset all")
        seeds = [] if seed is None else seeds_of(seed, range(len(chosen) or self._count()))
        return self._to(RESET).send(RESET, Reset(Header(0), chosen.astype(np.int32), np.array(seeds, np.int64)))

    def set_camera(self, camera: str | None = None, **settings: Any) -> int:
        """Changes settings of a USB camera while it streams: `run.set_camera(bias_fo=-10, roi_width=64)`.

        All of them are written, or none where one is refused. What the camera has from then on is on its info topic.

        Args:
            camera: its name in the topics; may be left out where one camera takes settings.
            settings: names and values, as `evis camera info --settings` lists them.

        Returns:
            The stamp [ns] of the last packet before it, on the camera's clock.

        Raises:
            ValueError: a setting that there is not, out of its range, or one that is decided when the camera starts.
            ConnectionError: the camera takes no settings, as a simulated one does not, or the run has ended.
        """
        topic = camera_settings(self._plan, camera)
        message = CameraSettings(Header(0), {name: str(value) for name, value in settings.items()})
        return self._to(topic).send(topic, message)

    def _count(self) -> int:
        """Environments of the run."""
        return int(self._plan.nodes[taker(self._plan, RESET)].params.get("envs", 1))

    def _check_open(self) -> None:
        if self._closed:
            raise ConnectionError(f"the connection to {self.name} was closed; evis.connect() makes another")

    def _to(self, topic: str) -> Requests:
        self._check_open()
        node = taker(self._plan, topic)
        if node not in self._requests:
            self._requests[node] = Requests(self._plan, node)
        return self._requests[node]

    def close(self) -> None:
        """Hands back what it controls and ends all reading; nothing can be asked for afterwards."""
        for requests in self._requests.values():
            try:
                if self._controls:
                    self.leave()
            except ConnectionError:
                pass  # the graph has ended
            requests.close()
        for reader in self._readers:
            reader.close()
        self._requests, self._readers = {}, []
        self._closed = True

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
