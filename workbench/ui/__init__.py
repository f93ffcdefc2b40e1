"""The browser workbench: requests as forms, jobs as live pictures, records as pages; no analysis of its own."""
