"""Reads recipes as people write them: YAML, with the file and the line of what is wrong."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evis.config import paths
from evis.config.document import LaunchError, Row, Table, read, submap
from evis.config.params import Param, ParamError
from evis.config.removed import instead
from evis.config.suggestions import nearest
from evis.dataset.draws import SAMPLINGS, SCALES, Axis
from evis.dataset.errors import DatasetError
from evis.dataset.layouts import LAYOUTS
from evis.dataset.recipe import Recipe, SceneDraws
from evis.dataset.recipe_sources import files_of, folders_of
from evis.files.regular import other_than_file
from evis.launch.target import Target, read_target, scene_arguments
from evis.simulation.output_names import NAMES

KEYS = {
    "description": Param(str, "", "one line for people"),
    "layout": Param(str, "npz", "how sequences are written", choices=tuple(LAYOUTS)),
    "sequences": Param(int, None, "how many", "", 1, 10_000_000, optional=True),
    "seed": Param(int, 0, "of the draws, and of all sequences", "", 0, 2**63 - 1),
    "seeds": Param(int, 1, "sequences of each draw of arguments", "", 1, 1_000_000),
    "sampling": Param(str, "random", "how arguments are drawn", choices=SAMPLINGS),
    "outputs": Param(list, ["events"], "of the simulation"),
    "labels": Param(list, [], "kinds of labels"),
}
"""Plain keys of a recipe; those with a form of their own are OTHERS."""
OTHERS = ("duration", "splits", "arguments", "scenes")
OWN = {
    "seed": "`seed:` of the recipe decides",
    "labels": "`labels:` stands at the top of the recipe",
    "scene": "scenes stand under `scenes:`",
    "scene_args": "the scene's arguments stand here by their names",
    "envs": "a sequence is one environment",
    "pace": "nothing waits for the clock here",
}
"""Arguments of launch files that a recipe gives itself."""
MEASURED = {"interpolator": "none, splat or rigid", "upsampling": "a number"}
"""Arguments that may be auto, and what stands in its place where a sequence must be the same on all machines."""
LONGEST = 1e6
"""Longest sequence [s]."""


class UnknownRecipe(DatasetError):
    """Says that what was named is no recipe."""


def find_recipe(name: str) -> Path:
    """Finds a recipe by path or by the name of one that comes with evis. Raises DatasetError, of a name that there is
    not UnknownRecipe."""
    if (path := paths.find("recipes", name)) is not None:
        return path
    if what := other_than_file(name):
        raise DatasetError(f"{name}: it is {what}, and a recipe must be a file")
    raise UnknownRecipe(f"there is no recipe {name}; {nearest(Path(name).stem, paths.names('recipes'))}")


def read_recipe(name: str | Path, duration_s: float | None = None) -> Recipe:
    """Reads a recipe, and checks each argument by what its scene declares.

    Args:
        name: a path, or the name of a recipe that comes with evis.
        duration_s: of every sequence, in place of what the recipe says.

    Raises DatasetError, LaunchError with file:line.
    """
    path = find_recipe(str(name))
    table = read(path, "recipe")
    table.check_keys([*KEYS, *OTHERS], "a recipe")
    values = {key: _converted(param, table, key) if key in table else param.default for key, param in KEYS.items()}
    for at, output in enumerate(values["outputs"]):
        if str(output).rpartition(".")[2] not in NAMES:
            raise LaunchError(
                f"{_line(table, 'outputs', at)}: there is no output '{output}'; {nearest(str(output), NAMES)}"
            )
    if not values["outputs"] and not values["labels"]:
        raise LaunchError(f"{table.where('outputs')}: sequences without outputs and labels would be empty; name one")
    if duration_s is not None:
        if not 0 < duration_s <= LONGEST:
            raise DatasetError(f"the duration is {duration_s:g} s; it must be longer than 0 and at most {LONGEST:g} s")
        table["duration"] = float(duration_s)
    seconds = Param(float, 1.0, "length of a sequence", "s", 1e-3, LONGEST)
    duration = _axis(table, "duration", seconds, "random") if "duration" in table else Axis("duration", (1.0,))
    if not isinstance(duration, Axis):
        duration = Axis("duration", (duration,))
    scenes = tuple(_scenes(table, path, values["sampling"]))
    count = values["sequences"]
    if count is None:
        rounds = max(math.ceil(s.combinations / s.weight) for s in scenes) if values["sampling"] == "grid" else 0
        count = rounds * sum(s.weight for s in scenes) * values["seeds"]
    if not count:
        raise LaunchError(f"{table.where()}: the recipe does not say how many `sequences:` there are")
    return Recipe(
        name=path.stem,
        description=values["description"],
        layout=values["layout"],
        count=count,
        duration=duration,
        seed=values["seed"],
        seeds=values["seeds"],
        sampling=values["sampling"],
        splits=_splits(table),
        outputs=tuple(map(str, values["outputs"])),
        labels=tuple(map(str, values["labels"])),
        scenes=scenes,
        text={**_plain(table), "sequences": count},
        files=files_of(scenes),
    )


def _scenes(table: Table, path: Path, sampling: str) -> list[SceneDraws]:
    scenes = submap(table, "scenes")
    if not scenes:
        raise LaunchError(f"{table.where('scenes')}: a recipe names at least one scene under `scenes:`")
    shared = submap(table, "arguments")
    found = []
    for name in scenes:
        entry = submap(scenes, name)
        entry.check_keys(("weight", "arguments"), f"scene '{name}' of a recipe")
        weight = _converted(Param(int, 1, "", "", 1, 1000), entry, "weight") if "weight" in entry else 1
        target = name
        if (beside := path.parent / name).suffix.lower() in (".yaml", ".yml", ".xml", ".urdf") and beside.is_file():
            target = os.path.abspath(beside)
        try:
            graph = read_target(target)
            known = _known(graph)
        except (ValueError, OSError) as error:
            raise LaunchError(f"{scenes.where(name)}: {error}") from None
        constants: dict[str, Any] = {}
        axes: dict[str, Axis] = {}
        for part in (shared, submap(entry, "arguments")):
            for key in part:
                param = _declared(part, key, known, name, graph)
                value = _axis(part, key, param, sampling)
                constants.pop(key, None), axes.pop(key, None)
                if isinstance(value, Axis):
                    axes[key] = value
                else:
                    constants[key] = value
        for key in MEASURED:
            where = next((p for p in (submap(entry, "arguments"), shared) if key in p), None)
            _repeatable(key, where.where(key) if where else scenes.where(name), graph, constants, axes)
        home, folders = os.path.abspath(path.parent), tuple(folders_of(graph))
        found.append(SceneDraws(target, weight, constants, tuple(axes.values()), scenes.where(name), home, folders))
    stems = [scene.name for scene in found]
    if twice := next((stem for stem in stems if stems.count(stem) > 1), None):
        raise LaunchError(f"{scenes.where()}: two scenes are called {twice}; their sequences would have the same names")
    return found


def _known(graph: Target) -> dict[str, Param]:
    """What may be said of a scene: the arguments of its launch file and its own."""
    of_launch = {name: argument.param for name, argument in graph.launch.arguments.items()}
    return {**scene_arguments(graph.launch, graph.preset), **of_launch}


def _declared(part: Table, key: str, known: Mapping[str, Param], scene: str, graph: Target) -> Param:
    if key in OWN and key in known:
        raise LaunchError(f"{part.where(key)}: '{key}' is no argument of a recipe's scene: {OWN[key]}")
    if key not in known:
        file = graph.launch.path.name
        hint = instead(key, [name for name in known if name not in OWN])
        raise LaunchError(f"{part.where(key)}: neither scene {scene} nor {file} has '{key}'; {hint}")
    if known[key].secret:
        raise LaunchError(f"{part.where(key)}: '{key}' is a secret, which a data set does not keep")
    return known[key]


def _repeatable(key: str, where: str, graph: Target, constants: Mapping[str, Any], axes: Mapping[str, Axis]) -> None:
    """Raises LaunchError where a sequence would depend on the machine that makes it. where: of the argument `key`."""
    default = graph.launch.arguments[key].param.default if key in graph.launch.arguments else ""
    if "auto" in (axes[key].choices if key in axes else (constants.get(key, default),)):
        raise LaunchError(
            f"{where}: {key}: auto chooses by how fast this machine is, and a sequence must be the same on all; "
            f"write what `evis launch SCENE {key}:=auto --explain` chooses: {MEASURED[key]}"
        )


def _axis(table: Table, key: str, param: Param, sampling: str) -> Any:
    """The values that an argument takes: an Axis, or a constant as it is."""
    value = table[key]
    if not isinstance(value, Table):
        return _plain(_checked(param, table, key, value))
    value.check_keys(("choices", "from", "to", "steps", "scale"), f"'{key}'")
    if "choices" in value:
        value.check_keys(("choices",), f"'{key}' with choices")
        choices = value["choices"]
        if not isinstance(choices, Row) or not choices:
            raise LaunchError(f"{value.where('choices')}: choices of '{key}' must be a list of at least one value")
        found = Axis(key, tuple(_plain(_checked(param, value, "choices", choice, key)) for choice in choices))
        return _distinct(found, value.where("choices"), sampling)
    if "from" not in value or "to" not in value:
        raise LaunchError(f"{table.where(key)}: '{key}' needs `from:` and `to:`, or `choices:`")
    if param.type in (str, bool):
        raise LaunchError(f"{table.where(key)}: '{key}' is no number and has no range; give `choices:`")
    scale = value.get("scale", "linear")
    if scale not in SCALES:
        raise LaunchError(f"{value.where('scale')}: no scale '{scale}'; {nearest(str(scale), SCALES)}")
    low, high = (_ends(value, end, param, key) for end in ("from", "to"))
    if len(low) != len(high):
        raise LaunchError(f"{value.where('to')}: '{key}' has {len(low)} numbers in `from:` and {len(high)} in `to:`")
    if wrong := next(((a, b) for a, b in zip(low, high) if not a <= b), None):
        raise LaunchError(f"{value.where('to')}: the range of '{key}' is empty: from {wrong[0]:g} to {wrong[1]:g}")
    if scale == "log" and min(low) <= 0:
        raise LaunchError(f"{value.where('from')}: '{key}' has the scale log, so its range must be above 0")
    steps = _converted(Param(int, 0, "", "", 1, 1_000_000), value, "steps", key) if "steps" in value else 0
    if sampling == "grid" and not steps and key != "duration":
        raise LaunchError(f"{table.where(key)}: a grid needs `steps:` of the range of '{key}'")
    if key == "duration" and steps:
        raise LaunchError(f"{value.where('steps')}: a duration is drawn from its range, in a grid too; leave steps out")
    if sampling != "grid" and steps:
        raise LaunchError(f"{value.where('steps')}: steps of '{key}' are for `sampling: grid`; this is {sampling}")
    found = Axis(key, (), low, high, param.type is int, param.type is list, scale == "log", steps)
    return _distinct(found, value.where("steps") if steps else "", sampling)


def _distinct(axis: Axis, where: str, sampling: str) -> Axis:
    """Raises LaunchError where a grid would have a combination more than once. where: file:line."""
    if sampling == "grid" and (axis.choices or axis.steps) and (value := axis.twice()) is not None:
        raise LaunchError(f"{where}: the grid has the value {value!r} of '{axis.name}' more than once; give each once")
    return axis


def _ends(value: Table, end: str, param: Param, key: str) -> tuple[float, ...]:
    """One end of a range: a number, or of a list of numbers one for each."""
    found = value[end]
    _checked(param, value, end, found, key)
    if (param.type is list) != isinstance(found, Row):
        what = "a list of numbers" if param.type is list else "one number"
        raise LaunchError(f"{value.where(end)}: `{end}:` of '{key}' must be {what}")
    number = Param(float, 0.0, "")
    numbers = found if isinstance(found, Row) else [found]
    return tuple(float(_checked(number, value, end, one, key)) for one in numbers)


def _splits(table: Table) -> dict[str, float]:
    splits = submap(table, "splits")
    shares: dict[str, float] = {}
    for name in splits:
        if not name.replace("-", "_").isidentifier():
            raise LaunchError(f"{splits.where(name)}: '{name}' cannot be the name of a split, which is a folder")
        if alike := next((other for other in shares if other.casefold() == name.casefold()), None):
            raise LaunchError(
                f"{splits.where(name)}: the splits {alike} and {name} are one folder where file names know no case; "
                "give them different names"
            )
        shares[name] = _converted(Param(float, 0.0, "", "", 0.0, 1.0), splits, name)
    if shares and abs(sum(shares.values()) - 1) > 1e-6:
        raise LaunchError(f"{table.where('splits')}: the splits are {sum(shares.values()):g} in all; they must be 1")
    return shares


def _converted(param: Param, table: Table, key: str, owner: str = "") -> Any:
    return _checked(param, table, key, table[key], owner)


def _checked(param: Param, table: Table, key: str, value: Any, owner: str = "") -> Any:
    """A value of the parameter's type and within its range. Raises LaunchError with file:line."""
    if value is None and not param.optional:
        raise LaunchError(f"{table.where(key)}: '{key}' has no value")
    try:
        return dataclasses.replace(param, secret=False).convert("recipe", owner or key, value)
    except ParamError as error:
        raise LaunchError(f"{table.where(key)}: {str(error).removeprefix('recipe: ')}") from None


def _line(table: Table, key: str, at: int) -> str:
    value = table[key]
    return f"{table.file}:{value.lines[at]}" if isinstance(value, Row) else table.where(key)


def _plain(value: Any) -> Any:
    """A value of a document without where it stood, as JSON has it."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    return [_plain(part) for part in value] if isinstance(value, (list, tuple)) else value
