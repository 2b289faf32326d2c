"""Emulates USB cameras as pyusb sees them, so that the drivers run unchanged without hardware.

The way of a byte:

1. A feed supplies it: `recording_feed.py` of a recording, which `windows.py` cuts into stretches and `reencode.py`
   encodes as the model's words; `feed.py` of another thread; `flood_feed.py` at a steady rate.
2. The device sends it while its registers say so (`treuzell.py`, `fx3.py`, `dvs128.py` on `device.py`), filtered as
   they ask for (`readout.py`), and with the faults of `faults.py`.
3. `backend.py` gives pyusb the device, on a bus of `bus.py`, from which the real driver reads.

`live.py` is the node that sends simulated events this way.
"""
