"""Chooses a representation of events by its name and options before there are events."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.config.suggestions import nearest
from evis.dataset.errors import DatasetError

NAMES = ("voxel_grid", "time_surface", "count_image", "event_stack")
"""Functions of evis.events.representations."""
_GIVEN = ("events", "window", "at", "height", "width")
"""Arguments that the window itself decides."""


@dataclass(frozen=True)
class Representing:
    """Makes images of the events of a window. name: one of NAMES. options: of that function."""

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Computes the image of no events, so that wrong options are refused before there are any.

        Raises DatasetError for a name or an option that is not there, or a wrong value.
        """
        if self.name not in NAMES:
            raise DatasetError(f"there is no representation '{self.name}'; {nearest(str(self.name), NAMES)}")
        takes = [n for n in inspect.signature(self._function()).parameters if n not in _GIVEN]
        for option in self.options:
            if option not in takes:
                raise DatasetError(f"{self.name} has no option '{option}'; {nearest(option, takes, 'it has')}")
        empty = {name: np.empty(0, dtype) for name, dtype in (("t", "i8"), ("x", "u2"), ("y", "u2"), ("p", "u1"))}
        try:
            self(empty, 0, 1, 1, 1)
        except TypeError as error:
            raise DatasetError(f"{self.name}: {str(error).partition(' ')[2]}; it takes {', '.join(takes)}") from None
        except ValueError as error:
            raise DatasetError(f"{self.name}: {error}") from None

    def __call__(self, events: Mapping[str, Any], t0: int, t1: int, height: int, width: int) -> Any:
        """Makes the image of the events of [t0, t1) ns, float32 or int32, on the device where they are."""
        given: dict[str, Any] = {"height": height, "width": width}
        if self.name == "time_surface":
            given["at"] = t1
        elif self.options.get("by") != "count":
            given["window"] = (t0, t1)
        return self._function()(events, **given, **self.options).values

    def _function(self) -> Callable[..., Any]:
        from evis.events import representations

        function: Callable[..., Any] = getattr(representations, self.name)
        return function
