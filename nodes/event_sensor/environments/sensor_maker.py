"""Makes the sensors of a node's environments: one where they can share it, else one for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from evis.config.params import EACH
from evis.random_numbers import seed_of_camera, seed_of_time
from evis.scene.parameters import of_environment, seeds_of
from nodes.event_sensor.environments.separate import SeparateSensors
from nodes.event_sensor.make import make_sensor
from nodes.event_sensor.model.features import background_rate
from nodes.event_sensor.parameters import why_unmarked
from nodes.event_sensor.scene_parameters import check_shared, resolve_each


class SensorMaker:
    """Makes sensors of a node's parameters, those that the scene gives or draws included.

    owner: name of the node, for messages. params: of the node. resolved: all of SENSOR, of environment 0. camera: the
    node's, below its namespace. marked: events tell whether light or noise made them.
    """

    def __init__(
        self, owner: str, params: Mapping[str, Any], resolved: Mapping[str, Any], camera: str, marked: bool
    ) -> None:  # fmt: skip
        self._owner, self._params, self._resolved = owner, params, resolved
        self._camera, self._marked = camera, marked
        self.fire_in_constant_light = False
        """Whether some sensor that was made fires in constant light."""

    def check(self) -> None:
        """Raises ValueError for parameters of any environment that do not go together, before a sensor is made."""
        self._check_marked(resolve_each(self._owner, self._params, self._params["envs"]))

    def _check_marked(self, each: Sequence[Mapping[str, Any]]) -> None:
        """Raises ValueError where events are to be marked and cannot. each: as of `why_unmarked`."""
        if self._marked and (why := why_unmarked(self._params["camera"], each)):
            raise ValueError(f"{self._owner}: {why}")

    def make(self, height: int, width: int, span: slice, seed: int | None = None, number: int = 0) -> Any:
        """Makes the sensor of some environments, or one for each where they have, or the scene draws, different
        parameters.

        span: the environments. seed: of the first of them, None = as the node has it. number: of the reset at which
        their time begins.
        """
        params, envs = self._params_of(span, seed), span.stop - span.start
        each = resolve_each(self._owner, params, envs)
        seeds = seeds_of({**params, "envs": envs})
        run = f"with seed {of_environment(self._params, 0)['seed']}"
        check_shared(self._owner, each[0], f"with seed {seeds[0]}", self._resolved, run)
        self._check_marked(each)
        self.fire_in_constant_light = self.fire_in_constant_light or any(map(fires_in_constant_light, each))
        if len(each) == 1 and seeds == list(range(seeds[0], seeds[0] + envs)):
            return self._make_one((height, width), envs, each[0], seeds[0], number)
        single = [(each[k % len(each)], own) for k, own in enumerate(seeds)]
        return SeparateSensors([self._make_one((height, width), 1, p, own, number) for p, own in single])

    def _params_of(self, span: slice, seed: int | None) -> dict[str, Any]:
        """Gives the node's parameters, as those environments have them; arguments as of `make`."""
        if EACH not in self._params:
            return {**self._params, "seed": self._params["seed"] + span.start if seed is None else seed}
        each = self._params[EACH][span]
        if seed is not None:
            each = [{**own, "seed": seed + k} for k, own in enumerate(each)]
        return {**self._params, EACH: each}

    def _make_one(self, shape: tuple[int, int], envs: int, p: Mapping[str, Any], seed: int, number: int) -> Any:
        """Makes one sensor, or another event model behind the same interface.

        shape: height and width [px]. p: all of SENSOR, resolved. seed: of its first environment. number: as of `make`.
        """
        seed = seed_of_camera(seed, self._camera)
        return make_sensor(
            p, shape, envs, colour=self._params["colour"], device=self._params["device"], seed=seed,
            time_seed=seed_of_time(seed, number), marked=self._marked,
        )  # fmt: skip


def fires_in_constant_light(p: Mapping[str, Any]) -> bool:
    """Tells whether a sensor of these parameters may fire in constant light. p: all of SENSOR, resolved."""
    return p["model"] != "evis" or p["photoreceptor_noise"] > 0 or background_rate(p) > 0
