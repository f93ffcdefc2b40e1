"""The source report's figures, measured now from the bundled FMUs: `python scripts/dev.py reproduce`.

Targets and tolerances stand in `targets.toml`, once; what measures them in a file for each chapter, found through
`registry`. Nothing there knows a target's number. Names are loaded when they are first used: a
test that reads a target need not load what measures it.
"""

from workbench.core.records.lazy import lazily

__getattr__, __dir__ = lazily(__name__, __file__)
