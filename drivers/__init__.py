"""Instrument drivers and their codecs: bytes on a port on one side, values with units on the other."""
