"""The command line `gyrobench`. Commands import what they need when they run, so that `--help` is quick."""

from bench.present.cli._app import main

__all__ = ["main"]
