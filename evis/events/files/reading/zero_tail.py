"""Finds where the data of a file end that a power failure has left with its full length and zeros at the end."""

from __future__ import annotations

import os

from evis.events.recording import RecordingInfo

LEAST = 4096
"""Zeros at the end of a file [bytes] that are no data, but pages that were never written: as data they would be some
hundred events of one pixel and time."""
_STEP = 1 << 20


def data_end(descriptor: int, begin: int, info: RecordingInfo, word: int = 1) -> int:
    """Finds the end of a file's data, which lie from byte `begin` on in words of `word` bytes.

    That is the end of the file [bytes], or that of the last word before LEAST or more zeros at its end; these are said
    in the recording's warnings, and it is truncated.
    """
    size = os.fstat(descriptor).st_size
    end = size
    while end > begin:
        end = max(_hole_begin(descriptor, end), begin)
        step = min(_STEP if end < size else LEAST, end - begin)
        kept = os.pread(descriptor, step, end - step).rstrip(b"\0")
        end -= step - len(kept)
        if kept:
            break
    end = begin - (begin - end) // word * word
    if size - end < LEAST:
        return size
    info.truncated = True
    info.warn(f"the last {size - end} bytes are zeros, as a loss of power leaves them: they hold no event")
    return end


def _hole_begin(descriptor: int, end: int) -> int:
    """Finds the first byte from which on the file has no page on the disk, to a power of two before `end`."""
    step, place = LEAST, os.lseek(descriptor, 0, os.SEEK_CUR)
    while step <= end:
        try:
            if os.lseek(descriptor, end - step, os.SEEK_DATA) < end:
                break
        except OSError:  # no data to the end of the file
            pass
        step *= 2
    os.lseek(descriptor, place, os.SEEK_SET)
    return end - step // 2 if step > LEAST else end
