"""Where a result came from, and the page that every result can write of itself.

It stands beside `workbench.errors`: whatever makes results uses it, and it imports nothing of them. What it needs of
models and of reports is imported when it is used, in the way of `.plot()`.
"""

from workbench.origin.decorator import with_origin
from workbench.origin.facts import FmuFacts, ModelFacts, Origin
from workbench.origin.kept import origin_of, remember

__all__ = ["FmuFacts", "ModelFacts", "Origin", "origin_of", "remember", "with_origin"]
