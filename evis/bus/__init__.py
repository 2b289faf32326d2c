"""Carries messages on topics between processes, over ZeroMQ and shared memory.

The way of a message:

1. A node writes its arrays into memory that `publisher.py` lends (`memory/`).
2. `consumers.py` says who has credit for it; the header goes to them through a pipe (`pipes.py`) or ZeroMQ, with
   control messages of `wire.py`. `tap.py` sends viewers a copy, as far as they follow.
3. `subscriber.py` makes the message again, with its arrays in the publisher's memory; its `lease.py` returns credit and
   memory.

`local.py` is the publisher of a topic that no other process can read. `endpoints.py` places the sockets, `links.py`
connects programs outside of a graph, and `errors.py` has the errors.

A topic has one publisher. Its *declared consumers* get every message: each hands out credits (`window`), and the
publisher sends only when all have some; arrays above 32 kB lie in shared memory slots that are written in place
(`loan`) and are free again when every consumer has released the message. *Taps* get a rate-limited copy of their own
and can slow nobody.

    publisher = Publisher(context, "/cam0/depth", "renderer", endpoints_for(directory, "/cam0/depth"),
                          ["interpolator:depth"], message_type=Depth)
    publisher.start()
    while publisher.missing(): ...
    depth = publisher.loan(depth=((1, 480, 640), "float32"))["depth"]
    publisher.send(Depth(Header(stamp_ns=0), depth=depth))
    publisher.finish(timeout_s=10)

On the other side `receive` gives messages, then END. A message holds one pin: `message.release()` returns its credit;
`message.keep()` before that keeps its arrays valid (the credit returns all the same, so that a kept message does not
stop the stream) until one more `release`. Both sides must be looked after to connect: the publisher's `pump` (or
`missing`) and the subscriber's `connected` (or `receive`). A message is published once: a received one, or one that was
published before, is refused.

A topic that only nodes of its own process can read has a `LocalPublisher`: the same calls, without a socket.

Sockets are files in a directory that is private to the user: nobody else, and no other machine, can connect.
"""

from evis.bus.endpoints import Endpoints, endpoints_for
from evis.bus.errors import BusError, PeerLost
from evis.bus.lease import END, End
from evis.bus.local import LocalPublisher
from evis.bus.memory.slots import Slot, SlotPool
from evis.bus.publisher import Publisher
from evis.bus.subscriber import Subscriber

__all__ = [
    "END",
    "BusError",
    "End",
    "Endpoints",
    "LocalPublisher",
    "PeerLost",
    "Publisher",
    "Slot",
    "SlotPool",
    "Subscriber",
    "endpoints_for",
]
