"""The catalogue of runs: a table of what lies in run folders, in SQLite or PostgreSQL; the folders are the truth.

Loading it takes a few milliseconds: a list of runs is mostly the start of a process.
"""

from bench.record.catalogue._catalogue import Catalogue, CatalogueRow, find_runs, index_runs, root_name

__all__ = ["Catalogue", "CatalogueRow", "find_runs", "index_runs", "root_name"]
