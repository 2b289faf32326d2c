"""Reads the images of messages, and further samples of single pixels between them, for a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from evis.gpu.in_a_row import joined
from msgs.camera import Frames, Keyframe, Samples

if TYPE_CHECKING:
    from nodes.event_sensor.input.further import Further


class Images:
    """Reads from messages the arrays that a sensor takes: luminance or, with `colour`, RGB. name: of the node."""

    def __init__(self, name: str, colour: bool, device: Any) -> None:
        self._name, self._colour, self._device = name, colour, device

    def read(self, messages: Sequence[Keyframe | Frames | Samples]) -> Any:
        """Gives the images of messages, [E, K, h, w(, 3)]; on a GPU [E, K, h, w] of float32 or vec3.

        The images of several messages, of one environment, follow one another along K. Raises ValueError for messages
        that carry luminance where RGB is needed, or the other way round.
        """
        keys = [message for message in messages if isinstance(message, Keyframe)]
        if keys:
            made = self._of_keyframe(keys[0], joined([key.image for key in keys]))
        else:
            made = joined([self._of_frames(message) for message in messages if not isinstance(message, Keyframe)])
        return made if len(messages) == 1 else made.reshape((1, made.shape[0] * made.shape[1], *made.shape[2:]))

    def further_samples(self, message: Samples) -> Further:
        """Gives the further samples of a message. Raises ValueError as `read` does."""
        from nodes.event_sensor.input.further import Further

        value = message.further_rgb if self._colour else message.further
        if value is None:
            raise ValueError(
                f"{self._name}: samples lack the values between the frames; set colour alike on both nodes"
            )
        return Further(message.first, message.offset, value)

    def _of_keyframe(self, message: Keyframe, image: Any) -> Any:
        """Gives keyframes without their margin, [E, 1, h, w(, 3)]; on a GPU [E, 1, h, w] of float32 or vec3.

        message: one of them. image: theirs, [E, H, W(, 3)].
        """
        from nodes.interpolator.luminance import as_frame, luminance_of

        m, colour = message.margin, self._colour
        if colour and image.ndim == 3 and message.radiance is None:
            raise ValueError(f"{self._name}: keyframes carry luminance, colour needs their radiance (keyframes:=rgb)")
        if self._device.is_cpu:
            image = image if colour else luminance_of(image).numpy()
            return image[:, None, m : image.shape[1] - m, m : image.shape[2] - m]
        return as_frame(image, m, colour, self._device)

    def _of_frames(self, message: Frames | Samples) -> Any:
        image = message.rgb if self._colour else message.luminance
        if image is None:
            want, have = ("rgb", "luminance") if self._colour else ("luminance", "rgb")
            raise ValueError(
                f"{self._name}: frames carry {have}, the sensor needs {want}; set colour alike on both nodes"
            )
        return image
