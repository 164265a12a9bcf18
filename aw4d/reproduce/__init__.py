"""The paper's tables: what it prints, what this run has, what its own numbers contradict."""

from aw4d.reproduce.report import Report, tables
from aw4d.reproduce.results import read_results
from aw4d.reproduce.show import reproduce_tables, show, to_json

__all__ = ["Report", "read_results", "reproduce_tables", "show", "tables", "to_json"]
