"""Models: what an analysis sees. Names are loaded when they are first used, so that a recipe is quick to import."""

from workbench.core.records.lazy import lazily

__getattr__, __dir__ = lazily(__name__, __file__)
