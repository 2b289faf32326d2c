"""How many messages are missing between two, by their numbers."""

import pytest

from msgs.header import missed_between


@pytest.mark.parametrize(
    ("before", "seq", "missed"),
    [(0, 1, 0), (0, 4, 3), (4, 4, 0), (9, 0, 0), (9, 4, 4)],
    ids=["the next", "a gap", "twice the same", "the first of a new publisher", "a later one of a new publisher"],
)
def test_messages_that_did_not_come(before: int, seq: int, missed: int) -> None:
    assert missed_between(before, seq) == missed
