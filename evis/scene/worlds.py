"""Holds the worlds of parallel environments: each drawn by its seed, one Scene for all that have drawn the same.

Nodes of a process share them, so that none is loaded twice while its files stay as they are.
"""

from __future__ import annotations

import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene.draws import Drawn, uniform, would_draw
from evis.scene.load import find_scene, load_scene
from evis.scene.model import Scene
from evis.scene.sources import Stamp, noting, unchanged
from msgs.own_time import CONFIGURED, SEED

Group = tuple[Scene, np.ndarray]
"""A scene and the environments that have it, int64 ascending."""

FAMILIES = 4
"""Scenes, each with one set of arguments, that are kept when nobody uses them any more, the last ones."""
WORLDS = 16
"""Worlds of each of these that are kept then: those of the last seeds."""
SHARING = 256
"""Worlds that share meshes and textures at most; what is made for more of them would be too much to keep."""
MUCH = 1 << 27
"""Bytes of meshes and textures, beside twice those of one world, that are too much to keep for fewer, too."""


class Family:
    """Holds the worlds of one scene with one set of arguments."""

    def __init__(self, name_or_path: str, overrides: Mapping[str, Any], visuals: bool, textures: bool) -> None:
        """The arguments are those of `load_scene`."""
        self._load = name_or_path, dict(overrides)
        self._how: dict[str, Any] = {"visuals": visuals, "textures": textures}
        self.files: dict[Path, Stamp] = {}
        """What its worlds were read from."""
        self._first: Drawn | None = None
        """What every world of the family draws first, for nothing that is drawn decides whether it is."""
        self._worlds: dict[Any, list[weakref.ref[Scene]]] = {}
        """By the value of that."""
        self._last: deque[Scene] = deque(maxlen=WORLDS)
        self._made: dict[Any, Any] = {}
        self._of_one = 0
        """Bytes that were made for the first of the worlds that share them."""
        self._loaded = 0

    def world(self, seed: int) -> Scene:
        """Gives the world of a seed, one that there is already where that has drawn the same. Raises as load_scene."""
        known = self._worlds.get(self._value(seed), [])
        for scene in [scene for reference in known if (scene := reference()) is not None]:
            if would_draw(scene.drawn, seed):
                return scene
        if self._made_too_much():
            self._made = {}
        first = not self._made
        self._loaded += 1
        name, overrides = self._load
        with noting() as files:
            scene = load_scene(name, overrides, seed=seed, made=self._made, **self._how)
        if first:
            self._of_one = size_of(self._made)
        self.files.update(files)
        lock(scene)
        scene.shared = True
        self._first = scene.drawn[0] if scene.drawn else None
        self._last.append(scene)
        same = [reference for reference in self._worlds.get(self._value(seed), []) if reference() is not None]
        self._worlds[self._value(seed)] = [*same, weakref.ref(scene)]
        if self._loaded % WORLDS == 0:
            self._worlds = {value: some for value, some in self._worlds.items() if any(r() is not None for r in some)}
        return scene

    @property
    def for_the_blind(self) -> bool:
        """Tells whether it has a world that will do for who needs nothing that is seen, whatever the seed.

        Worlds that differ to the eye alone are one to these; and of a model it is told what cannot be shown.
        """
        return any(scene.mjcf is None and not scene.drawn for scene in self._last)

    def _made_too_much(self) -> bool:
        """Tells whether the next world is to make its own: each may have drawn pictures that no other has."""
        if self._loaded % SHARING == 0:
            return True
        return self._loaded % WORLDS == 0 and size_of(self._made) > MUCH + 2 * self._of_one

    def _value(self, seed: int) -> Any:
        return None if self._first is None else repr(self._first.law.value(uniform(seed, self._first.place)))


_families: OrderedDict[Hashable, Family] = OrderedDict()
_used: weakref.WeakValueDictionary[Hashable, Family] = weakref.WeakValueDictionary()
"""All that somebody uses, however many."""


