"""An emulated lab: ports, emulators and plant in a process of its own, driven by a virtual or the wall clock."""
