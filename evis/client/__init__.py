"""Connects a program to a running graph: its topics as iterators, its actions, its resets.

with evis.connect() as run:
    for packet in run.topic("/cam0/events"):
        run.act(controls_from(packet))
"""

from evis.client.run import Run, connect
from evis.client.topics import TopicReader

__all__ = ["Run", "TopicReader", "connect"]
