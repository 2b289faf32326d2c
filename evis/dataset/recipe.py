"""Describes which sequences a data set has. Each is a pure function of the recipe and its number."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from evis.dataset.draws import Axis, draw, key_of, stratified, turn, whole

STRATA = 1024
"""Most combinations of a grid over which splits have their shares to one of them."""


@dataclass(frozen=True)
class Plan:
    """Describes one sequence before it is made.

    name: of its folder, also that of a file. path: where it lies below the data set's folder. arguments: of the scene
    and the launch file, as the recipe has them. folders: those of them that are folders, where they lie here.
    outputs: of the simulation. layout: how it is written.
    """

    index: int
    name: str
    split: str
    path: str
    scene: str
    arguments: dict[str, Any]
    seed: int
    duration_s: float
    outputs: tuple[str, ...]
    labels: tuple[str, ...]
    layout: str
    folders: dict[str, str] = field(default_factory=dict)

    @property
    def given(self) -> dict[str, Any]:
        """Returns the arguments as the simulation is given them on this machine."""
        return {**self.arguments, **self.folders}

    @property
    def scene_name(self) -> str:
        """Returns the scene without the folder that it lies in, which may be another on another machine."""
        return Path(self.scene).stem

    def as_dict(self) -> dict[str, Any]:
        """Converts the plan to a dictionary of plain types, for JSON."""
        return asdict(self)

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Plan:
        """Makes a plan from what `as_dict` has returned."""
        lists = {name: tuple(values[name]) for name in ("outputs", "labels")}
        return Plan(**{**values, **lists})


@dataclass(frozen=True)
class SceneDraws:
    """Describes what is drawn of one scene. weight: of so many sequences in a round. where: file:line.

    home: the recipe's folder, from where folders among the arguments, those of the names `folders`, begin.
    """

    target: str
    weight: int
    constants: dict[str, Any]
    axes: tuple[Axis, ...]
    where: str
    home: str = ""
    folders: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Returns the scene's name as names of sequences have it."""
        return Path(self.target).stem

    @property
    def combinations(self) -> int:
        """Returns the number of points of the grid of its axes."""
        return math.prod(axis.levels for axis in self.axes)

    def corners(self) -> list[dict[str, Any]]:
        """Lists the arguments with everything at its first and at its last value, as a simulation is given them."""
        ends = [{axis.name: axis.at([u] * axis.components) for axis in self.axes} for u in (0.0, 1.0 - 2.0**-53)]
        found = [{**self.constants, **values} for values in ends]
        return [{**arguments, **self.places(arguments)} for arguments in found]

    def places(self, arguments: Mapping[str, Any]) -> dict[str, str]:
        """Finds where the folders among some arguments lie; "" is none."""
        given = {name: os.path.expanduser(arguments[name]) for name in self.folders if arguments.get(name)}
        return {name: os.path.abspath(os.path.join(self.home, folder)) for name, folder in given.items()}

    def all_folders(self) -> dict[str, str]:
        """Lists all folders that a sequence may read from, as the recipe names them, and where each lies."""
        named = [{axis.name: choice} for axis in self.axes for choice in axis.choices if axis.name in self.folders]
        named += [{name: self.constants[name]} for name in self.folders if name in self.constants]
        return {str(one[name]): place for one in named for name, place in self.places(one).items()}


