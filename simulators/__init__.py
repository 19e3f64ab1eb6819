"""The emulated lab: emulators that speak the devices' bytes, and the plant whose physics they report."""
