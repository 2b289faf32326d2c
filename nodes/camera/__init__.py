"""Publishes the events of a real event camera, or of a recording of one, on the same topics as the simulator.

The way of the data:

1. `find.py` chooses the driver that a user's arguments name; `effects.py` tells which of them change nothing beside the
   others.
2. A driver gives the events of one interval of the device's clock after another, as `Reading`s: `interface/` defines
   it, `file_source.py` plays a recording, and `treuzell/` (Prophesee) and `inivation/` speak the protocols of USB
   cameras on what `usb/` has for all of them.
3. `node.py` makes messages of each reading (`interface/`) and publishes them; between two of them it takes settings,
   which the driver writes while the camera streams.

`emulated/` has USB devices without hardware, which send a recording or simulated events to the real drivers.
"""
