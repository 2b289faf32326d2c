"""Handles cameras on USB: finding and opening a device, reading its stream, mapping its clock.

`models.py` lists the cameras by their USB ids, `udev.py` writes the rules that let users open them, and `access.py`
opens them. `driver.py` is what all drivers share; makers' protocols derive from it, with the settings of `settings.py`
and `region.py`. The way of a byte:

1. `queue.py` keeps several reads at the bulk endpoint (`reader.py` one), and a thread puts what they bring into
   buffers.
2. `stream.py` decodes the buffers, cuts at whole intervals of the device's clock and marks losses; `clock.py` maps that
   clock to the host's.
3. `imu_endpoint.py` adds inertial samples of cameras that send them on an endpoint of their own.
"""
