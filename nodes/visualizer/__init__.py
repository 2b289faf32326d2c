"""Shows a running graph as a live web page.

`node.py`, on the executor's thread, opens taps for the panels that pages have open, and puts what they give into
`hub.py`, where a view of each panel (`views/`, chosen by `catalog.py`) copies what it needs. On the thread of
evis/web's server (`application.py`) a `session.py` for each page encodes the newest of each view and sends it over a
WebSocket to `page/`.
"""
