"""Makes a user's own folders `nodes`, `msgs` or `bench` importable beside evis's packages of these names.

Python imports the first package of a name and hides the others: a script beside a package `nodes` of its own could not
import evis, nor evis its nodes. From the import of `evis` on these names hold the modules of both. Where both have a
module of one full name, one line says so and names the remedy.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

ROOT = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
"""The folder that holds evis and its packages."""
PACKAGES = ("nodes", "msgs", "bench")


class Neighbours:
    """Finds the modules of PACKAGES in all folders of the path, where there is another than ROOT that has such."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Implements importlib.abc.MetaPathFinder. Raises ImportError for a module that both have."""
        parents = fullname.split(".")[:-1]
        top = (parents or [fullname])[0]
        if top not in PACKAGES or not (folders := _folders(top, tuple(sys.path), os.getcwd())):
            return None
        for name in parents:
            folders = [folder for place in folders if os.path.isdir(folder := os.path.join(place, name))]
        found = [spec for folder in folders if (spec := PathFinder.find_spec(fullname, [folder])) is not None]
        return _merged(fullname, found)


@functools.lru_cache(maxsize=64)
def _folders(name: str, path: tuple[str, ...], here: str) -> list[str]:
    """ROOT and, before it, the folders of the path that hold another `name`; [] when there is none."""
    places = [os.path.realpath(os.path.join(here, entry)) for entry in path]
    theirs = [place for place in dict.fromkeys(places) if place != ROOT and _holds(place, name)]
    return [*theirs, ROOT] if theirs else []


def _holds(place: str, name: str) -> bool:
    at = os.path.join(place, name)
    if os.path.isfile(os.path.join(place, "evis", "neighbours.py")):
        return False  # another evis: its packages are not the user's
    return os.path.isdir(at) or os.path.isfile(f"{at}.py")


def _merged(fullname: str, found: list[ModuleSpec]) -> ModuleSpec | None:
    """One spec of those that the folders have: the first with code, looking for submodules in all folders."""
    if not found:
        return None
    coded = [spec for spec in found if spec.has_location]
    ours = next((spec for spec in coded if str(spec.origin).startswith(ROOT + os.sep)), None)
    theirs = [spec for spec in coded if spec is not ours]
    if ours is not None and theirs and "." in fullname and not _is_empty_package(ours):
        raise ImportError(
            f"{theirs[0].origin} hides the module {fullname} of evis; give yours another name", name=fullname
        )
    spec = next(iter(coded), found[0])
    places = [place for one in found for place in one.submodule_search_locations or ()]
    if places:
        spec.submodule_search_locations = list(dict.fromkeys(places))
    return spec


def _is_empty_package(spec: ModuleSpec) -> bool:
    """Whether nothing but a docstring stands in it, so that another may be loaded in its place."""
    if spec.submodule_search_locations is None or spec.origin is None:
        return False
    with open(spec.origin, "rb") as source:  # bytes, as the compiler knows how they are encoded
        return set(compile(source.read(), spec.origin, "exec").co_names) <= {"__doc__"}


def install() -> None:
    """Puts the finder before Python's own, and widens what was imported before evis."""
    if not any(isinstance(finder, Neighbours) for finder in sys.meta_path):
        sys.meta_path.insert(0, Neighbours())
    for name in PACKAGES:
        module, ours = sys.modules.get(name), os.path.join(ROOT, name)
        if module is not None and ours not in (places := list(getattr(module, "__path__", ()))):
            module.__path__ = [*places, ours]
