"""Reads a scene file with checks: every value with its file and line, its type, range and unit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from evis.config.document import Row, Table
from evis.config.expression import ExpressionError, UnknownName, substitute
from evis.config.suggestions import nearest
from evis.geometry import se3
from evis.scene.draws import Draws
from evis.scene.errors import SceneError
from evis.scene.yaml.drawing import draw, has_draws, how_to_draw, is_draw, places_of, split_unit

_REQUIRED: Any = object()
FARTHEST = 1e9
"""From the origin [m]; there double precision still tells 0.1 um."""
LARGEST = 1e30
"""Beyond it single precision ends soon."""
MAX_ERROR = 400
"""Longest text about a value [characters]."""


class Fields:
    """Reads one map of a scene file with its `${...}` filled in; `done` refuses the keys that nothing asked for.

    what: for error texts, such as "body 'disk'". draws: makes the values that are random; None where none may be.
    address: name of the map within the file, such as `bodies.disk`, by which they are drawn.
    """

    def __init__(
        self, table: Table, what: str, arguments: Mapping[str, Any], draws: Draws | None = None, address: str = ""
    ) -> None:
        self.table = table
        self.what = what
        self.arguments = arguments
        self.draws = draws
        self.address = address
        self._asked: list[str] = []

    def error(self, key: str | None, text: str) -> SceneError:
        """Makes a SceneError at the line of `key`; of a text with a long value in it the middle is left out."""
        text = text if len(text) <= MAX_ERROR else f"{text[: MAX_ERROR // 2]} ... {text[-MAX_ERROR // 2 :]}"
        place = f"{self.what}: {key}" if key else self.what
        return SceneError(f"{self.table.where(key if key in self.table else None)}: {place} {text}")

    def has(self, key: str) -> bool:
        """Returns True where the file gives this key."""
        self._asked.append(key)
        return self.table.get(key) is not None

    def raw(self, key: str, default: Any = _REQUIRED, *, whole: bool = False) -> Any:
        """Reads the value as YAML has it, arguments filled in, or draws it; whole: as a whole number."""
        if not self.has(key):
            if default is _REQUIRED:
                raise self.error(None, f"needs '{key}'")
            return default
        value = self.table[key]
        if is_draw(value) or has_draws(value):
            return self._drawn(key, value, self.within(key), whole)
        if isinstance(value, (Table, Row)) and not _is_plain_list(value):
            return value
        return self._filled(key, value)

    def _drawn(self, key: str, value: Any, place: str, whole: bool) -> Any:
        """A draw, or a list with draws in it, as a plain value."""
        if is_draw(value):
            if self.draws is None:
                raise self.error(key, "is drawn; what stands here must be the same in every world")
            return draw(Fields(value, f"{self.what}, {key}", self.arguments, self.draws, place), whole)
        if isinstance(value, list):
            return [self._drawn(key, item, f"{place}[{i}]", whole) for i, item in enumerate(value)]
        return self._filled(key, value)

    def within(self, key: str) -> str:
        """Names the place of a key of this map."""
        return f"{self.address}.{key}" if self.address else key

    def with_arguments(self, arguments: Mapping[str, Any], place: str) -> Fields:
        """Makes another reader of the same map, with other arguments and draws of its own."""
        return Fields(self.table, self.what, arguments, self.draws, place)

    def plain(self, key: str, default: Any = _REQUIRED) -> Any:
        """Reads the value with `${...}` filled in at every depth of its lists."""
        return self._filled(key, self.raw(key, default))

    def _filled(self, key: str, value: Any) -> Any:
        try:
            return substitute(value, self.arguments)
        except UnknownName as error:
            raise self.error(key, f"uses '{error.name}'; {nearest(error.name, self.arguments)}") from None
        except ExpressionError as error:
            raise self.error(key, f"cannot be worked out: {error}") from None

    def fraction(self, key: str, default: Any = _REQUIRED) -> float:
        """Reads a number from 0 to 1."""
        value = self.number(key, default, minimum=0.0)
        if value > 1.0:
            raise self.error(key, f"is {value:g}; the most is 1")
        return value

    def number(
        self,
        key: str,
        default: Any = _REQUIRED,
        *,
        minimum: float | None = None,
        above: float | None = None,
        maximum: float = LARGEST,
    ) -> float:
        """Reads a finite number, at least `minimum`, greater than `above`, of a size of at most `maximum`."""
        return self.number_of(key, self.raw(key, default), minimum, above, maximum)

    def number_of(
        self,
        key: str,
        value: Any,
        minimum: float | None = None,
        above: float | None = None,
        maximum: float = LARGEST,
    ) -> float:
        """Reads a value found under `key` as `number` does.

        Args:
            key: named in errors.
            value: what the file has there, a number or a text of one.
            minimum: the least that is allowed.
            above: what the number must exceed.
            maximum: the greatest size that is allowed.

        Raises:
            SceneError: for what is no finite number, or out of range.
        """
        try:
            number = math.nan if isinstance(value, bool) else float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise self.error(key, f"is {value!r}; it must be a finite number{how_to_draw(value)}")
        if minimum is not None and number < minimum:
            raise self.error(key, f"is {number:g}; the least is {minimum:g}")
        if above is not None and number <= above:
            raise self.error(key, f"is {number:g}; it must be more than {above:g}")
        if abs(number) > maximum:
            raise self.error(key, f"is {number:g}; the most is {maximum:g}")
        return number

    def whole(self, key: str, default: Any = _REQUIRED, *, minimum: int = 0, maximum: int = 1 << 16) -> int:
        """Reads a whole number within [minimum, maximum]."""
        number = self.number_of(key, self.raw(key, default, whole=True))
        if number != int(number) or not minimum <= number <= maximum:
            raise self.error(key, f"is {number:g}; it must be a whole number from {minimum} to {maximum}")
        return int(number)

    def angle(self, key: str, default: Any = _REQUIRED) -> float:
        """Reads an angle [rad]: a number is radians, a text may end in `deg` or `rad`."""
        return self.angle_of(key, self.raw(key, default))

    def angle_of(self, key: str, value: Any) -> float:
        """Reads a value found under `key` as `angle` does."""
        text, unit = split_unit(value)
        number = self.number_of(key, text)
        return math.radians(number) if unit == "deg" else number

    def vector(self, key: str, length: int = 3, default: Any = _REQUIRED, *, above: float | None = None) -> np.ndarray:
        """Reads a float64 vector; `a, b, c` as text will do."""
        return self.vector_of(key, self.raw(key, default), length, above=above)

    def vector_of(
        self, key: str, value: Any, length: int, *, above: float | None = None, maximum: float = LARGEST
    ) -> np.ndarray:
        """Reads a value found under `key` as `vector` does.

        Args:
            key: named in errors.
            value: what the file has there, a list or a text `a, b, c`.
            length: numbers that it must have.
            above: what every number must exceed.
            maximum: the greatest size of a number that is allowed.

        Raises:
            SceneError: for another length, and for numbers out of range.
        """
        if isinstance(value, str):
            value = value.split(",")
        if not isinstance(value, (list, tuple, np.ndarray)) or len(value) != length:
            raise self.error(key, f"is {value!r}; it must be a list of {length} numbers{how_to_draw(value)}")
        return np.array([self.number_of(key, v, above=above, maximum=maximum) for v in value])

    def place(self, key: str) -> np.ndarray:
        """Reads a position [m], float64 [3], at the origin unless given; at most FARTHEST along each axis."""
        return self.vector_of(key, self.raw(key, [0, 0, 0]), 3, maximum=FARTHEST)

    def direction(self, key: str, default: Any = _REQUIRED) -> np.ndarray:
        """Reads a vector scaled to unit length."""
        value = self.vector(key, 3, default)
        length = float(np.linalg.norm(value))
        if length < 1e-12:
            raise self.error(key, "is zero, so it has no direction")
        return value / length

    def colour(self, key: str, default: Any = _REQUIRED, maximum: float | None = None) -> np.ndarray:
        """Reads three linear components, none negative; a single number is a grey."""
        value = self.raw(key, default)
        if not isinstance(value, (list, tuple, np.ndarray, str)):
            value = [value] * 3
        if isinstance(value, str):
            value = value.split(",") if "," in value else [value] * 3
        if len(value) != 3:
            raise self.error(key, f"is {value!r}; it must be one number (grey) or three (R, G, B)")
        colour = np.array([self.number_of(key, v, minimum=0.0) for v in value], np.float32)
        if maximum is not None and colour.max() > maximum:
            raise self.error(key, f"is {colour.max():g}; the most is {maximum:g}, since it is a reflectance")
        return colour

    def text(self, key: str, default: Any = _REQUIRED, choices: Sequence[str] = ()) -> str:
        """Reads a text, one of `choices` where given."""
        value = self.raw(key, default)
        if not isinstance(value, (str, int, float)) or isinstance(value, bool):
            raise self.error(key, f"is {value!r}; it must be a text{how_to_draw(value)}")
        if choices and str(value) not in choices:
            raise self.error(key, f"is '{value}'; {nearest(str(value), choices)}")
        return str(value)

    def flag(self, key: str, default: bool) -> bool:
        """Reads true or false."""
        value = self.raw(key, default)
        if not isinstance(value, bool):
            raise self.error(key, f"is {value!r}; it must be true or false{how_to_draw(value)}")
        return value

    def section(self, key: str, what: str) -> Fields | None:
        """Returns the map under `key`, or None."""
        if not self.has(key):
            return None
        return self._as_fields(key, self.table[key], what, self.within(key))

    def sections(self, key: str, what: str) -> dict[str, Fields]:
        """Returns the map of maps under `key`: name -> its fields, empty where there is none."""
        if not self.has(key):
            return {}
        table = self.table[key]
        if not isinstance(table, Table):
            raise self.error(key, f"must be a map of names, each with a map of what the {what} is")
        inside = Fields(table, self.what, self.arguments, self.draws, self.within(key))
        return {n: inside._as_fields(n, v, f"{what} '{n}'", inside.within(n)) for n, v in table.items()}

    def items(self, key: str, what: str) -> list[Fields]:
        """Returns the list of maps under `key`, empty where there is none; a single map counts as a list of one."""
        if not self.has(key):
            return []
        value = self.table[key]
        rows = value if isinstance(value, list) else [value]
        places = places_of(rows, self.within(key))
        return [self._as_fields(key, row, f"{what} {i + 1}", places[i]) for i, row in enumerate(rows)]

    def _as_fields(self, key: str, value: Any, what: str, place: str) -> Fields:
        if is_draw(value):
            raise self.error(key, f"is drawn as a whole; {what} is a map, in which each value may be drawn")
        if not isinstance(value, Table):
            raise self.error(key, f"is {value!r:.60}; it must be a map such as {{name: value}}")
        what = what if self.what.startswith("scene") else f"{self.what}, {what}"
        return Fields(value, what, self.arguments, self.draws, place)

    def rotation(self) -> np.ndarray:
        """Reads a quaternion from `quaternion: [x, y, z, w]` or `rotation: {axis, angle}` (a list of them: one after
        another).

        Later entries of the list turn about axes of the frame that the earlier ones left.
        """
        if self.has("quaternion"):
            quaternion = self.vector("quaternion", 4)
            try:
                return se3.normalize(quaternion)
            except ValueError:
                raise self.error("quaternion", "is zero, so it is no rotation") from None
        result = se3.IDENTITY[3:]
        for entry in self.items("rotation", "rotation"):
            result = se3.multiply(result, se3.exp(entry.direction("axis") * entry.angle("angle")))
            entry.done()
        return result

    def done(self) -> None:
        """Raises SceneError for a key that nothing asked for."""
        for key in self.table:
            if key not in self._asked:
                raise self.error(key, f"is not known here; {nearest(key, sorted(set(self._asked)))}")


def _is_plain_list(value: Any) -> bool:
    return isinstance(value, Row) and not any(isinstance(v, (Table, Row)) for v in value)
