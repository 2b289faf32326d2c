"""Lists the USB cameras: their ids on the bus, what they send, which driver they need."""

from __future__ import annotations

from dataclasses import dataclass

from evis.config.suggestions import did_you_mean

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


_TREUZELL = ("nodes.camera.treuzell.camera", "nodes.camera.emulated.treuzell")
_DAVIS = ("nodes.camera.inivation.davis346", "nodes.camera.emulated.fx3")
_DVX = ("nodes.camera.inivation.dvxplorer", "nodes.camera.emulated.fx3")
_EVK = ((CYPRESS, 0x00F5), (CYPRESS, 0x00F4))

MODELS: dict[str, Model] = {
    m.name: m
    for m in (
        Model("evk4", "Prophesee EVK4", _EVK, "IMX636", 1280, 720, "evt3", *_TREUZELL),
        Model("evk3_imx636", "Prophesee EVK3 HD", _EVK, "IMX636", 1280, 720, "evt3", *_TREUZELL),
        Model("evk3_gen41", "Prophesee EVK3 Gen4.1", _EVK, "Gen4.1", 1280, 720, "evt3", *_TREUZELL),
        Model("evk3_gen31", "Prophesee EVK3 Gen3.1", _EVK, "Gen3.1", 640, 480, "evt3", *_TREUZELL),
        Model("evk3_genx320", "Prophesee EVK3 GenX320", _EVK, "GenX320", 320, 320, "evt21", *_TREUZELL),
        Model(
            "silkyevcam", "CenturyArks SilkyEvCam VGA", ((CENTURYARKS, 0x0002),), "Gen3.1", 640, 480, "evt3", *_TREUZELL
        ),
        Model(
            "silkyevcam_hd",
            "CenturyArks SilkyEvCam HD",
            ((CENTURYARKS, 0x0003),),
            "IMX636",
            1280,
            720,
            "evt3",
            *_TREUZELL,
        ),
        Model(
            "davis346",
            "iniVation DAVIS346",
            ((INIVATION, 0x841A), (INIVATION, 0x841B)),
            "DAVIS346",
            346,
            260,
            "davis346",
            *_DAVIS,
        ),
        Model("dvxplorer", "iniVation DVXplorer", ((INIVATION, 0x8419),), "DVXplorer", 640, 480, "dvxplorer", *_DVX),
        Model(
            "dvxplorer_lite",
            "iniVation DVXplorer Lite",
            ((INIVATION, 0x8419),),
            "DVXplorer Lite",
            320,
            240,
            "dvxplorer",
            *_DVX,
        ),
        Model(
            "dvxplorer_mini",
            "iniVation DVXplorer Mini",
            ((INIVATION, 0x8419),),
            "DVXplorer",
            640,
            480,
            "dvxplorer_mini",
            *_DVX,
        ),
        Model(
            "dvxplorer_micro",
            "iniVation DVXplorer Micro",
            ((INIVATION, 0x8419),),
            "DVXplorer",
            640,
            480,
            "dvxplorer_mini",
            *_DVX,
        ),
        Model(
            "dvs128",
            "iniVation DVS128",
            ((INIVATION, 0x8400),),
            "DVS128",
            128,
            128,
            "dvs128",
            "nodes.camera.inivation.dvs128",
            "nodes.camera.emulated.dvs128",
        ),
    )
}
ALIASES = {"evk3": "evk3_imx636", "silkyevcam_vga": "silkyevcam"}


def model_named(name: str) -> Model:
    """Finds a model of the table. Raises ValueError with the nearest name."""
    key = name.strip().lower().replace("-", "_")
    key = ALIASES.get(key, key)
    if key not in MODELS:
        hint = did_you_mean(key, [*MODELS, *ALIASES])
        raise ValueError(f"no camera model '{name}'{hint} (models: {', '.join(MODELS)})")
    return MODELS[key]
