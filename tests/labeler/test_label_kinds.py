"""The kinds of labels: whoever makes, stores, exports or describes them has all of them, and all their arrays."""

from __future__ import annotations

import re
from pathlib import Path

from evis.bag.export import labels as archive
from evis.dataset.layouts import sample
from msgs.camera import Labels
from msgs.fields import array_specs, environment_key
from nodes.labeler.kinds import NEEDS

KINDS = {**sample.DENSE, **sample.TABLES, "events": sample.EVENTS}
"""Kind -> its arrays, as sequences of data sets hold them."""
ARRAYS = {name for name in array_specs(Labels) if environment_key(name, Labels) != name}
"""All arrays of the message but those that tell the environment of each row."""


def test_the_labeler_and_data_sets_have_the_same_kinds() -> None:
    assert set(KINDS) == set(NEEDS)


def test_every_array_of_the_message_is_of_a_kind() -> None:
    """One that is of none would not come into data sets, without a word."""
    assert {name for names in KINDS.values() for name in names} == ARRAYS


def test_every_array_of_the_message_is_exported() -> None:
    """flow_t, which is one for all environments, is written beside the times."""
    written = {*archive.DENSE, *(name for names in archive.TABLES.values() for name in names), "flow_t"}
    assert written == ARRAYS


def test_every_kind_has_a_row_on_its_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "labels.md").read_text()
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} == set(NEEDS)
