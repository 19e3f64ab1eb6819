"""Common ground of all rooms: errors, clocks, files, plug-ins."""
