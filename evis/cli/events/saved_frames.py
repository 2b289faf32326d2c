"""Saves the frames that the sensor takes, sub-frames included, as a folder that `evis events simulate` reads again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from evis.cli.parser import UsageError

if TYPE_CHECKING:
    from evis.media.frames.source import FrameBlock


class SavedFrames:
    """Writes frames to a folder, 000000.exr and so on: float32, linear, R, G and B or luminance Y, with their times.

    count: frames that are whole so far. The folder is made for the first of them. Raises UsageError for one that holds
    something.
    """

    def __init__(self, folder: str) -> None:
        self.folder, self.count = Path(folder), 0
        try:
            if self.folder.exists() and any(self.folder.iterdir()):
                raise UsageError(f"--save-frames {folder} is not empty; name a new folder")
        except OSError as error:
            raise self._refused(error) from None

    def _refused(self, error: OSError) -> UsageError:
        """Words why the folder cannot be had."""
        return UsageError(f"--save-frames {self.folder}: {error.strerror}; name a new folder")

    def passing(self, blocks: Iterator[FrameBlock]) -> Iterator[FrameBlock]:
        """Gives the blocks on, each once its frames are written.

        Raises UsageError where the folder cannot be made, OSError where a frame cannot be written.
        """
        from evis.bag.export import exr

        for block in blocks:
            if not self.count:
                try:
                    self.folder.mkdir(parents=True, exist_ok=True)
                except OSError as error:
                    raise self._refused(error) from None
            for t, image in zip(block.t.tolist(), block.image):
                exr.write(self.folder / f"{self.count:06d}.exr", {"RGB" if image.ndim == 3 else "Y": image}, t)
                self.count += 1
            yield block
