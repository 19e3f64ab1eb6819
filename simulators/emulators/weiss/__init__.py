"""Weiss or Vötsch chamber controller: SimServ and ASCII-2 on one port, the climate on a plant."""

from drivers.weiss import WeissConfig
from simulators.emulators.weiss._emulator import WeissEmulator
from simulators.interfaces import Installation
from simulators.plant.lab_chamber import LabChamber

__all__ = ["WeissEmulator", "emulator"]


def emulator(config: WeissConfig, plant: LabChamber, installed: Installation) -> WeissEmulator:
    """Make the emulator of a bench file's chamber."""
    return WeissEmulator(
        plant,
        address=config.bus_address,
        auxiliary=tuple(config.auxiliary),
        start_channel=config.start_channel,
    )
