"""Implements a pyusb backend whose bus has emulated devices on it."""

from __future__ import annotations

import errno
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

from nodes.camera.emulated.device import EmulatedDevice


class EmulatedBackend(usb.backend.IBackend):
    """Replaces libusb below pyusb, for devices made of Python."""

    def __init__(self, *devices: EmulatedDevice) -> None:
        self.devices = list(devices)

    def enumerate_devices(self) -> list[EmulatedDevice]:
        return [d for d in self.devices if d.present()]

    def get_parent(self, dev: EmulatedDevice) -> None:
        return None

    def get_device_descriptor(self, dev: EmulatedDevice) -> Any:
        d = dev.identity
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x0300,
            bDeviceClass=0xFF,
            bDeviceSubClass=d.subclass,
            bDeviceProtocol=0,
            bMaxPacketSize0=9,
            idVendor=d.vendor,
            idProduct=d.product,
            bcdDevice=d.bcd_device,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3 if d.serial else 0,
            bNumConfigurations=1,
            address=dev.address,
            bus=1,
            port_number=dev.address,
            port_numbers=(dev.address,),
            speed=4,
        )

    def get_configuration_descriptor(self, dev: EmulatedDevice, config: int) -> Any:
        if config:
            raise IndexError
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=18 + 7 * len(dev.identity.endpoints),
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=100,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: EmulatedDevice, intf: int, alt: int, config: int) -> Any:
        if intf or alt or config:
            raise IndexError
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=len(dev.identity.endpoints),
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0x19,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(self, dev: EmulatedDevice, ep: int, intf: int, alt: int, config: int) -> Any:
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=dev.identity.endpoints[ep],
            bmAttributes=3 if dev.identity.endpoints[ep] in dev.identity.interrupt else 2,
            wMaxPacketSize=1024,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, dev: EmulatedDevice) -> EmulatedDevice:
        dev.check_present()
        if dev.faults.no_permission:
            raise usb.core.USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        return dev

    def close_device(self, dev_handle: EmulatedDevice) -> None:
        dev_handle.claimed = False

    def set_configuration(self, dev_handle: EmulatedDevice, config_value: int) -> None:
        dev_handle.check_present()

    def get_configuration(self, dev_handle: EmulatedDevice) -> int:
        dev_handle.check_present()
        return 1

    def set_interface_altsetting(self, dev_handle: EmulatedDevice, intf: int, altsetting: int) -> None:
        dev_handle.check_claimed()

    def claim_interface(self, dev_handle: EmulatedDevice, intf: int) -> None:
        dev_handle.check_present()
        if dev_handle.faults.busy:
            raise usb.core.USBError("Resource busy", -6, errno.EBUSY)
        dev_handle.claimed = True

    def release_interface(self, dev_handle: EmulatedDevice, intf: int) -> None:
        dev_handle.claimed = False

    def bulk_write(self, dev_handle: EmulatedDevice, ep: int, intf: int, data: Any, timeout: int) -> int:
        dev_handle.check_claimed()
        return dev_handle.bulk_out(ep, bytes(data))

    def bulk_read(self, dev_handle: EmulatedDevice, ep: int, intf: int, buff: Any, timeout: int) -> int:
        dev_handle.check_claimed()
        return dev_handle.bulk_in(ep, buff, timeout / 1000)

    def intr_read(self, dev_handle: EmulatedDevice, ep: int, intf: int, buff: Any, timeout: int) -> int:
        return self.bulk_read(dev_handle, ep, intf, buff, timeout)

    def ctrl_transfer(
        self,
        dev_handle: EmulatedDevice,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        dev_handle.check_present()
        if not bmRequestType & 0x80:
            return dev_handle.request_out(bmRequestType, bRequest, wValue, wIndex, bytes(data))
        answer = dev_handle.request_in(bmRequestType, bRequest, wValue, wIndex)[: len(data)]
        memoryview(data).cast("B")[: len(answer)] = answer
        return len(answer)

    def clear_halt(self, dev_handle: EmulatedDevice, ep: int) -> None:
        dev_handle.check_present()
        dev_handle.halted.discard(ep)

    def reset_device(self, dev_handle: EmulatedDevice) -> None:
        dev_handle.check_present()

    def is_kernel_driver_active(self, dev_handle: EmulatedDevice, intf: int) -> bool:
        return False
