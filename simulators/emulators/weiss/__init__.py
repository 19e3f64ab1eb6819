"""Weiss or Vötsch chamber controller: SimServ and ASCII-2 on one port, the climate on a plant."""

from simulators.emulators.weiss._emulator import WeissEmulator

__all__ = ["WeissEmulator"]
