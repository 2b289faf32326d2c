"""Converts words on a wire to events and back; a folder per maker has its codecs, with their kernels beside.

The way of a word to an event:

1. `decoder.py` takes bytes in pieces of any size, and cuts exactly at a time. `prophesee/`, `inivation/` and
   `event_camera_msgs/` have a `Decoder` for each encoding.
2. A few words are decoded by numpy (`Decoder.decode_words`), many by a Warp kernel on one CPU thread, which
   `launcher.py` runs with what `warp_calls.py` records: both give the same bits.
3. Kernels write events, triggers and words of other parts of the sensor with `writing_kernels.py` (`writing.h`), masks
   of pixels with `mask_kernels.py` (`masks.h`), into the arrays of `buffer.py`.

`encoder.py` goes the other way.
"""
