"""Writes udev rules that let users open the cameras without being root."""

from __future__ import annotations

from nodes.camera.usb.access import RULES_FILE
from nodes.camera.usb.models import MODELS


def rules() -> str:
    """Writes the text of the rules file: one line per (vendor, product), for the user at the seat and the group
    plugdev."""
    titles: dict[tuple[int, int], list[str]] = {}
    for model in MODELS.values():
        for ids in model.ids:
            titles.setdefault(ids, []).append(model.title)
    lines = [
        "# Event cameras on USB. Put this file in its place and let udev read it:",
        f"#   evis camera udev | sudo tee {RULES_FILE}",
        "#   sudo udevadm control --reload && sudo udevadm trigger",
    ]
    for (vendor, product), names in titles.items():
        match = f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}"'
        lines += [f"# {', '.join(names)}", f'{match}, MODE="0660", GROUP="plugdev", TAG+="uaccess"']
    return "\n".join(lines) + "\n"
