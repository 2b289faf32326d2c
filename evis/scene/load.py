"""Loads a Scene by the name or file of a scene: finding it, its arguments, and what it is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from evis.config.document import LaunchError, Row, Table, read
from evis.config.params import Param, ParamError, resolve
from evis.config.paths import find, names
from evis.config.suggestions import nearest
from evis.files.regular import other_than_file
from evis.scene.draws import Draws
from evis.scene.errors import SceneError
from evis.scene.model import MODELS, Scene
from evis.scene.sources import note
from evis.scene.yaml.drawing import drawn_within, has_draws, is_draw
from evis.scene.yaml.reader import Fields

MAX_PIXELS = 16384
"""Largest width and height of a camera [px]."""
_SECTIONS = ("materials", "world", "bodies", "lights")
"""What an included file adds to the scene's own; of the rest, the scene's own counts."""
FOLDER = "folder"
"""Type of an argument that names a folder of the user's; "" = none."""
_TYPES: dict[str, type] = {"float": float, "int": int, "str": str, "bool": bool, "vector": list, FOLDER: str}


def load_scene(
    name_or_path: str,
    overrides: Mapping[str, Any] | None = None,
    *,
    textures: bool = True,
    visuals: bool = True,
    seed: int = 0,
    made: dict[Any, Any] | None = None,
) -> Scene:
    """Loads a scene with its arguments at their defaults or as in `overrides` (width, height, and the scene's own).

    name_or_path: a scene that comes with evis, a YAML file, or an MJCF (.xml) or URDF (.urdf) file by itself.
    seed: decides what the file leaves to chance; environment k of a run has the world of the run's seed + k.
    made: meshes and textures of other worlds, which this one shares where it has the same.
    textures=False: no texture is made. visuals=False: for those who need only bodies and cameras, nothing that is
    seen is made: no instances, materials, lights or sky. Raises SceneError or ParamError (both ValueError), or
    FileNotFoundError, each with one line that names the file, the key and the nearest valid one.
    """
    from evis.scene.yaml.build import build

    path = find_scene(name_or_path)
    table, draws = _document(path), Draws(seed)
    values = _values(path, table, overrides or {}, draws)
    return build(table, path, values, textures and visuals, visuals, draws, made)


