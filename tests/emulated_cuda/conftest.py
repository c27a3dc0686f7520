"""The emulated device in the process of the tests, without Warp and torch."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Iterator

import pytest

from tests.emulated_cuda import device as device_module
from tests.emulated_cuda.device import Device
from tests.emulated_cuda.settings import Check, Settings, StreamOrder, is_on, why_unavailable
from tests.emulated_cuda.small_ptx import PtxRunner


@pytest.fixture(scope="session")
def only_device() -> Device:
    """The device of this process, of which there can be one."""
    reason = why_unavailable()
    if reason:
        pytest.skip(reason)
    settings = Settings.from_environment()
    if is_on():
        if settings.check is not Check.RACE:
            pytest.skip(
                "this process has the emulated device, which does not check races: set EMULATED_CUDA_CHECK=race"
            )
        return device_module.device()
    return Device(dataclasses.replace(settings, check=Check.RACE, report=False))


@pytest.fixture
def emulated(only_device: Device) -> Iterator[Device]:
    """The device without faults, races and pending work, its streams in natural order."""
    only_device.faults.clear()
    only_device.faults.violations.clear()
    only_device.faults.printing = False
    only_device.runtime.emu_clear_races()
    only_device.seed = 0
    yield only_device
    only_device.faults.clear()
    only_device.streams.captures.clear()
    only_device.streams.finish_all()
    only_device.streams.order = StreamOrder.EAGER


@pytest.fixture
def ptx(emulated: Device) -> PtxRunner:
    """Runs small PTX texts."""
    return PtxRunner(emulated)


@pytest.fixture
def lazy(emulated: Device) -> Device:
    """The device, of which streams run as late as they may."""
    emulated.streams.order = StreamOrder.LAZY
    emulated.streams.rng = random.Random(3)
    return emulated
