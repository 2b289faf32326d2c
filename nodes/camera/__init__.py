"""Publishes the events of a real event camera, or of a recording of one, on the same topics as the simulator.

`node.py` takes a driver from `find.py` and reads intervals of events from it (`interface/driver.py` is the interface,
`interface/messages.py` makes messages of them). A recording is played by `file_source.py`. A USB camera's bytes go
through `usb/` (device, reader, decoder, counters) under its maker's protocol in `treuzell/` or `inivation/`;
`emulated/` answers that protocol below pyusb, where there is no camera.
"""
