"""The worlds of parallel environments: each drawn by its seed, one Scene for all that have drawn the same."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.scene.draws import Drawn, uniform, would_draw
from evis.scene.load import find_scene, load_scene, source_files
from evis.scene.model import Scene

Group = tuple[Scene, np.ndarray]
"""A scene and the environments that have it, int64 ascending."""


@dataclass
class _Family:
    """Holds the worlds of one scene with one set of arguments that somebody has in use."""

    first: Drawn | None = None
    """What every world of the family draws first, for nothing that is drawn decides whether it is."""
    worlds: dict[Any, list[weakref.ref[Scene]]] = field(default_factory=dict)
    """By the value of that."""
    made: dict[Any, Any] = field(default_factory=dict)


_families: dict[Hashable, _Family] = {}


def load_world(name_or_path: str, overrides: Mapping[str, Any], seed: int = 0, *, visuals: bool = True) -> Scene:
    """Loads the world of a seed as `load_scene` does, or gives one that is in use already and has drawn the same.

    It is shared, so it must not be written to. Raises as load_scene does.
    """
    path = find_scene(name_or_path)
    files = tuple((file, file.stat().st_mtime_ns) for file in source_files(path))
    key = files, tuple(sorted((k, str(v)) for k, v in overrides.items())), visuals
    for other in [k for k, family in _families.items() if k != key and not _alive(family)]:
        del _families[other]
    family = _families.setdefault(key, _Family())
    for reference in family.worlds.get(_first_value(family, seed), []):
        scene = reference()
        if scene is not None and would_draw(scene.drawn, seed):
            return scene
    scene = load_scene(name_or_path, overrides, visuals=visuals, seed=seed, made=family.made)
    family.first = scene.drawn[0] if scene.drawn else None
    family.worlds.setdefault(_first_value(family, seed), []).append(weakref.ref(scene))
    return scene


def _alive(family: _Family) -> bool:
    return any(reference() is not None for worlds in family.worlds.values() for reference in worlds)


def _first_value(family: _Family, seed: int) -> Any:
    if family.first is None:
        return None
    return repr(family.first.law.value(uniform(seed, family.first.place)))


class Worlds:
    """Holds the scene of each environment. Environment k has the world of `seeds[k]`."""

    def __init__(self, load: Callable[[int], Scene], seeds: Sequence[int]) -> None:
        """load: gives the world of a seed. Raises ValueError where worlds cannot be simulated side by side."""
        self._load = load
        self.seeds = list(seeds)
        self.scenes = [load(seed) for seed in self.seeds]
        for env in range(1, len(self.scenes)):
            self._check(env, self.scenes[env])

    @property
    def alike(self) -> bool:
        """True where all environments have one world."""
        return all(scene is self.scenes[0] for scene in self.scenes)

    def with_seeds(self, envs: Sequence[int], seeds: Sequence[int]) -> Worlds:
        """Returns these worlds with those of some environments drawn anew. Raises ValueError as the first time."""
        fresh = list(self.seeds)
        for env, seed in zip(envs, seeds):
            fresh[env] = seed
        return Worlds(self._load, fresh)

    def groups(self, key: Callable[[Scene], Hashable]) -> list[Group]:
        """Finds the environments, int64 [G] ascending, whose scenes have the same key, with the first one's scene."""
        if self.alike:
            return [(self.scenes[0], np.arange(len(self.scenes)))]
        keys: dict[int, Hashable] = {}
        found: dict[Hashable, list[int]] = {}
        for env, scene in enumerate(self.scenes):
            if id(scene) not in keys:
                keys[id(scene)] = key(scene)
            found.setdefault(keys[id(scene)], []).append(env)
        return [(self.scenes[envs[0]], np.array(envs)) for envs in found.values()]

    def apart(self, envs: np.ndarray | None = None) -> list[Scene]:
        """Returns the scenes of some environments, all for None; none where one will do for all."""
        chosen = [self.scenes[env] for env in (range(len(self.scenes)) if envs is None else envs)]
        return [] if all(scene is chosen[0] for scene in chosen) else chosen

    def drawn(self) -> dict[str, list[Any]]:
        """Tells what was drawn: name of the place -> a value for each environment, None where it draws none there."""
        tables = [{one.place: _shown(one) for one in scene.drawn} for scene in self.scenes]
        places = dict.fromkeys(place for table in tables for place in table)
        return {place: [table.get(place) for table in tables] for place in places}

    def _check(self, env: int, scene: Scene) -> None:
        first = self.scenes[0]
        if scene is first:
            return
        for what, mine, other in (
            ("bodies", _bodies(first), _bodies(scene)),
            ("instances", [i.name for i in first.instances], [i.name for i in scene.instances]),
            ("cameras", [_camera(c) for c in first.cameras], [_camera(c) for c in scene.cameras]),
            ("timestep", [str(first.timestep_ns)], [str(scene.timestep_ns)]),
        ):
            if mine != other:
                lacks = next((f"'{name}'" for name in mine if name not in other), "what environment 0 has")
                extra = next((f", but has '{name}'" for name in other if name not in mine), "")
                raise ValueError(
                    f"scene {first.name}: environment {env}, of seed {self.seeds[env]}, lacks {lacks} of the {what} of "
                    f"environment 0{extra}; worlds side by side may differ in values but not in what there is: draw "
                    "other things, or run one environment at a time"
                )


def _bodies(scene: Scene) -> list[str]:
    return [body.name for body in scene.bodies]


def _camera(camera: Any) -> str:
    lens = f", {camera.distortion_model} with {len(camera.distortion)} coefficients" if camera.distortion else ""
    return f"{camera.name} of {camera.width}x{camera.height} px, {camera.supersampling} samples, {camera.rate}{lens}"


def _shown(one: Drawn) -> Any:
    return f"{one.value!r} {one.unit}" if one.unit else one.value
