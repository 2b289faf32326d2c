"""Makes the image views: radiance, luminance, camera images, depth, motion, ids, normals and the dense labels, as
JPEG or PNG."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from msgs.camera import Depth, Frames, Ids, Image, Keyframe, Labels, Motion, Normal, Samples
from msgs.header import Message
from nodes.visualizer import colour
from nodes.visualizer.views.part import TopicView

MAX_SIDE = 1280
"""A longer side is thinned out by a whole number before encoding [px]."""
MOST_EXACT = 1 << 16
"""Most pixels of a map of measured values that is sent without loss: a larger one takes too long and too many bytes."""
MAX_NAMED = 64
"""Instances and classes that a legend names, those with the most pixels; it says how many more there are."""


def compressed(image: np.ndarray, quality: int, colours: str) -> tuple[bytes, str]:
    """Compresses uint8 [H, W] or [H, W, 3] as JPEG of a quality or as PNG, and returns the format's name too.

    colours: of a `photograph`, `false` ones, which stand for values, or those of `names`, in even areas.
    """
    from PIL import Image as Pillow

    buffer, picture = io.BytesIO(), Pillow.fromarray(np.ascontiguousarray(image))
    # Around an edge JPEG shows motion where nothing moves, and a small thing in the colour of another.
    if colours == "names" or (colours == "false" and image.shape[0] * image.shape[1] <= MOST_EXACT):
        picture.save(buffer, "PNG", compress_level=1)
        return buffer.getvalue(), "png"
    chroma = {"subsampling": 0} if colours == "false" else {}  # false colours keep full chroma, or edges would bleed
    picture.save(buffer, "JPEG", quality=quality, **chroma)
    return buffer.getvalue(), "jpeg"


def crop(array: np.ndarray, margin: int) -> np.ndarray:
    """Copies [H, W, ...] without the over-render margin, thinned out to MAX_SIDE."""
    if margin > 0:
        array = array[margin : array.shape[0] - margin, margin : array.shape[1] - margin]
    step = -(-max(array.shape[:2]) // MAX_SIDE) if array.size else 1
    return np.array(array[::step, ::step])


def legend(ids: np.ndarray) -> dict[str, Any]:
    """Returns {"shown": [[id, colour]] of the largest by id, "more": count of the other ids}, without 0."""
    found, pixels = np.unique(ids, return_counts=True)
    found, pixels = found[found != 0], pixels[found != 0]
    largest = found[np.argsort(-pixels, kind="stable")]
    shown = [[int(i), colour.id_colour(int(i))] for i in np.sort(largest[:MAX_NAMED])]
    return {"shown": shown, "more": len(largest) - len(shown)}


class ImageView(TopicView):
    """Shows a dense map as a picture. `quality` is that of photographs as JPEG, 1-95."""

    KIND = "image"

    def __init__(self, name: str, env: int, quality: int = 80) -> None:
        super().__init__(name, env)
        self._quality = quality
        self._limits = colour.Smoothed()

    def pick(self, message: Message) -> dict[str, Any]:
        found = self._array(message)
        if found is None:
            return {"missing": f"no {self.name} in these labels; labels:={self.name} asks for it"}
        array, extra = found
        margin = getattr(message, "margin", 0)
        size = array.shape[1] - 2 * margin, array.shape[0] - 2 * margin
        return {"array": crop(array, margin), "size": size, **extra}

    def _array(self, message: Message) -> tuple[np.ndarray, dict[str, Any]] | None:
        """Returns [H, W(, C)] of this view's environment, and what else the page is told; None where the message has
        none."""
        match message:
            case Image():
                return message.data, {"encoding": message.encoding}
            case Frames() | Samples():
                last = message.rgb if message.rgb is not None else message.luminance
                return None if last is None else (self._of_env(last)[-1], {})
            case Keyframe():
                return self._of_env(message.image), {}
            case Depth():
                return self._of_env(message.depth), {}
            case Motion():
                return self._of_env(message.motion), {"unit": "px"}
            case Ids():
                return self._of_env(message.ids), {}
            case Normal():
                return self._of_env(message.normal), {}
            case Labels():
                dense = getattr(message, self.name)
                return None if dense is None else (self._of_env(dense), {"unit": "px/s"})
        raise TypeError(f"{type(message).__name__} is not an image")

    def _of_env(self, array: np.ndarray) -> np.ndarray:
        """Returns entry `env` of the leading axis; the last one where there are fewer environments."""
        return np.asarray(array)[min(self.env, len(array) - 1)]

    def draw(self, picked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        if "missing" in picked:
            return {"note": picked["missing"]}, b""
        width, height = picked["size"]
        meta: dict[str, Any] = {"width": width, "height": height}
        array = picked["array"]
        if array.size == 0:
            return {**meta, "note": "empty image"}, b""
        picture, colours = self._picture(array, picked, meta)
        payload, meta["format"] = compressed(picture, self._quality, colours)
        return meta, payload

    def _picture(self, array: np.ndarray, picked: dict[str, Any], meta: dict[str, Any]) -> tuple[np.ndarray, str]:
        bad, colours = 0, "false"
        if self.name == "depth":
            picture, near, far, bad = colour.depth_colours(array, self._limits)
            meta["legend"] = {"kind": "depth", "from": near, "to": far, "unit": "m"}
        elif self.name in ("motion", "flow"):
            picture, full, unknown = colour.flow_colours(array, self._limits)
            meta["legend"] = {"kind": "flow", "to": full, "unit": picked["unit"]}
            bad = unknown if self.name == "motion" else 0
        elif self.name == "semantic":
            picture, colours = colour.id_colours(array), "names"
            meta["classes"] = legend(array)
        elif self.name in ("ids", "segmentation"):
            picture, colours = colour.id_colours(array), "names"
            meta["instances"] = legend(array)
        elif self.name == "normal":
            picture, bad = colour.normal_colours(array)
        else:
            return self._photograph(array, picked.get("encoding", ""), meta), "photograph"
        if bad:
            meta["note"] = f"{bad} px not a number"
        return picture, colours

    def _photograph(self, array: np.ndarray, encoding: str, meta: dict[str, Any]) -> np.ndarray:
        if array.ndim == 3 and array.shape[-1] < 3:
            if array.shape[-1] == 2:
                meta["note"] = "channel 1 of 2"  # two channels stand for no colour
            array = array[..., 0]
        if array.ndim == 3:
            array = array[..., 2::-1] if encoding.startswith("bgr") else array[..., :3]
        if array.dtype == np.uint8:
            return array
        if array.dtype == np.uint16:
            return (array >> 8).astype(np.uint8)
        picture, bad = colour.tone_map(array, self._limits)
        if bad:
            meta["note"] = ", ".join([*([meta["note"]] if "note" in meta else []), f"{bad} px not finite"])
        return picture
