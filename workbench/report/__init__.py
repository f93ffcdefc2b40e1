"""Reports: one self-contained page for a result."""

from workbench.report.page import Page, Section, Table, write_page
from workbench.report.tones import Verdict

__all__ = ["Page", "Section", "Table", "Verdict", "write_page"]