@dataclass(frozen=True)
class Recipe:
    """Describes a data set. count: sequences that the recipe asks for; more can be made, and the first ones stay.

    seeds: sequences of each draw of arguments, which differ in their seed alone. duration: an axis, in seconds.
    splits: share of each, 1 in all; empty = none. text: what the file says, as JSON has it. files: those of the user's
    that the scenes are made of, name -> SHA-256.
    """

    name: str
    description: str
    layout: str
    count: int
    duration: Axis
    seed: int
    seeds: int
    sampling: str
    splits: dict[str, float]
    outputs: tuple[str, ...]
    labels: tuple[str, ...]
    scenes: tuple[SceneDraws, ...]
    text: dict[str, Any]
    files: dict[str, str] = field(default_factory=dict)

    @cached_property
    def digest(self) -> str:
        """Tells two recipes apart: a hash of all that decides about sequences, so not of their number in a grid."""
        said = {key: value for key, value in self.text.items() if key != "description"}
        if self.sampling != "latin":  # where the number of strata is part of every draw
            said.pop("sequences", None)
        if self.files:
            said["files"] = self.files
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()

    def changed(self, index: Mapping[str, Any]) -> str:
        """Names the first of the user's files that is another than that of a data set of this recipe; "" = none is."""
        before = index.get("recipe_files", {})
        said = {key: value for key, value in index.get("recipe", {}).items() if key not in ("name", "description")}
        mine = {key: value for key, value in self.text.items() if key not in ("name", "description")}
        if said != mine:
            return ""
        names = [name for name in {**before, **self.files} if before.get(name) != self.files.get(name)]
        return names[0] if names else ""

    @cached_property
    def _round(self) -> tuple[int, ...]:
        """The scene of each draw of a round, spread so that no scene stands at its end alone."""
        places = [((turn + 0.5) / s.weight, i) for i, s in enumerate(self.scenes) for turn in range(s.weight)]
        return tuple(i for _, i in sorted(places))

    def sequence(self, index: int) -> Plan:
        """Draws the sequence of this number, 0 or more."""
        n, _ = divmod(index, self.seeds)
        rounds, place = divmod(n, len(self._round))
        scene = self.scenes[self._round[place]]
        draw_of_scene = rank = rounds * scene.weight + self._round[:place].count(self._round[place])
        strata = max(1, math.ceil(self.count * scene.weight / (len(self._round) * self.seeds)))
        grid = self.sampling == "grid"
        rank = rank % scene.combinations if grid else rank
        drawn = draw(scene.axes, self.sampling, self.seed, scene.name, rank, strata)
        how = "random" if grid else self.sampling
        draws = max(1, math.ceil(self.count / self.seeds))
        (duration,) = draw([self.duration], how, self.seed, "", n, draws).values()
        name, split = f"{scene.name}_{index:05d}", self._split(draw_of_scene, self._round[place])
        arguments = {**scene.constants, **drawn}
        return Plan(
            index=index,
            name=name,
            split=split,
            path=f"{split}/{name}" if split else name,
            scene=scene.target,
            arguments=arguments,
            seed=whole(key_of(self.seed, "seed"), index),
            duration_s=float(duration),
            outputs=self.outputs,
            labels=self.labels,
            layout=self.layout,
            folders=scene.places(arguments),
        )

    def sequences(self, count: int | None = None) -> Sequence[Plan]:
        """Draws the first sequences, as many as the recipe says or `count`."""
        return [self.sequence(index) for index in range(self.count if count is None else count)]

    def makes(self, split: str) -> bool:
        """Tells whether there is ever a sequence in a split: one of share 0 has none, and a small grid may have none
        for a small share.
        """
        if not self.splits.get(split):
            return False
        if self.sampling != "grid":
            return True
        scenes = [(i, scene.combinations) for i, scene in enumerate(self.scenes)]
        return any(of == 1 or any(self._split(n, i) == split for n in range(of)) for i, of in scenes)

    def _split(self, n: int, scene: int) -> str:
        """The split of a scene's n-th draw; all seeds of one are in the same, so that nothing of it is seen in two.

        It goes by the draws of a scene, so that each scene has the shares; by all draws, a round of 8 or 13 of them
        would give every scene nearly the same place again and again. In a grid, where draws come again, it goes by the
        combination, in another order: an argument of 8 or 13 values would have each nearly in one split alone.
        """
        of = self.scenes[scene].combinations if self.sampling == "grid" else 1
        at = turn(n + scene, 0.0)
        if of > 1:
            at = stratified(self.seed, (self.scenes[scene].name, "split"), n % of, min(of, STRATA))
        upto = 0.0
        for name, share in self.splits.items():
            upto += share
            if at < upto:
                return name
        return next(reversed(self.splits), "")
