"""Holds the engines: the state of the pixels and the launches of the kernels that turn frames into events.

An engine has `in_place`, `sorts`, `kernels()`, `arrays()`, `launch(sensor, batch, keys, counters, resume)` and
`swap()`. One with `in_place` changes the state where it is, and goes on at the pixel at which the room for events ran
out. Any other reads the state before a message and writes the state after it, so that its launch can be repeated with
more room; `swap` then makes the new state the present one. The ideal engines are cpu.ideal.Ideal and
cuda.ideal.IdealPasses.
"""