def scene_values(name_or_path: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Returns every argument of a scene with its value, given ones over defaults, None for one that is drawn. Raises
    ParamError, SceneError, FileNotFoundError as `load_scene`.
    """
    path, draws = find_scene(name_or_path), Draws(0)
    values = _values(path, _document(path), overrides, draws)
    return {key: None if any(_stands_for(key, place) for place in draws.made) else v for key, v in values.items()}


def _values(path: Path, table: Table, overrides: Mapping[str, Any], draws: Draws) -> dict[str, Any]:
    """Every argument's value: given ones over defaults, which may be drawn."""
    declared, components = _arguments(path, table)
    values = resolve(f"scene {path.stem}", declared, overrides)
    for key, param in declared.items():
        if key not in overrides and (fields := _drawn_default(path, table, key, values, draws)) is not None:
            value = fields.raw("default", whole=param.type is int)
            values[key] = param.convert(f"scene {path.stem}, {fields.table.where('default')}", key, value)
        if key in components:
            values[key] = _vector(path.stem, key, values[key], *components[key])
    for key in _folders(table):
        if values[key]:  # from where it was given: by the scene file, or by who asks for the scene
            home = Path() if key in overrides else path.parent
            values[key] = str((home / Path(values[key]).expanduser()).absolute())
    return values


def _folders(table: Table) -> list[str]:
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


def _stands_for(argument: str, place: str) -> bool:
    """Whether a place is that of an argument's default, or of an element of it."""
    return place.startswith(f"args.{argument}.default")


def scene_args(name_or_path: str) -> dict[str, Param]:
    """Returns the arguments of a scene, name -> typed parameter; width and height are always among them."""
    path = find_scene(name_or_path)
    return _arguments(path, _document(path))[0]


def folder_args(name_or_path: str) -> list[str]:
    """Names the arguments of a scene that are folders, of pictures or meshes. Reads the YAML only."""
    return _folders(_document(find_scene(name_or_path)))


def is_dynamic(name_or_path: str) -> bool:
    """Returns True when the scene needs a physics engine. Reads the YAML only, not the model it names."""
    path = find_scene(name_or_path)
    return "mjcf" in _document(path)


def may_be_driven(name_or_path: str) -> bool:
    """Returns False when the scene has no actuators, as far as its YAML and the text of the model it names tell."""
    from evis.scene.mjcf.actuated import may_be_driven as driven

    path = find_scene(name_or_path)
    document = _document(path)
    model = document.get("mjcf")
    return model is not None and ("actuators" in document or driven(path.parent / str(model)))


def sets_sensor(name_or_path: str) -> bool:
    """Returns True when the scene has parameters of the event sensor. Reads the YAML only, as `is_dynamic` does."""
    return "sensor" in _document(find_scene(name_or_path))


def starts_at_random(name_or_path: str) -> tuple[str, ...]:
    """Names those of which the seed decides the start: free bodies, joints by name. Reads the YAML only."""
    document = _document(find_scene(name_or_path))
    spread, joints = document.get("initial_spread"), document.get("initial_joints")
    starts = joints.items() if isinstance(joints, Table) else ()
    drawn = [name for name, start in starts if any(isinstance(value, list) for value in _entries(start))]
    free = any(str(value).split()[:1] not in (["0"], ["0.0"]) for value in _entries(spread))
    return (*(("free bodies",) if free else ()), *(f"joint {name}" for name in drawn))


def _entries(value: Any) -> list[Any]:
    """Lists the values of a map; of what is no map, which only loading refuses, there are none."""
    return list(value.values()) if isinstance(value, Table) else []


def drawn_places(name_or_path: str, overrides: Mapping[str, Any]) -> list[str]:
    """Lists the places of a scene file whose values the seed decides, with these arguments. Reads the YAML only.

    An argument that is given is not drawn. Raises as `scene_values` does.
    """
    document, values = _document(find_scene(name_or_path)), scene_values(name_or_path, overrides)
    found = drawn_within(document, values)
    given = [f"args.{name}.default" for name in overrides]
    return [place.removesuffix(".default") for place in found if place.partition("[")[0] not in given]


def camera_rates(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> dict[str, float]:
    """Returns the keyframes per second [Hz] of the cameras that have a rate of their own. Raises as load_scene does.

    A scene where no camera has one is not loaded for it.
    """
    cameras = _document(find_scene(name_or_path)).get("cameras")
    if not any(isinstance(entry, Table) and "rate" in entry for entry in _entries(cameras)):
        return {}
    found = load_scene(name_or_path, overrides, visuals=False).cameras
    return {camera.name: camera.rate for camera in found if camera.rate is not None}


def camera_names(name_or_path: str) -> list[str] | None:
    """Names the cameras of a scene file without a model, as they are found, in its order; None where only loading
    tells."""
    path = find_scene(name_or_path)
    document = None if path.suffix in MODELS else _document(path)
    cameras = document.get("cameras") if document and "mjcf" not in document else None
    if not isinstance(cameras, Table) or not cameras:
        return None
    return list(cameras) if len(cameras) > 1 else ["cam0"]


def find_scene(name_or_path: str) -> Path:
    """Finds the file of a scene by name or path. Raises FileNotFoundError naming the nearest one."""
    direct = Path(name_or_path)
    if direct.suffix in MODELS and direct.is_file():
        return direct
    path = find("scenes", name_or_path)
    if path is None:
        if what := other_than_file(name_or_path):
            raise FileNotFoundError(f"{name_or_path}: it is {what}, and a scene must be a file")
        known = names("scenes")
        raise FileNotFoundError(f"no scene '{name_or_path}'; {nearest(direct.stem, known)}")
    return path


def _document(path: Path) -> Table:
    if path.suffix in MODELS:
        return _bare(note(path))
    try:
        table = _read(path)
    except LaunchError as error:
        raise SceneError(str(error)) from None
    included = table.get("include")
    if included is None:
        return table
    other = path.parent / str(included)
    if not isinstance(included, str) or not other.is_file():
        raise SceneError(f"{table.where('include')}: include names {included}, which is not in {path.parent}")
    part = read_part(other)
    for key, value in part.items():
        own = table.get(key)
        if own is None:
            table[key] = value
        elif key in _SECTIONS:
            table[key] = _merged(table, key, value, own)
        table.lines.setdefault(key, table.lines["include"])
    return table


def _bare(path: Path) -> Table:
    """The scene that a model is by itself; arguments are its further folders and, of an MJCF, where it starts."""
    table, arguments, assets = (Table(str(path), 1) for _ in range(3))
    table["mjcf"], table["args"], table["assets"] = path.name, arguments, "${assets}"
    assets.update(type="str", default="", help="folders beside its own from which it may read files, with commas")
    arguments["assets"] = assets
    if path.suffix == ".xml":
        start = Table(str(path), 1)
        start.update(type="str", default="auto", help="keyframe to start from: a name, a number, none, or auto: home")
        arguments["keyframe"], table["keyframe"] = start, "${keyframe}"
    return table


def _read(path: Path) -> Table:
    """The file's map, parsed once for as long as the file is as it was: planning asks for a scene many times."""
    stat = note(path).stat()
    parsed = _parsed(path, stat.st_mtime_ns, stat.st_size)
    table = Table(parsed.file, parsed.line)
    table.update(parsed)
    table.lines = dict(parsed.lines)
    return table


@lru_cache(maxsize=16)
def _parsed(path: Path, mtime_ns: int, size: int) -> Table:
    return read(path, "scene file")


def read_part(path: Path) -> Table:
    """Reads a file for `include:`, which holds what several scenes share. Raises SceneError."""
    try:
        table = _read(path)
        table.check_keys((*_SECTIONS, "description", "environment", "environment_map"), "an included scene file")
    except LaunchError as error:
        raise SceneError(str(error)) from None
    table.pop("description", None)
    return table


def _merged(table: Table, key: str, part: Any, own: Any) -> Any:
    """What is included first, then the scene's own; of a map, the scene's own entry where both have one."""
    if isinstance(part, Table) and isinstance(own, Table):
        result = Table(own.file, own.line)
        result.update({**part, **own})
        result.lines = {**part.lines, **own.lines}
        return result
    if isinstance(part, Row) and isinstance(own, Row):
        rows = Row(own.file, own.line)
        rows.extend([*part, *own])
        rows.lines = [*part.lines, *own.lines]
        return rows
    raise SceneError(f"{table.where(key)}: {key} is not the same kind of thing here and in the included file")


def _arguments(path: Path, table: Table) -> tuple[dict[str, Param], dict[str, tuple[int, Param]]]:
    """Declared arguments, and for those that are vectors how many components there are and what each must be."""
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


def parse_args(text: str | Mapping[str, Any] | None) -> dict[str, Any]:
    """Parses arguments written as text: `omega=50,centre=0.1,-0.2` gives {"omega": "50", "centre": "0.1,-0.2"}; a map
    is returned as it is.

    A piece without `=` goes on with the value before it. Raises SceneError.
    """
    if not isinstance(text, str):
        return {k: v for k, v in (text or {}).items() if v is not None}
    result: dict[str, Any] = {}
    key = ""
    for piece in filter(None, (p.strip() for p in text.split(","))):
        if "=" in piece:
            key, value = (part.strip() for part in piece.split("=", 1))
            result[key] = value
        elif key:
            result[key] += f",{piece}"
        else:
            raise SceneError(f"scene_args '{text}' is not key=value,key=value: '{piece}' has no '='")
    return result
