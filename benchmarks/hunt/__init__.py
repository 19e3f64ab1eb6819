"""Bench hours to the right answer: a search against fixed orders, random choice and repeated suggestions.

`python -m benchmarks.hunt` draws blind units of several plant families and lets each strategy search for what
they have. `search`, `order`, `bytes`, `kill` and `table` are its parts; docs/hunt.md has the table.
"""
