"""Drives the cameras on Treuzell boards: finds which sensor sits on the board, and sets up that one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from nodes.camera.interface.driver import DeviceInfo
from nodes.camera.interface.settings import Configuration
from nodes.camera.treuzell import gen31, genx320, imx636
from nodes.camera.treuzell.protocol import CONTROL_IN, CONTROL_OUT, DATA_IN, Board, TreuzellError
from nodes.camera.treuzell.sensor import Registers, sequences
from nodes.camera.usb.access import UNSUPPORTED, claim, drain, label, string_descriptor
from nodes.camera.usb.driver import UsbDriver
from nodes.camera.usb.models import CYPRESS, MODELS, Model

OLDEST = (3, 8, 0)
"""Firmware release of the EVK3 and EVK4 boards below which the register access differs."""
ALTERNATE_FROM = 0x0307
"""bcdDevice of those boards from which the interface has an alternate setting to select."""


@dataclass(frozen=True)
class Sensor:
    """Describes a sensor family to the driver."""

    name: str
    compatible: tuple[str, ...]
    settings: type[Configuration]
    check: Callable[[Registers], None] | None
    apply: Callable[[Registers, Any, Any], None]
    check_settings: Callable[[Registers, Any], None] | None = None
    temperature: Callable[[Registers], float | None] | None = None


SENSORS = (
    Sensor("gen31", ("psee,ccam5_fpga",), gen31.Gen31Settings, gen31.check_chip, gen31.apply),
    Sensor("gen41", ("psee,ccam5_gen41",), imx636.Gen41Settings, imx636.check_gen41, imx636.apply_gen41),
    Sensor(
        "imx636",
        ("psee,ccam5_imx636", "psee,ccam5_gen42"),
        imx636.Imx636Settings,
        imx636.check_chip,
        imx636.apply,
        imx636.check_codes,
        imx636.temperature_c,
    ),
    Sensor("genx320", ("psee,cx3_saphir", "psee,cx3_genx320"), genx320.GenX320Settings, None, genx320.apply),
)
_EVK3 = {"gen31": "evk3_gen31", "gen41": "evk3_gen41", "genx320": "evk3_genx320"}


class Camera(UsbDriver):
    """Drives a board with a Prophesee sensor.

    Opening puts the sensor through stop, destroy and init; closing through stop and destroy.
    """

    ENDPOINT: ClassVar[int] = DATA_IN

    def _connect(self) -> DeviceInfo:
        self._claim()
        board = Board(self.device)
        serial, release = board.serial(), board.release()
        product = string_descriptor(self.device, self.device.iProduct)
        version = ".".join(str(n) for n in release)
        if self.device.idVendor == CYPRESS and release < OLDEST:
            raise OSError(
                f"{self.name}: unknown firmware {version}; 3.8.0 or later is needed: update it with the maker's tool"
            )
        compatible = board.compatible()
        self._sensor, index = self._find_sensor(compatible)
        self.model = self._model_of_board(product)
        self.registers = Registers(board, index, self.bus.sleep)
        if self._sensor.check is not None:
            try:
                self._sensor.check(self.registers)
            except TreuzellError as e:
                raise OSError(f"{self.name}: {e}; {UNSUPPORTED}") from None
        self._lists = sequences(self._name_of_start_lists())
        details = {
            "firmware": version,
            "product": product,
            "usb": label(self.device),
            "compatible": [" ".join(strings) for strings in compatible],
        }
        return self.model.device_info(serial, details)

    def _initialise(self) -> None:
        self._run("stop", "destroy", "init")

    def _claim(self) -> None:
        """Claims the board's interface: the first one with bulk endpoints IN, OUT, IN. Raises OSError."""
        for interface in self.device.get_active_configuration():
            addresses = [e.bEndpointAddress for e in interface]
            if sorted(addresses) == sorted((CONTROL_IN, CONTROL_OUT, DATA_IN)) and interface.bInterfaceProtocol == 0:
                alternate = self.device.idVendor != CYPRESS or self.device.bcdDevice >= ALTERNATE_FROM
                claim(self.device, interface.bInterfaceNumber, alternate)
                return
        raise OSError(f"{self.name}: no interface with the endpoints of a Treuzell board; {UNSUPPORTED}")

    def _find_sensor(self, compatible: list[list[str]]) -> tuple[Sensor, int]:
        """Finds the sensor that the board's compatible strings name, and its sub-device. Raises OSError."""
        for index, strings in enumerate(compatible):
            for sensor in SENSORS:
                if set(strings) & set(sensor.compatible):
                    return sensor, index
        found = ", ".join(s for strings in compatible for s in strings) or "none"
        known = ", ".join(s for sensor in SENSORS for s in sensor.compatible)
        raise OSError(f"{self.name}: unknown sensor ({found}); known are {known}; {UNSUPPORTED}")

    def _model_of_board(self, product: str) -> Model:
        """Finds the model of an EVK board by its sensor, and by the product's name for the IMX636: all share their USB
        ids."""
        if self.device.idVendor != CYPRESS:
            return self.model
        if self._sensor.name == "imx636":
            return MODELS["evk3_imx636" if "EVK3" in product.upper() else "evk4"]
        return MODELS[_EVK3[self._sensor.name]]

    def _name_of_start_lists(self) -> str:
        """Returns the name of the sensor's start lists, of which the GenX320 has one per chip revision."""
        if self._sensor.name != "genx320":
            return self._sensor.name
        return "genx320es" if self.registers.read(0x14) == genx320.ES_CHIP else "genx320mp"

    def _run(self, *phases: str) -> None:
        for phase in phases:
            self.registers.run(self._lists[phase])

    def settings_type(self) -> type[Configuration]:
        return self._sensor.settings if self._info is not None else self.SETTINGS

    def _check(self, settings: Any) -> None:
        if self._sensor.check_settings is not None:
            self._sensor.check_settings(self.registers, settings)

    def _apply(self, settings: Any) -> None:
        self.registers.legacy = getattr(settings, "legacy_writes", False)
        self._sensor.apply(self.registers, settings, self._applied)

    def _change(self, settings: Any, before: Any) -> None:
        self._sensor.apply(self.registers, settings, before)

    def _begin(self) -> None:
        drain(self.device, DATA_IN, 1 << 16)
        self._run("start")

    def _end(self) -> None:
        self._run("stop")

    def _disconnect(self) -> None:
        self._run("stop", "destroy")

    def temperature_c(self) -> float | None:
        return self._sensor.temperature(self.registers) if self._sensor.temperature is not None else None
