"""The source report's figures, measured now from the bundled FMUs: `workbench reproduce`.

Targets and tolerances stand in `targets.toml`, once; what measures them in one file for each chapter.
"""

from workbench.reproduce.targets import Target, read_targets

__all__ = ["Target", "read_targets"]
