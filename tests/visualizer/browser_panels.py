"""What tests of the page look at in a browser: canvases of panels, as soon as something is on them."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image

LIMIT_S = 60.0
"""For all that a page or a browser is waited for: far more than a loaded machine needs, only what hangs takes it."""


def pixels(tab: Any, topic: str) -> np.ndarray:
    """The canvas of a panel as it is now, [H, W, 3]."""
    data = tab.locator(f'[data-panel="{topic}"] canvas').first.evaluate("c => c.toDataURL('image/png').split(',')[1]")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)


def wait_for_picture(tab: Any, topic: str) -> None:
    """Until a panel is there and has drawn something."""
    waiting = tab.locator(f'[data-panel="{topic}"] .waiting')
    waiting.wait_for(state="attached")  # "hidden" is also what is not there yet
    waiting.wait_for(state="hidden")


def until(tab: Any, condition: Callable[[], Any], what: str) -> Any:
    """Wait for `condition`, and give what it gave. A page draws when it can: no single picture is due at any time."""
    deadline = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not in {LIMIT_S:g} s: {what}"
        tab.wait_for_timeout(50)
    return value
