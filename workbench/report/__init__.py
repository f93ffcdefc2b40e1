"""Reports: one self-contained page for a result."""

from workbench.report.page import Page, Section, Table, write_page

__all__ = ["Page", "Section", "Table", "write_page"]
