"""Lists the USB cameras: their ids on the bus, their encoding, and the module of their driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from evis.config.suggestions import did_you_mean
from nodes.camera.interface.driver import DeviceInfo

CYPRESS, CENTURYARKS, INIVATION = 0x04B4, 0x31F7, 0x152A


@dataclass(frozen=True)
class Model:
    """Describes a camera model.

    `ids`: (vendor, product) pairs on USB; several models may share one and differ in what they answer.

    driver: dotted module with `Camera`; emulator: dotted module with `make_device`. sensor: name for people.
    """

    name: str
    title: str
    ids: tuple[tuple[int, int], ...]
    sensor: str
    width: int
    height: int
    encoding: str
    driver: str
    emulator: str

    def device_info(self, serial: str, details: dict[str, Any]) -> DeviceInfo:
        """Makes the identity of one camera of this model, whose clock is named after its serial number."""
        size = (self.width, self.height)
        return DeviceInfo(self.name, serial, self.sensor, *size, self.encoding, f"device:{serial}", details)


_TREUZELL = ("nodes.camera.treuzell.camera", "nodes.camera.emulated.treuzell")
_DAVIS = ("nodes.camera.inivation.davis346", "nodes.camera.emulated.fx3")
_DVX = ("nodes.camera.inivation.dvxplorer", "nodes.camera.emulated.fx3")
_DVS128 = ("nodes.camera.inivation.dvs128", "nodes.camera.emulated.dvs128")
_EVK_IDS = ((CYPRESS, 0x00F5), (CYPRESS, 0x00F4))
_SILKY_IDS, _SILKY_HD_IDS = ((CENTURYARKS, 0x0002),), ((CENTURYARKS, 0x0003),)
_DAVIS_IDS = ((INIVATION, 0x841A), (INIVATION, 0x841B))
_DVX_IDS, _DVS128_IDS = ((INIVATION, 0x8419),), ((INIVATION, 0x8400),)

MODELS: dict[str, Model] = {
    m.name: m
    for m in (
        Model("evk4", "Prophesee EVK4", _EVK_IDS, "IMX636", 1280, 720, "evt3", *_TREUZELL),
        Model("evk3_imx636", "Prophesee EVK3 HD", _EVK_IDS, "IMX636", 1280, 720, "evt3", *_TREUZELL),
        Model("evk3_gen41", "Prophesee EVK3 Gen4.1", _EVK_IDS, "Gen4.1", 1280, 720, "evt3", *_TREUZELL),
        Model("evk3_gen31", "Prophesee EVK3 Gen3.1", _EVK_IDS, "Gen3.1", 640, 480, "evt3", *_TREUZELL),
        Model("evk3_genx320", "Prophesee EVK3 GenX320", _EVK_IDS, "GenX320", 320, 320, "evt21", *_TREUZELL),
        Model("silkyevcam", "CenturyArks SilkyEvCam VGA", _SILKY_IDS, "Gen3.1", 640, 480, "evt3", *_TREUZELL),
        Model("silkyevcam_hd", "CenturyArks SilkyEvCam HD", _SILKY_HD_IDS, "IMX636", 1280, 720, "evt3", *_TREUZELL),
        Model("davis346", "iniVation DAVIS346", _DAVIS_IDS, "DAVIS346", 346, 260, "davis346", *_DAVIS),
        Model("dvxplorer", "iniVation DVXplorer", _DVX_IDS, "DVXplorer", 640, 480, "dvxplorer", *_DVX),
        Model("dvxplorer_lite", "iniVation DVXplorer Lite", _DVX_IDS, "DVXplorer Lite", 320, 240, "dvxplorer", *_DVX),
        Model("dvxplorer_mini", "iniVation DVXplorer Mini", _DVX_IDS, "DVXplorer", 640, 480, "dvxplorer_mini", *_DVX),
        Model("dvxplorer_micro", "iniVation DVXplorer Micro", _DVX_IDS, "DVXplorer", 640, 480, "dvxplorer_mini", *_DVX),
        Model("dvs128", "iniVation DVS128", _DVS128_IDS, "DVS128", 128, 128, "dvs128", *_DVS128),
    )
}
ALIASES = {"evk3": "evk3_imx636", "silkyevcam_vga": "silkyevcam"}


def model_named(name: str) -> Model:
    """Finds a model by its name or alias. Raises ValueError with the nearest name."""
    key = name.strip().lower().replace("-", "_")
    key = ALIASES.get(key, key)
    if key not in MODELS:
        hint = did_you_mean(key, [*MODELS, *ALIASES])
        raise ValueError(f"no camera model '{name}'{hint} (models: {', '.join(MODELS)})")
    return MODELS[key]
