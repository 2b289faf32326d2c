"""The node where frames are only looked at, and some are lost: no image is made of what was not all seen."""

import numpy as np

from msgs.camera import Frames, Image
from msgs.header import Header
from nodes.frame_camera.node import FrameCameraNode

MS = 1_000_000


class Wire:
    """Stands for the executor."""

    def __init__(self):
        self.messages, self.counted = [], {}

    def publish(self, node, port, message):
        message.check()
        self.messages.append(message)

    def loan(self, node, port, arrays):
        return {name: np.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def count(self, node, name, amount):
        self.counted[name] = self.counted.get(name, 0) + amount


def gap(number, level=0.5):
    """Frames of the gap that ends at 10 ms times `number`."""
    end = 10 * MS * number
    t = np.array([end]) if number == 0 else end - 10 * MS + 5 * MS * np.arange(1, 3)
    light = np.full((1, len(t), 4, 6), level, np.float32)
    return Frames(Header(end, number), t=t, episodes=np.zeros(1, np.int32), luminance=light)


def test_an_exposure_with_a_hole_in_it_gives_no_image():
    node = FrameCameraNode("frame_camera", {"image_rate": 40, "exposure_ms": 15, "image_bits": 16})
    node.runtime = Wire()
    node.setup()
    for number in (0, 1, 2, 4, 5, 6, 7, 8, 9, 10):
        node.update({"frames": gap(number)})
    node.finish()
    found = node.runtime.messages
    assert all(isinstance(image, Image) for image in found)
    # Image 1, from 25 to 40 ms, lacks the gap up to 30 ms; image 4 begins at the end.
    assert [image.header.stamp_ns for image in found] == [7.5 * MS, 57.5 * MS, 82.5 * MS]
    value = np.floor(1e7 * 0.5 * 15e-3 / 20000 * 65535 + 0.5)
    assert all((image.data == min(value, 65535)).all() for image in found)
    assert node.runtime.counted["clipped_pixels"] == 3 * 24
