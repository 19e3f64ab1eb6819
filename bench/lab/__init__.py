"""The emulated lab as a bench, and what tests need of it."""
