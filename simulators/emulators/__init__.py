"""Emulated devices: the bytes each device family puts on its port, asking a plant for the physics."""