def family(name_or_path: str, overrides: Mapping[str, Any], *, visuals: bool = True, textures: bool = True) -> Family:
    """Gives the worlds of a scene with these arguments, those of `load_scene`, as its files are now.

    Who needs no textures may be given worlds with them, and who needs nothing that is seen those with it. They are
    shared and nobody may write to them: their arrays are read-only. Raises FileNotFoundError.
    """
    arguments = tuple(sorted((key, type(value).__name__, str(value)) for key, value in overrides.items()))
    scene = str(find_scene(name_or_path).absolute()), arguments
    seen = [(*scene, True, True), *([] if visuals and textures else [(*scene, True, False)])]
    there = [k for k in seen if k in _used and (visuals or _used[k].for_the_blind)]
    key = there[0] if there else (*scene, visuals, visuals and textures)
    known = _used.get(key)
    if known is None or not unchanged(known.files):
        known = _used[key] = Family(name_or_path, overrides, key[-2], key[-1])
    _families[key] = known
    _families.move_to_end(key)
    while len(_families) > FAMILIES:
        _families.popitem(last=False)
    return known


def lock(part: Any) -> None:
    """Makes all arrays of a scene, or of a part of one, read-only."""
    if isinstance(part, np.ndarray):
        part.flags.writeable = False
    elif isinstance(part, (list, tuple)):
        for each in part:
            lock(each)
    elif is_dataclass(part) and not isinstance(part, type):
        for each in fields(part):
            lock(getattr(part, each.name))


def size_of(part: Any) -> int:
    """Counts the bytes of the arrays of a part of a scene, or of several in dicts and lists, each once."""
    return sum(array.nbytes for array in {id(array): array for array in _arrays(part)}.values())


def _arrays(part: Any) -> Iterator[np.ndarray]:
    if isinstance(part, np.ndarray):
        yield part
    elif isinstance(part, (list, tuple)):
        for each in part:
            yield from _arrays(each)
    elif isinstance(part, dict):
        for each in part.values():
            yield from _arrays(each)
    elif is_dataclass(part) and not isinstance(part, type):
        for each in fields(part):
            yield from _arrays(getattr(part, each.name))


