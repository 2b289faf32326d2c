"""Shows a running graph to Foxglove and Lichtblick, by the protocol foxglove.websocket.v1.

`node.py`, on the executor's thread, opens taps for the topics that clients have subscribed to, and puts what they give
into `relay.py`, which encodes it for the channels that somebody reads (`channels.py`; `pictures.py` draws what
Foxglove cannot) and offers it to the clients (`client.py`), each of which holds the newest of each subscription. On the
thread of evis/web's server (`application.py`, `origins.py`) a `session.py` for each client speaks the protocol
(`protocol.py`).
"""
