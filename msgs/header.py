"""Defines the header that every message carries, and the registry of message types."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from msgs.fields import MessageError, array_specs, check_arrays, plain_fields


@dataclass(slots=True)
class Header:
    """Says what time and which stream a message belongs to.

    stamp_ns: physical time the data is about [ns]. seq: counts up by one per topic and publisher; a gap is a loss
    (`missed_between`).
    clock: the time domain (`sim`, `wall`, `device:<serial>`). episode: goes up at each reset; no node carries state
    across it.
    """

    stamp_ns: int
    seq: int = 0
    clock: str = "sim"
    episode: int = 0

    @property
    def instant(self) -> tuple[int, int]:
        """Gives the episode and the stamp [ns], in whose order the messages of a topic come."""
        return self.episode, self.stamp_ns


def missed_between(before: int, seq: int) -> int:
    """Counts the messages of a topic that did not come between two that did, by their numbers.

    A number below the one before is of a publisher that was started again, which numbers its messages from 0.
    """
    return seq if seq < before else max(0, seq - before - 1)


class Message:
    """Carries data from one node to others: the base of all messages.

    A subclass is a dataclass whose first field is `header`.

    VERSION goes up whenever the fields change meaning; a mismatch on the wire is an error that names both sides.
    """

    VERSION: ClassVar[int] = 1
    TYPES: ClassVar[dict[str, type[Message]]] = {}
    header: Header
    _slot: ClassVar[Any] = None
    """The bus sets this on a received message whose arrays lie in shared memory (`pin()`, `unpin()`)."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        Message.TYPES[cls.__name__] = cls

    @property
    def environment(self) -> tuple[int, int]:
        """Tells which environment it is of, and of how many, where each has messages of its own; else (0, 1)."""
        return 0, 1

    def arrays(self) -> dict[str, Any]:
        """Returns the array fields that are present, in declaration order."""
        return {n: v for n in array_specs(type(self)) if (v := getattr(self, n)) is not None}

    def scalars(self) -> dict[str, Any]:
        """Returns all other fields but the header."""
        return {n: getattr(self, n) for n in plain_fields(type(self))}

    def check(self) -> None:
        """Raises MessageError unless dtypes and shapes are as declared."""
        if not isinstance(self.header, Header):
            raise MessageError(f"{type(self).__name__}.header is {type(self.header).__name__}, not Header")
        check_arrays(type(self), self.arrays())
        self.check_values()

    def check_values(self) -> None:
        """Raises MessageError where arrays contradict each other.

        It is called for every message that is sent, so it must be quick. Message itself checks nothing.
        """

    def keep(self) -> None:
        """Keeps the arrays valid after `update` returns, until `release`: the slot they lie in is not written again."""
        if self._slot is not None:
            self._slot.pin()

    def release(self) -> None:
        """Undoes one `keep`."""
        if self._slot is not None:
            self._slot.unpin()
