"""The bench controller: sessions, recording, fitting, reports. Importing it loads neither torch nor pandas."""

__version__ = "0.2.0"
