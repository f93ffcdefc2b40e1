"""Assignments that are the same but for their indices and numbers, which become loops in C.

Arrays and loops of the source are gone by now; what is alike is found in the scalar expressions themselves, so that
arrays of components become loops, too. Each pass of a loop does the operations of its assignment in their order: the
numbers are the same as without loops.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Sequence

from workbench.build.expressions import ExpressionGraph

__all__ = ["LEAST", "Shapes", "alike_together"]

LEAST = 100  # so many assignments that are alike become a loop
# Parts that several assignments share are computed once without loops; so many times the operations are no loss.
_MOST_REPEATED = 2.0

# The operation of each node and the places of its operands, in an order of evaluation.
Shape = tuple[tuple[str, tuple[int, ...]], ...]


class Shapes:
    """What expressions are apart from their indices and numbers.

    Args:
        graph: where the expressions live.
    """

    def __init__(self, graph: ExpressionGraph) -> None:
        self.graph = graph
        self._numbers: dict[Shape, int] = {}
        self._known: dict[int, tuple[int, tuple[int, ...]]] = {}

    def of(self, expression: int) -> int:
        """Return the number of the expression's shape; the same number: alike."""
        return self._look(expression)[0]

    def nodes(self, expression: int) -> tuple[int, ...]:
        """Return the nodes of the expression; those of expressions that are alike correspond place by place."""
        return self._look(expression)[1]

    def _look(self, expression: int) -> tuple[int, tuple[int, ...]]:
        result = self._known.get(expression)
        if result is None:
            shape, nodes = _outline(self.graph, expression)
            result = self._known[expression] = self._numbers.setdefault(shape, len(self._numbers)), nodes
        return result

    def runs(self, expressions: Sequence[int | None]) -> Iterator[tuple[range, bool]]:
        """Yield neighbours: their places, and whether they make a loop.

        Args:
            expressions: in the order of their evaluation; None stands for what is not in any loop.
        """
        first = 0
        while first < len(expressions):
            stop = self._stop(expressions, first)
            loop = stop - first >= LEAST and self._pays([e for e in expressions[first:stop] if e is not None])
            yield range(first, stop), loop
            first = stop

    def _stop(self, expressions: Sequence[int | None], first: int) -> int:
        """Return the end of the run that begins at the place `first`."""
        stop, begin = first + 1, expressions[first]
        if begin is None or len(expressions) - first < LEAST:
            return stop
        shape = self.of(begin)
        while stop < len(expressions):
            expression = expressions[stop]
            if expression is None or self.of(expression) != shape:
                break
            stop += 1
        return stop

    def _pays(self, expressions: Sequence[int]) -> bool:
        """Return whether a loop over all of them does not repeat many operations that they share."""
        columns = zip(*(self.nodes(e) for e in expressions), strict=True)
        moving = [n for column in columns if len(set(column)) > 1 for n in column if self.graph[n].operands]
        return len(moving) <= _MOST_REPEATED * len(set(moving))


def _outline(graph: ExpressionGraph, expression: int) -> tuple[Shape, tuple[int, ...]]:
    places: dict[int, int] = {}
    parts: list[tuple[str, tuple[int, ...]]] = []
    stack = [expression]
    while stack:
        node = graph[stack[-1]]
        waiting = [o for o in node.operands if o not in places]
        if waiting and stack[-1] not in places:
            stack.extend(reversed(waiting))
            continue
        number = stack.pop()
        if number not in places:
            places[number] = len(places)
            parts.append((node.operation, tuple(places[o] for o in node.operands)))
    return tuple(parts), tuple(places)


def alike_together(
    graph: ExpressionGraph, expressions: Sequence[int | None], order: Sequence[int], needs: Sequence[Sequence[int]]
) -> list[int]:
    """Return an order of evaluation in which steps that are alike are neighbours, where there are many such.

    Args:
        graph: where the expressions live.
        expressions: of each step; None stands for what is not in any loop.
        order: all steps, in an order of evaluation.
        needs: the steps that each step needs.
    """
    if len(order) < LEAST:
        return list(order)
    shapes = Shapes(graph)
    # Copies need no order of their own: they stay as they are, and make loops where they are neighbours.
    kinds = [None if e is None or not graph[e].operands else shapes.of(e) for e in expressions]
    often = {kind for kind, count in Counter(kinds).items() if kind is not None and count >= LEAST}
    if not often:
        return list(order)
    return _scheduled([kind if kind in often else None for kind in kinds], order, needs)


def _scheduled(kinds: Sequence[int | None], order: Sequence[int], needs: Sequence[Sequence[int]]) -> list[int]:
    """Return the steps in an order of evaluation: of one kind as long as there are any that can be done."""
    missing = [len(set(needed)) for needed in needs]
    needed_by: list[list[int]] = [[] for _ in needs]
    for step, needed in enumerate(needs):
        for other in set(needed):
            needed_by[other].append(step)
    ready: dict[int | None, deque[int]] = {kind: deque() for kind in (None, *kinds)}
    for step in order:
        if not missing[step]:
            ready[kinds[step]].append(step)
    done: list[int] = []
    kind: int | None = None
    while len(done) < len(order):
        if not ready[kind]:
            # What is alone comes first: it may be what others wait for.
            kind = None if ready[None] else max(ready, key=lambda k: len(ready[k]))
        step = ready[kind].popleft()
        done.append(step)
        for user in needed_by[step]:
            missing[user] -= 1
            if not missing[user]:
                ready[kinds[user]].append(user)
    return done
