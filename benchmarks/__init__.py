"""Measurements of this code against plain alternatives, both in the same run."""
