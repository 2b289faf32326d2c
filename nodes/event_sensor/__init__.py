"""Simulates an event sensor: linear luminance in, events out.

The way of the data:

1. `node.py`, declared in `declaration.py`, takes frames or samples and publishes events; `messages/` reads and
   publishes the messages, `environments/` makes the sensors, apart for environments that cannot share one.
   `parameters.py` has what a user may choose, `presets.py` what real sensors have; `scene_parameters.py` has what a
   scene gives, and `effects.py` tells which values change nothing. `make.py` makes one sensor, and `simulate.py` runs
   it on frames from anywhere.
2. `sensor.py` takes an array through all of the following. `batches.py` makes a batch of it: `input/` checks it and
   brings it to the device.
3. `optics/` blurs it and filters it by the photoreceptor.
4. `engines/` chooses what keeps the state of the pixels and launches the kernels of the event model, each equation of
   which is in `model/`; `cpu/` and `cuda/` schedule its work and put events in order.
5. `readout/` is the arbiter: what events lose and gain on their way out.

Beside it, `peers/` has other published models, and `fit/` finds a sensor's parameters from recordings of it.
"""
