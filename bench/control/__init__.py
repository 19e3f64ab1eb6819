"""A run while it goes: session, stations, limits, safe state, watchdog, live files."""
