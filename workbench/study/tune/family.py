"""A linear model as a function of the parameters of blocks in it, with its derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from workbench.core.values.arrays import Complex, Floats
from workbench.core.values.linear import Linear, LinearPart
from workbench.core.values.margins import Margins
from workbench.errors import InputError
from workbench.loops.loop.margins import margins_of
from workbench.loops.loop.tunable import linear_block
from workbench.system.description import BlockComponent, Component, GainComponent

__all__ = ["LinearFamily", "Member"]

_WIDTH = 1e-5  # relative: of the differences by which the matrices of a block, simple functions, are differentiated


@dataclass(frozen=True, eq=False)
class Member:
    """A linear model at some values of the parameters.

    Attributes:
        system: the model.
        left, right: a change dK of the blocks' matrices changes M = [A B; C D] by left · dK · right.
        changes: one for each parameter: dK by its value; None: it is of no block.
        others: parameter → dM by its value, where it is of no block.
    """

    system: Linear
    left: Floats
    right: Floats
    changes: Mapping[str, Floats]
    others: Mapping[str, Floats]

    @cached_property
    def poles(self) -> tuple[Complex, Complex, Complex]:
        """Poles, shape (n,), left and right eigenvectors in columns, scaled so that yᴴx = 1."""
        from scipy.linalg import eig  # noqa: PLC0415 - slow to import

        if not len(self.system.A):
            none = np.zeros((0, 0), dtype=np.complex128)
            return none[0:0].reshape(0), none, none
        values, left, right = eig(self.system.A, left=True, right=True)
        return values, left / np.conj(np.sum(left.conj() * right, axis=0)), right

    @cached_property
    def margins(self) -> Margins:
        """Crossings of the system as a loop transfer for negative feedback: several requirements read them."""
        system = self.system
        return margins_of(LinearPart(system.A, system.B, system.C, system.D), peaks=False)

    def slope(self, weight: Floats, names: Sequence[str]) -> Floats:
        """Return the derivatives of a function of M, shape (n,).

        Args:
            weight: its derivative by M, shape as M.
            names: of the parameters.
        """
        inside = self.left.T @ weight @ self.right.T
        return np.array([
            float(np.sum(inside * self.changes[name])) if name in self.changes
            else float(np.sum(weight * self.others[name])) if name in self.others else 0.0
            for name in names
        ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class LinearFamily:
    """A linear system whose blocks are taken out.

    Attributes:
        rest: without the blocks; its last inputs are what they give, its last outputs what they take, in their order.
        components: the blocks.
        slopes: parameter of no block → derivative of A, B, C, D of `rest` by it, as one matrix [A B; C D].
        sign: of the outputs, −1 where it is a loop transfer for negative feedback.
    """

    rest: Linear
    components: tuple[Component, ...]
    slopes: Mapping[str, Floats]
    sign: float = 1.0

    def at(self, values: Mapping[str, float]) -> Member:
        """Return the model with other parameters.

        With K = [Aₖ Bₖ; Cₖ Dₖ] of all blocks and P the rest, augmented by their states, M = P₁₁ + P₁₂K(1 − P₂₂K)⁻¹P₂₁.

        Args:
            values: full name → value; parameters of other components are passed over.

        Raises:
            InputError: a value that a parameter cannot have, or an algebraic loop without a solution.
        """
        blocks = [_changed(c, values) for c in self.components]
        matrices = [_joined(b) for b in blocks]
        orders = [len(m) - 1 for m in matrices]
        k, nk = _stacked(matrices, orders), sum(orders)
        rest, n, p = self.rest, len(self.rest.A), len(blocks)
        whole = np.block([[rest.A, rest.B], [rest.C, rest.D]])
        q, m = rest.D.shape[0] - p, rest.D.shape[1] - p
        p11, p12, p21, p22 = parts = _augmented(whole, n, nk, q, m)
        size = np.eye(len(p22)) - p22 @ k
        if len(size) and np.linalg.cond(size) > 1.0 / np.finfo(float).eps:
            raise InputError("the blocks are in an algebraic loop that has no solution with these values")
        right: Floats = np.asarray(np.linalg.solve(size, p21), dtype=np.float64)
        left = p12 @ np.linalg.inv(np.eye(len(k)) - k @ p22)
        closed = p11 + p12 @ k @ right
        changes = {full: change for i in range(p) for full, change in self._by_parameters(i, blocks, orders, values)}
        others = {
            name: _moved(parts, _augmented(whole + slope, n, nk, q, m), k) for name, slope in self.slopes.items()
        }  # fmt: skip
        system = Linear(
            closed[: n + nk, : n + nk], closed[: n + nk, n + nk :], self.sign * closed[n + nk :, : n + nk],
            self.sign * closed[n + nk :, n + nk :], input_names=rest.input_names[:m],
            output_names=rest.output_names[:q],
        )  # fmt: skip
        out = np.concatenate([np.ones(n + nk), np.full(q, self.sign)])[:, None]
        left = np.asarray(out * left, dtype=np.float64)
        return Member(system, left, right, changes, {name: out * d for name, d in others.items()})

    def _by_parameters(
        self, i: int, blocks: Sequence[Component], orders: Sequence[int], values: Mapping[str, float]
    ) -> list[tuple[str, Floats]]:
        """Return (full name, dK) of the parameters of one block."""
        result = []
        head = f"{blocks[i].name}."
        for full, value in values.items():
            if full.startswith(head):
                width = _WIDTH * (abs(value) or 1.0)
                ends = [_joined(_changed(blocks[i], {full: value + s * width})) for s in (1.0, -1.0)]
                change = [np.zeros((o + 1, o + 1)) for o in orders]
                change[i] = (ends[0] - ends[1]) / (2.0 * width)
                result.append((full, _stacked(change, orders)))
        return result


_Parts = tuple[Floats, Floats, Floats, Floats]


def _moved(parts: _Parts, others: _Parts, k: Floats) -> Floats:
    """Return dM where P moves to another one: [1, P₁₂KS] dP [1; KSP₂₁], S = (1 − P₂₂K)⁻¹."""
    _, p12, p21, p22 = parts
    ks = k @ np.linalg.inv(np.eye(len(p22)) - p22 @ k)
    d11, d12, d21, d22 = (other - part for part, other in zip(parts, others, strict=True))
    return np.asarray(d11 + d12 @ ks @ p21 + p12 @ ks @ (d21 + d22 @ ks @ p21))


def _augmented(whole: Floats, n: int, nk: int, q: int, m: int) -> _Parts:
    """Return P₁₁ … P₂₂ of a system [A B; C D] with the integrators of the blocks' states."""
    x, w, v = slice(0, n), slice(n, n + m), slice(n + m, None)
    z, e = slice(n, n + q), slice(n + q, None)
    p = whole.shape[1] - n - m
    zero, one = np.zeros, np.eye
    p11 = np.block([
        [whole[x, x], zero((n, nk)), whole[x, w]], [zero((nk, n + nk + m))], [whole[z, x], zero((q, nk)), whole[z, w]],
    ])  # fmt: skip
    p12 = np.block([[zero((n, nk)), whole[x, v]], [one(nk), zero((nk, p))], [zero((q, nk)), whole[z, v]]])
    p21 = np.block([[zero((nk, n)), one(nk), zero((nk, m))], [whole[e, x], zero((p, nk)), whole[e, w]]])
    p22 = block_diag(zero((nk, nk)), whole[e, v]) if p else zero((nk, nk))
    return p11, p12, p21, p22


def _joined(component: Component) -> Floats:
    """Return [A B; C D] of a block."""
    found = linear_block(component)
    assert found is not None  # noqa: S101 - only such blocks are taken out
    return np.block([[found.a, found.b], [found.c, found.d]])


def _stacked(matrices: Sequence[Floats], orders: Sequence[int]) -> Floats:
    """Return the joint [A B; C D] of blocks side by side."""
    parts = ([m[:o, :o], m[:o, o:], m[o:, :o], m[o:, o:]] for m, o in zip(matrices, orders, strict=True))
    a, b, c, d = zip(*parts, strict=True) if matrices else ((), (), (), ())
    none = np.zeros((0, 0))
    return np.block([[block_diag(none, *a), block_diag(none, *b)], [block_diag(none, *c), block_diag(none, *d)]])


def _changed(component: Component, values: Mapping[str, float]) -> Component:
    head = f"{component.name}."
    own = {full.removeprefix(head): value for full, value in values.items() if full.startswith(head)}
    if not own:
        return component
    if isinstance(component, GainComponent):
        return replace(component, gain=own["gain"])
    assert isinstance(component, BlockComponent)  # noqa: S101 - as above
    return replace(component, parameters={**component.parameters, **own})
