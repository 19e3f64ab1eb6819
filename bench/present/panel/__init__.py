"""The live panel: a process of its own that reads what a session writes anyway and drops answers and requests.

It opens nothing of the bench for writing but the two folders that docs/events.md names: a panel that dies or
hangs cannot touch a run, and any number of them may be open.
"""

from bench.present.panel._server import serve
from bench.present.panel._settings import PanelSettings

__all__ = ["PanelSettings", "serve"]