class Worlds:
    """Holds the scene of each environment. Environment k has the world of `seeds[k]`."""

    def __init__(self, load: Callable[[int, int], Scene], seeds: Sequence[int]) -> None:
        """load: gives the world of an environment and a seed. Raises ValueError where worlds cannot be simulated side
        by side."""
        self._load = load
        self.seeds = list(seeds)
        self._configured = self.seeds
        """Those of environments that were not given another one at a reset."""
        self._keys: dict[Any, dict[int, Hashable]] = {}
        """Keys of scenes that were computed, by number of the scene."""
        self.scenes = [load(env, seed) for env, seed in enumerate(self.seeds)]
        for env in range(1, len(self.scenes)):
            self._check(env, self.scenes[env])

    @property
    def alike(self) -> bool:
        """Tells whether all environments have one world."""
        return all(scene is self.scenes[0] for scene in self.scenes)

    def with_seeds(self, envs: Sequence[int], seeds: Sequence[int]) -> Worlds:
        """Returns these worlds with those of some environments drawn anew, CONFIGURED = by the seed that the run gave
        it. Raises ValueError as the first time.
        """
        wanted = list(self.seeds)
        for env, seed in zip(envs, seeds):
            wanted[env] = self._configured[env] if seed == CONFIGURED else seed
        return self._of(wanted, self._configured)

    def follow(self, own: np.ndarray | None) -> Worlds:
        """Returns the worlds of a message with these rows of msgs.own_time; itself where it has all of them."""
        if own is None:
            return self._of(self._configured, self._configured)
        given = zip(own[:, SEED].tolist(), self._configured)
        return self._of([other if seed == CONFIGURED else seed for seed, other in given], self._configured)

    def from_seeds(self, seeds: Sequence[int]) -> Worlds:
        """Returns the worlds of a run with other seeds, one for each environment."""
        return self._of(list(seeds), list(seeds))

    def _of(self, seeds: list[int], configured: list[int]) -> Worlds:
        if seeds == self.seeds and configured == self._configured:
            return self
        worlds = object.__new__(Worlds)
        worlds._load, worlds.seeds, worlds._configured = self._load, seeds, configured
        worlds.scenes = list(self.scenes)
        for env, (new, old) in enumerate(zip(seeds, self.seeds)):
            if new != old:
                worlds.scenes[env] = self._load(env, new)
                worlds._check(env, worlds.scenes[env])
        if worlds.scenes[0] is not self.scenes[0]:
            worlds._check_after(self.scenes[0])
            for env, scene in enumerate(worlds.scenes):
                worlds._check(env, scene)
        kept = set(map(id, worlds.scenes))
        worlds._keys = {
            key: {number: value for number, value in known.items() if number in kept}
            for key, known in self._keys.items()
        }
        return worlds

    def changed(self, before: Worlds, key: Callable[[Scene], Hashable]) -> np.ndarray:
        """Finds the environments, int64 [n], whose scenes have another key than they had before."""
        pairs = enumerate(zip(self.scenes, before.scenes))
        other = [e for e, (new, old) in pairs if new is not old and self._key(key, new) != before._key(key, old)]
        return np.array(other, np.int64)

    def groups(self, key: Callable[[Scene], Hashable], envs: np.ndarray | None = None) -> list[Group]:
        """Finds the environments, int64 [G] ascending, whose scenes have the same key, with the first one's scene.

        envs: int64 [n] ascending, of these alone; None = of all.
        """
        if envs is None and self.alike:
            return [(self.scenes[0], np.arange(len(self.scenes)))]
        found: dict[Hashable, list[int]] = {}
        for env in range(len(self.scenes)) if envs is None else envs.tolist():
            found.setdefault(self._key(key, self.scenes[env]), []).append(env)
        return [(self.scenes[members[0]], np.array(members)) for members in found.values()]

    def _key(self, key: Callable[[Scene], Hashable], scene: Scene) -> Hashable:
        known = self._keys.setdefault(key, {})
        if id(scene) not in known:
            known[id(scene)] = key(scene)
        return known[id(scene)]

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
        """Raises ValueError where an environment has other things than environment 0."""
        first = self.scenes[0]
        if scene is first:
            return
        mine, other = ({**things_of(s), "instances": [i.name for i in s.instances]} for s in (first, scene))
        for what, names in mine.items():
            if names != other[what]:
                raise ValueError(
                    f"scene {first.name}: the {what} of environment {env}, of seed {self.seeds[env]}, are not those of "
                    f"environment 0: {_difference(names, other[what])}; worlds side by side may differ in values but "
                    "not in what there is: draw other things, or run one environment at a time"
                )

    def _check_after(self, before: Scene) -> None:
        """Raises ValueError where environment 0 has other things than in a world before, whose nodes go on."""
        other = things_of(self.scenes[0])
        for what, names in things_of(before).items():
            if names != other[what]:
                raise ValueError(
                    f"scene {before.name}: the {what} of seed {self.seeds[0]} are not those that the run has: "
                    f"{_difference(names, other[what])}; a run keeps what there is: begin another one with this seed"
                )


def things_of(scene: Scene) -> dict[str, list[str]]:
    """Lists what nodes are made for, by kind: they go on in another world that has the same."""
    return {
        "bodies": [body.name for body in scene.bodies],
        "cameras": [_camera(camera) for camera in scene.cameras],
        "time steps": [str(scene.timestep_ns)],
    }


def _difference(first: Sequence[str], other: Sequence[str]) -> str:
    lacks = next((f"it lacks '{name}'" for name in first if name not in other), "")
    extra = next((f"it has '{name}'" for name in other if name not in first), "")
    return " and ".join(filter(None, (lacks, extra))) or "they are in another order"


def _camera(camera: Any) -> str:
    lens = f", {camera.distortion_model} with {len(camera.distortion)} coefficients" if camera.distortion else ""
    return f"{camera.name} of {camera.width}x{camera.height} px, {camera.supersampling} samples, {camera.rate}{lens}"


def _shown(one: Drawn) -> Any:
    return f"{one.value!r} {one.unit}" if one.unit else one.value
