"""Writes events of a bag in the formats of event files."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import environments
from evis.bag.decoded import decoded_events
from evis.bag.export.source import Source
from evis.events import open_writer
from evis.events.recording import WHOLE_US


def write(source: Source, out: Path) -> dict[str, Any]:
    """Writes events to a file in the format that its ending names.

    Counts times that the format rounds, colour that it leaves out, and events or bytes that were lost before they were
    recorded. Raises BagError where the topic has several environments and none was named.
    """
    packets = decoded_events(source.reader, source.name, source.env)
    first = next(packets, None)
    size = (first[0].width, first[0].height) if first else (0, 0)
    count = lost = rounded = colourless = 0
    with open_writer(out, *size) as writer:
        for packet, events in itertools.chain([first] if first else [], packets):
            if source.env is None:
                environments.check_one(source.name, environments.count(packet))
            writer.write(events)
            count, lost = count + len(events), lost + packet.lost
            rounded += int(np.count_nonzero(events.t % 1000)) if out.suffix.lower() in WHOLE_US else 0
            colourless += len(events) if events.c is not None and out.suffix.lower() != ".npz" else 0
    odd = {"times_rounded_to_us": rounded, "colour_left_out": colourless, "lost": lost}
    return {"events": count, "width": size[0], "height": size[1], **{name: n for name, n in odd.items() if n}}
