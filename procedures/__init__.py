"""Test procedures, one file a test, readable beside the test standard."""
