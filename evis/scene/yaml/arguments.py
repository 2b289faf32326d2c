"""Reads the arguments that a scene file declares, and gives them values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from evis.config.document import Table
from evis.config.params import Param, ParamError, resolve
from evis.scene.draws import Draws
from evis.scene.yaml.drawing import has_draws, is_draw
from evis.scene.yaml.reader import Fields

MAX_PIXELS = 16384
"""Largest width and height of a camera [px]."""
FOLDER = "folder"
"""Type of an argument that names a folder of the user's; "" = none."""
_TYPES: dict[str, type] = {"float": float, "int": int, "str": str, "bool": bool, "vector": list, FOLDER: str}


def values_of(path: Path, table: Table, overrides: Mapping[str, Any], draws: Draws) -> dict[str, Any]:
    """Returns every argument's value: given ones over defaults, which may be drawn. Raises ParamError, SceneError."""
    declared, components = declared_in(path, table)
    values = resolve(f"scene {path.stem}", declared, overrides)
    for key, param in declared.items():
        if key not in overrides and (fields := _drawn_default(path, table, key, values, draws)) is not None:
            value = fields.raw("default", whole=param.type is int)
            values[key] = param.convert(f"scene {path.stem}, {fields.table.where('default')}", key, value)
        if key in components:
            values[key] = _vector(path.stem, key, values[key], *components[key])
    for key in folders_in(table):
        if values[key]:  # from where it was given: by the scene file, or by who asks for the scene
            home = Path() if key in overrides else path.parent
            values[key] = str((home / Path(values[key]).expanduser()).absolute())
    return values


def folders_in(table: Table) -> list[str]:
    """Names the arguments that are folders."""
    declared = table.get("args")
    entries = declared.items() if isinstance(declared, Table) else ()
    return [name for name, entry in entries if isinstance(entry, Table) and entry.get("type") == FOLDER]


def _drawn_default(path: Path, table: Table, key: str, before: Mapping[str, Any], draws: Draws) -> Fields | None:
    """Reads the entry of an argument whose default is drawn, where it may use the arguments `before` it; else None."""
    declared = table.get("args")
    entry = declared.get(key) if isinstance(declared, Table) else None
    default = entry.get("default") if isinstance(entry, Table) else None
    if not isinstance(entry, Table) or not (is_draw(default) or has_draws(default)):
        return None
    known = {}
    for name, value in before.items():
        if name == key:
            break
        known[name] = value
    return Fields(entry, f"scene {path.stem}, argument '{key}'", known, draws, f"args.{key}")


def stands_for(argument: str, place: str) -> bool:
    """Tells whether a place is that of an argument's default, or of an element of it."""
    return place.startswith(f"args.{argument}.default")


def declared_in(path: Path, table: Table) -> tuple[dict[str, Param], dict[str, tuple[int, Param]]]:
    """Reads the declared arguments, and of vectors how many components there are and what each must be."""
    declared = {
        "width": Param(int, 346, "image width", "px", 1, MAX_PIXELS),
        "height": Param(int, 260, "image height", "px", 1, MAX_PIXELS),
    }
    components: dict[str, tuple[int, Param]] = {}
    defaults: dict[str, Any] = {name: param.default for name, param in declared.items()}
    scene = Fields(table, f"scene {path.stem}", {})
    for name, fields in scene.sections("args", "argument").items():
        kind = fields.text("type", "float", choices=tuple(_TYPES))
        draws = Draws(0)
        drawn = _drawn_default(path, table, name, defaults, draws)
        default = (drawn or fields).raw("default", whole=kind == "int")
        fields.has("default")  # which `drawn` may have read
        help_text, unit = fields.text("help"), fields.text("unit", "")
        if draws.made:
            help_text += f"; {', '.join(one.law.words() for one in draws.made.values())} by the seed unless given"
        least, most = (fields.number(k) if fields.has(k) else None for k in ("min", "max"))
        owner = f"{path.stem}, {fields.table.where('default')}"
        if kind == "vector":
            component = Param(float, 0.0, help_text, unit, least, most)
            if not isinstance(default, list) or not default:
                raise fields.error("default", f"is {default!r}; it must be a list of numbers")
            _vector(owner, name, default, len(default), component)
            components[name] = len(default), component
            param = Param(list, list(default), help_text, unit)
        else:
            choices = fields.raw("choices", [])
            if not isinstance(choices, list):
                raise fields.error("choices", f"is {choices!r}; it must be a list of values")
            param = Param(_TYPES[kind], default, help_text, unit, least, most, tuple(choices))
            param.convert(f"scene {owner}", name, default)
        defaults[name] = default
        declared[name] = replace(param, default=None, optional=True) if draws.made else param
        fields.done()
    return declared, components


def _vector(owner: str, key: str, value: list[Any], size: int, component: Param) -> list[float]:
    """Numbers of a vector argument, each within its range."""
    if len(value) != size:
        example = ",".join(["0.1"] * size)
        raise ParamError(f"scene {owner}: {key} is {value!r}; it must be {size} numbers, such as {key}={example}")
    return [component.convert(f"scene {owner}", f"{key}[{i}]", v) for i, v in enumerate(value)]
