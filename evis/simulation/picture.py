"""Draws a picture of a step: its events over the light that the camera sees, as the live page draws them."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.media.colour import srgb_from_linear
from evis.media.pictures.event_pictures import ON_BLACK
from evis.scene.digest import appearance
from evis.scene.model import Scene
from msgs.camera import EventPacket

DIMMED = 0.55
"""How bright the light is drawn under the events."""
BRIGHTEST = 99.0
"""Percentile of the luminance that is drawn as white."""


def events_over_light(luminance: np.ndarray, packet: EventPacket | None, env: int = 0) -> np.ndarray:
    """Draws the last event of each pixel over a dimmed image, uint8 [H, W, 3].

    luminance: float [H, W], linear. packet: events of all environments, numpy's; None = no events. env: which one.
    """
    white = float(np.percentile(luminance, BRIGHTEST)) or 1.0
    grey = DIMMED * srgb_from_linear(np.clip(luminance / white, 0, 1))
    picture: np.ndarray = np.round(255 * np.repeat(grey[..., None], 3, axis=2)).astype(np.uint8)
    if packet is not None and packet.t is not None:
        part = slice(int(packet.env_offsets[env]), int(packet.env_offsets[env + 1]))
        x, y, p = (np.asarray(getattr(packet, name))[part] for name in "xyp")
        # Where a pixel has several events numpy keeps the last one assigned, the newest.
        picture[y, x] = np.array([ON_BLACK.off, ON_BLACK.on], np.uint8)[p]
    return picture


def as_html(pictures: Mapping[str, np.ndarray], title: str) -> str:
    """Writes pictures by camera as HTML with the pixels in it, so that a notebook keeps them."""
    parts = []
    for camera, picture in pictures.items():
        data = base64.b64encode(as_png(picture)).decode()
        height, width = picture.shape[:2]
        scale = max(1, 480 // width)
        parts.append(
            f'<figure style="display:inline-block;margin:0 8px 0 0"><img alt="events of {camera}" '
            f'width="{scale * width}" height="{scale * height}" style="image-rendering:pixelated" '
            f'src="data:image/png;base64,{data}"><figcaption>{camera}</figcaption></figure>'
        )
    return f"<div><div>{title}</div>{''.join(parts)}</div>"


def as_png(picture: np.ndarray) -> bytes:
    """Encodes uint8 [H, W, 3] as a PNG file."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(picture).save(out, "PNG", compress_level=1)
    return out.getvalue()


class Viewer:
    """Draws the light that a camera sees, with a renderer of its own, made when a picture is first asked for."""

    def __init__(self, scene: Scene, params: Mapping[str, Any]) -> None:
        """Makes what draws a camera's pictures. params: of the graph's renderer node of that camera."""
        from nodes.renderer.parameters import light_options
        from nodes.renderer.renderer import Renderer

        self._scene, camera = scene, scene.camera(params["camera"])
        self._renderer = Renderer(scene, camera, device=params["device"], **light_options(params))

    def suits(self, scene: Scene) -> bool:
        """Tells whether a scene looks as the one that it draws, but for where its bodies are."""
        return scene is self._scene or appearance(scene) == appearance(self._scene)

    def luminance(self, poses: np.ndarray, t_ns: int) -> np.ndarray:
        """Renders luminance float32 [H, W] for body poses float64 [1, N, 7] at a time [ns]."""
        image: np.ndarray = self._renderer.render(poses, outputs=("luminance",), t_ns=t_ns)["luminance"][0]
        return image
