"""Random systems with several sample rates, and what they do in closed form, written down without the workbench.

A system is a list of nodes, each with one input u and one output y:

- a plant: dx/dt = A x + B u, y = C x;
- a sampler with a period and an offset, exact rationals: at its instants y = C x + D u and then x = A x + B u; between
  them both stand still. It is a component {A, B, C, D, dt}, a block `zero_order_hold` or `discrete_transfer_function`,
  or a `when sample()` of an FMU, which may hold two of them.

u of a node is a sum of outputs with factors, and of the external r. Nodes with a direct path are fed by those before
them only, so that there is no algebraic loop; all samplers that are due at an instant see each other's new outputs.

`Truth` holds the whole as three matrices: the flow between instants, the jump at each set of samplers that are due, and
the outputs. From them follow the exact event simulation and the map over the basic period of Kalman and Bertram (A
unified approach to the theory of sampling systems, J. Franklin Inst. 267, 1959).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import workbench as wb
from tests.lin_fmus import built
from workbench.core.values.arrays import Floats
from workbench.core.values.margins import Margins
from workbench.point.lin.result import LinResult

__all__ = ["Node", "Rate", "System", "Truth", "connected", "departure", "random_system", "verdict_fault"]


_FAR_FROM_BORDER = 0.03  # of the spectral radius from 1: a long run must be able to tell
_LONG = 300  # basic periods of a long run
_LARGEST = 3.0  # spectral radius over a basic period: what an unstable run may grow by


@dataclass(frozen=True)
class Rate:
    """Instants offset + k · period [s], k = 0, 1, …"""

    period: Fraction
    offset: Fraction = Fraction(0)

    def due(self, time: Fraction) -> bool:
        """Whether `time` is one of the instants."""
        return time >= self.offset and (time - self.offset) % self.period == 0


@dataclass(frozen=True, eq=False)
class Node:
    """One plant or sampler.

    Attributes:
        name: of its component.
        kind: "plant", "matrices", "hold", "transfer", or "fmu": a sampler of an FMU.
        A, B, C, D: shapes (n, n), (n,), (n,), ().
        rate: None: a plant.
        number: which sampler of its FMU.
    """

    name: str
    kind: str
    A: Floats
    B: Floats
    C: Floats
    D: float = 0.0
    rate: Rate | None = None
    number: int = 1

    @property
    def y(self) -> str:
        """Full name of its output."""
        return f"{self.name}.y{self.number}" if self.kind == "fmu" else f"{self.name}.y"

    @property
    def u(self) -> str:
        """Full name of its input."""
        return f"{self.name}.u{self.number}" if self.kind == "fmu" else f"{self.name}.u"

    @property
    def states(self) -> tuple[str, ...]:
        """Full names of its states."""
        return tuple(f"{self.name}.x{self.number if self.kind == 'fmu' else i + 1}" for i in range(len(self.A)))

    @property
    def held(self) -> str:
        """Full name of the discrete state that holds its output: only FMUs show one."""
        return f"{self.name}.h{self.number}" if self.kind == "fmu" else f"hold of {self.name}"


@dataclass(frozen=True, eq=False)
class System:
    """Nodes and what connects them: u = K y + g r.

    Attributes:
        nodes: n of them.
        K: shape (n, n).
        g: shape (n,), one entry 1 and the others 0.
    """

    nodes: tuple[Node, ...]
    K: Floats
    g: Floats

    @property
    def rates(self) -> tuple[Rate, ...]:
        """Rates of its samplers."""
        return tuple(n.rate for n in self.nodes if n.rate is not None)

    @property
    def periods(self) -> tuple[Fraction, ...]:
        """Different periods, rising."""
        return tuple(sorted({r.period for r in self.rates}))

    @property
    def basic_period(self) -> Fraction:
        """Least common multiple of the periods [s]."""
        multiple = Fraction(1)
        for i, p in enumerate(self.periods):
            multiple = p if i == 0 else _lcm(multiple, p)
        return multiple

    @cached_property
    def truth(self) -> Truth:
        """What it does."""
        return Truth(self)

    def __str__(self) -> str:
        """Return kinds and rates in one line."""
        told = (f"{n.kind} {n.rate.period}" + (f"+{n.rate.offset}" if n.rate.offset else "") if n.rate else "plant"
                for n in self.nodes)  # fmt: skip
        return ", ".join(told)


def _lcm(a: Fraction, b: Fraction) -> Fraction:
    common = math.lcm(a.denominator, b.denominator)
    return Fraction(math.lcm(int(a * common), int(b * common)), common)


class Truth:
    """States s = (states of the nodes, outputs that samplers hold); ds/dt = F s + f r between instants.

    Attributes:
        names: of the states s, shape (n,).
        F, f: of the flow.
        Y, y: outputs of all nodes, Y s + y r.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        nodes = system.nodes
        self.names = [name for n in nodes for name in n.states] + [n.held for n in nodes if n.rate]
        sizes = np.cumsum([0, *(len(n.A) for n in nodes)])
        self._own = [slice(a, b) for a, b in pairwise(sizes.tolist())]
        hold = iter(range(int(sizes[-1]), len(self.names)))
        self._hold = [next(hold) if n.rate else -1 for n in nodes]
        self.Y, self.y = self._outputs(set())
        self.F, self.f = self._states(
            np.zeros((len(self.names),) * 2), plants=True, ticking=set(), outputs=(self.Y, self.y)
        )
        self._flows: dict[Fraction, tuple[Floats, Floats]] = {}
        self._jumps: dict[frozenset[int], tuple[Floats, Floats]] = {}

    def _outputs(self, ticking: set[int]) -> tuple[Floats, Floats]:
        """Return the outputs of all nodes where some of the samplers are due."""
        nodes, K, g = self.system.nodes, self.system.K, self.system.g
        Y, y = np.zeros((len(nodes), len(self.names))), np.zeros(len(nodes))
        through = np.zeros(len(nodes))
        for i, n in enumerate(nodes):
            if n.rate is None or i in ticking:
                Y[i, self._own[i]] = n.C
                through[i] = n.D
            else:
                Y[i, self._hold[i]] = 1.0
        left = np.eye(len(nodes)) - through[:, None] * K
        solved: Floats = np.linalg.solve(left, np.column_stack([Y, y + through * g])).astype(np.float64)
        return solved[:, :-1], solved[:, -1]

    def _states(
        self, begin: Floats, *, plants: bool, ticking: set[int], outputs: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats]:
        """Return A x + B u in the rows of plants, or of the samplers that are due, and their new outputs."""
        K, g, (Y, y) = self.system.K, self.system.g, outputs
        whole, by_r = begin.copy(), np.zeros(len(self.names))
        for i, n in enumerate(self.system.nodes):
            if (n.rate is None) is plants and (plants or i in ticking):
                rows = self._own[i]
                whole[rows] = 0.0
                whole[rows, rows] = n.A
                whole[rows] += np.outer(n.B, K[i] @ Y)
                by_r[rows] = n.B * (K[i] @ y + g[i])
            if i in ticking:
                whole[self._hold[i]], by_r[self._hold[i]] = Y[i], y[i]
        return whole, by_r

    def flow(self, length: Fraction) -> tuple[Floats, Floats]:
        """Return what time does: s(t + length) = Φ s(t) + γ r."""
        if length not in self._flows:
            n = len(self.names)
            whole = np.zeros((n + 1, n + 1))
            whole[:n, :n], whole[:n, n] = self.F, self.f
            found = expm(whole * float(length))
            self._flows[length] = found[:n, :n], found[:n, n]
        return self._flows[length]

    def jump(self, time: Fraction) -> tuple[Floats, Floats]:
        """Return what the instant `time` does: s(t+) = Φ s(t−) + γ r."""
        due = frozenset(i for i, n in enumerate(self.system.nodes) if n.rate is not None and n.rate.due(time))
        if due not in self._jumps:
            ticking = set(due)
            self._jumps[due] = self._states(
                np.eye(len(self.names)), plants=False, ticking=ticking, outputs=self._outputs(ticking)
            )
        return self._jumps[due]

    def instants(self, begin: Fraction, end: Fraction) -> list[Fraction]:
        """Return all instants in [begin, end), rising [s]."""
        found = set[Fraction]()
        for rate in self.system.rates:
            k = max(0, math.ceil((begin - rate.offset) / rate.period))
            while (t := rate.offset + k * rate.period) < end:
                found.add(t)
                k += 1
        return sorted(found)

    # -- (a) exact event simulation -----------------------------------------------------------------------------------

    def simulate(self, times: Sequence[Fraction], *, r: float = 1.0, s0: Floats | None = None) -> Floats:
        """Return the outputs of all nodes at times (right limits), r constant, shape (k, nodes).

        Args:
            times: rising, from 0 on [s].
            r: the external input.
            s0: states before the instant 0; None: 0.
        """
        s, now = np.zeros(len(self.names)) if s0 is None else s0.copy(), Fraction(0)
        jumps = self.instants(Fraction(0), times[-1] + 1)
        wanted, found = set(times), []
        for t in sorted({*wanted, *(j for j in jumps if j <= times[-1])}):
            Phi, gamma = self.flow(t - now)
            s = Phi @ s + gamma * r
            Phi, gamma = self.jump(t)
            s, now = Phi @ s + gamma * r, t
            if t in wanted:
                found.append(self.Y @ s + self.y * r)
        return np.array(found)

    # -- (b) Kalman and Bertram's map ---------------------------------------------------------------------------------

    def steps(self, begin: Fraction, end: Fraction) -> Iterator[tuple[Floats, Floats]]:
        """Yield flows and jumps from just before `begin` to just before `end`."""
        now = begin
        for t in self.instants(begin, end):
            yield self.flow(t - now)
            yield self.jump(t)
            now = t
        yield self.flow(end - now)

    def period_map(self, begin: Fraction | None = None) -> tuple[Floats, Floats, Floats, Floats]:
        """Return A, B over the basic period from just before `begin` on, and C, D: outputs just after `begin`.

        Args:
            begin: multiple of the basic period; None: the first one after which all rates tick as they do for ever.
        """
        T = self.system.basic_period
        start = self.settled if begin is None else begin
        A, B = np.eye(len(self.names)), np.zeros(len(self.names))
        for Phi, gamma in self.steps(start, start + T):
            A, B = Phi @ A, Phi @ B + gamma
        Phi, gamma = self.jump(start)
        return A, B, self.Y @ Phi, self.Y @ gamma + self.y

    @property
    def settled(self) -> Fraction:
        """First multiple of the basic period from which on every rate ticks in each [s]."""
        T = self.system.basic_period
        return T * max(math.ceil((r.offset - r.period) / T) if r.offset >= r.period else 0 for r in self.system.rates)

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """Eigenvalues of the map."""
        return np.linalg.eigvals(self.period_map()[0]).astype(np.complex128)

    # -- (c) what it does in the long run -----------------------------------------------------------------------------

    @cached_property
    def radius(self) -> float:
        """Spectral radius of the map, of what does not vanish: above 1 it is unstable."""
        return float(np.abs(self.multipliers).max(initial=0.0))

    @cached_property
    def stable(self) -> bool:
        """Whether a long run without input comes to rest: event by event, from anywhere, over 300 basic periods."""
        start, period = self.settled, self.system.basic_period
        once = [Phi for Phi, _ in self.steps(start, start + period)]
        s = np.random.default_rng(3).standard_normal(len(self.names))
        sizes = []
        for _ in range(_LONG):
            for Phi in once:
                s = Phi @ s
            sizes.append(float(np.linalg.norm(s)))
        return sizes[-1] < sizes[_LONG // 2] or sizes[-1] == 0.0


# -- random systems ---------------------------------------------------------------------------------------------------

_NESTED = ((10, 5), (10, 1), (20, 4), (20, 5, 1), (40, 20, 5), (20, 10, 5, 1))  # [1/s], with their quotients whole
_OTHERS = (
    ("0.06", "0.04"), ("0.3", "0.2"), ("0.1", "0.25"), ("0.12", "0.04"), ("0.03", "0.02", "0.05"), ("0.3", "0.1"),
    ("0.015", "0.005"), ("0.14", "0.1"), ("0.04", "0.06", "0.08", "0.1"),
)  # fmt: skip
# What FMUs sample at, period and offset: they are part of their code.
_ONE = (("0.1", "0"), ("0.06", "0.02"), ("0.2", "0.03"), ("0.04", "0"))
_TWO = (
    ("0.1", "0", "0.2", "0"), ("0.06", "0", "0.04", "0"), ("0.1", "0", "0.1", "0.03"), ("0.05", "0.01", "0.2", "0.1"),
    ("0.1", "0", "0.5", "0"),
)  # fmt: skip
_SAMPLER = """
  input Real u{k}(start = 0);
  output Real y{k};
  parameter Real a{k} = 0.5;
  parameter Real b{k} = 1;
  parameter Real c{k} = 1;
  discrete Real x{k}(start = 0, fixed = true, nominal = 1);
  discrete Real h{k}(start = 0, fixed = true, nominal = 1);
"""
_EQUATIONS = """
  when sample({offset}, {period}) then
    h{k} = c{k} * pre(x{k});
    x{k} = a{k} * pre(x{k}) + b{k} * u{k};
  end when;
  y{k} = h{k};
"""


def sampler_fmu(rates: Sequence[Rate], fmi: int = 2) -> str:
    """Return an FMU of that version with a sampler for each rate: inputs u1 …, outputs y1 …, parameters a1, b1, c1 …"""
    told = [{"k": k, "period": float(r.period), "offset": float(r.offset)} for k, r in enumerate(rates, 1)]
    numbers = (n for r in rates for value in (r.period, r.offset) for n in value.as_integer_ratio())
    name = "_".join(["Samplers", *map(str, numbers)])
    heads, bodies = ("".join(text.format(**t) for t in told) for text in (_SAMPLER, _EQUATIONS))
    return built(f"model {name}\n{heads}\nequation\n{bodies}\nend {name};\n", name, fmi)


def random_system(seed: int, *, fmus: bool = True, through: bool = True) -> System:
    """Return a random system of two to four rates whose stability a long run can tell.

    Args:
        seed: of the random numbers.
        fmus: some samplers are FMUs, which alone have offsets.
        through: some samplers have a direct path.
    """
    rng = np.random.default_rng(seed)
    while True:
        nodes = _samplers(rng, fmus=fmus, through=through)
        nodes.insert(0, _plant(rng, "p"))
        if rng.random() < 0.4:
            nodes.append(_plant(rng, "q"))
        system = _wired(rng, nodes)
        radius = system.truth.radius
        if abs(radius - 1.0) > _FAR_FROM_BORDER and radius < _LARGEST:
            return system


def _periods(rng: np.random.Generator) -> list[Fraction]:
    if rng.random() < 0.5:
        return [Fraction(1, f) for f in _NESTED[rng.integers(len(_NESTED))]]
    return [Fraction(p) for p in _OTHERS[rng.integers(len(_OTHERS))]]


def _samplers(rng: np.random.Generator, *, fmus: bool, through: bool) -> list[Node]:
    found: list[Node] = []
    for k, period in enumerate(_periods(rng)):
        kind = ("matrices", "matrices", "transfer", "hold")[rng.integers(4)]
        found.append(_sampler(rng, f"s{k}", kind, Rate(period), through=through))
    if fmus and rng.random() < 0.3:
        alone = Rate(*map(Fraction, _ONE[rng.integers(len(_ONE))]))
        found[-1] = _sampler(rng, "f", "fmu", alone)
    if fmus and rng.random() < 0.3:
        p1, o1, p2, o2 = map(Fraction, _TWO[rng.integers(len(_TWO))])
        found[-2:] = [
            _sampler(rng, "g", "fmu", Rate(p, o), number=k) for k, (p, o) in enumerate(((p1, o1), (p2, o2)), 1)
        ]
    return found


def _sampler(
    rng: np.random.Generator, name: str, kind: str, rate: Rate, *, through: bool = True, number: int = 1
) -> Node:
    pole = rng.uniform(-0.4, 0.9)
    one = np.ones(1)
    if kind == "hold":
        return Node(name, kind, np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0, rate)
    D = float(rng.uniform(-1.0, 1.0)) if through and kind != "fmu" and rng.random() < 0.5 else 0.0
    if kind == "transfer" or rng.random() < 0.5 or kind == "fmu":
        b = 1.0 if kind == "transfer" else float(rng.uniform(0.3, 1.0))
        return Node(name, kind, np.array([[pole]]), b * one, float(rng.uniform(0.3, 1.0)) * one, D, rate, number)
    size, angle = rng.uniform(0.3, 0.9), rng.uniform(0.2, 2.5)
    A = size * np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    return Node(name, kind, A, rng.uniform(-1.0, 1.0, 2), rng.uniform(-1.0, 1.0, 2), D, rate)


def _plant(rng: np.random.Generator, name: str) -> Node:
    if rng.random() < 0.5:
        lag = rng.uniform(0.5, 10.0)
        return Node(name, "plant", np.array([[-lag]]), np.array([lag]), np.ones(1))
    w, z = rng.uniform(2.0, 15.0), rng.uniform(0.1, 1.0)
    return Node(
        name, "plant", np.array([[0.0, 1.0], [-w * w, -2 * z * w]]), np.array([0.0, w * w]), np.array([1.0, 0.0])
    )


def _wired(rng: np.random.Generator, nodes: list[Node]) -> System:
    """Return the nodes in a chain p → s0 → s1 → … → p, with a few more connections."""
    n = len(nodes)
    K = np.zeros((n, n))
    for i in range(1, n):
        K[i, i - 1] = rng.uniform(0.4, 1.2)
    K[0, n - 1] = -rng.uniform(0.2, 2.0)
    for _ in range(int(rng.integers(0, 3))):
        i, j = (int(k) for k in rng.integers(0, n, 2))
        if i != j and (j < i or nodes[i].D == 0.0):
            K[i, j] = rng.uniform(-0.7, 0.7)
    g = np.zeros(n)
    g[int(rng.integers(0, n))] = 1.0
    return System(tuple(nodes), K, g)


# -- as a model of the workbench --------------------------------------------------------------------------------------


@dataclass
class _Written:
    components: dict[str, Any] = field(default_factory=dict)
    connections: list[Any] = field(default_factory=list)
    inputs: dict[str, str] = field(default_factory=dict)
    starts: dict[str, float] = field(default_factory=dict)


def connected(system: System, *, interface: str = "me", fmi: int = 2, **options: Any) -> wb.DescribedModel:  # noqa: ANN401
    """Return a system as the workbench connects it: input r, outputs by the name of each node's output.

    Each node's input comes out of a sum `into_NAME`, whose factors are those of K.

    Args:
        system: the system.
        interface: of its FMUs.
        fmi: their version.
        options: of `connect`.
    """
    out = _Written()
    for i, node in enumerate(system.nodes):
        _component(out, system, node, interface, fmi)
        sources = [j for j in range(len(system.nodes)) if system.K[i, j]]
        factors = [float(system.K[i, j]) for j in sources] + [1.0] * bool(system.g[i])
        if not factors:
            continue
        into = f"into_{node.name}{node.number if node.kind == 'fmu' else ''}"
        out.components[into] = wb.SumComponent(name=into, signs=tuple(factors))
        out.connections.append((f"{into}.y", node.u))
        out.connections += [(system.nodes[j].y, f"{into}.u{k}") for k, j in enumerate(sources, 1)]
        if system.g[i]:
            out.inputs["r"] = f"{into}.u{len(factors)}"
    outputs = {n.y.replace(".", "_"): n.y for n in system.nodes}
    return wb.connect(
        out.components, out.connections, inputs=out.inputs, outputs=outputs, start_values=out.starts, **options
    )


def _component(out: _Written, system: System, node: Node, interface: str, fmi: int) -> None:
    period = 0.0 if node.rate is None else float(node.rate.period)
    if node.kind == "fmu":
        parameters = {"a": float(node.A[0, 0]), "b": float(node.B[0]), "c": float(node.C[0])}
        out.starts.update({f"{node.name}.{k}{node.number}": v for k, v in parameters.items()})
        file = sampler_fmu([n.rate for n in system.nodes if n.name == node.name and n.rate], fmi)
        out.components[node.name] = wb.FmuComponent(name=node.name, file=file, interface=interface)
    elif node.kind == "hold":
        out.components[node.name] = wb.BlockComponent(
            name=node.name, kind="zero_order_hold", parameters={"period": period}
        )
    elif node.kind == "transfer":
        a, c = float(node.A[0, 0]), float(node.C[0])
        told = {"numerator": [node.D, c - a * node.D], "denominator": [1.0, -a], "period": period}
        out.components[node.name] = wb.BlockComponent(
            name=node.name, kind="discrete_transfer_function", parameters=told
        )
    else:
        out.components[node.name] = wb.LinearComponent(
            name=node.name, A=node.A, B=node.B[:, None], C=node.C[None], D=np.array([[node.D]]), dt=period,
            x0=np.zeros(len(node.A)), input_names=("u",), output_names=("y",), state_names=node_states(node),
        )  # fmt: skip


def node_states(node: Node) -> tuple[str, ...]:
    """Return the names of a node's states inside its component."""
    return tuple(f"x{i + 1}" for i in range(len(node.A)))


# -- what the workbench says, beside the truth -------------------------------------------------------------------------


def departure(system: System, found: LinResult) -> float:
    """Return the largest difference of A, B, C, D from Kalman and Bertram's map, relative to the largest entry of A.

    Infinite where the basic period or a pole is missing.

    Args:
        system: whose all inputs and outputs were linearised.
        found: its linear model.
    """
    truth = system.truth
    A, B, C, D = truth.period_map()
    rows = [truth.names.index(name) for name in found.state_names]
    every = [n.y.replace(".", "_") for n in system.nodes]
    outputs = [every.index(name) for name in found.output_names]
    differences = (
        found.A - A[np.ix_(rows, rows)], found.B[:, 0] - B[rows], found.C - C[np.ix_(outputs, rows)],
        found.D[:, 0] - D[outputs],
    )  # fmt: skip
    missed = np.sum(np.abs(found.poles) > _SEEN) != np.sum(np.abs(truth.multipliers) > _SEEN)
    if missed or not math.isclose(found.dt, float(system.basic_period), rel_tol=1e-9):
        return math.inf
    return max(float(np.abs(d).max(initial=0.0)) for d in differences) / max(1.0, float(np.abs(A).max()))


def verdict_fault(system: System, number: int, margins: Margins) -> str:
    """Return what is wrong with what is said of a loop, opened behind a node; empty: nothing.

    A factor on the node's output that is a little smaller than a gain margin must leave the loop stable, one that is a
    little larger must not.

    Args:
        system: the system.
        number: of the node.
        margins: what `loop` says.
    """
    if margins.verdict != ("stable" if system.truth.stable else "unstable"):
        return f"is said to be {margins.verdict}, and a long run is not; spectral radius {system.truth.radius:.4f}"
    for factor, turn in ((margins.gain_margin, 1.0), (margins.gain_reduction, -1.0)):
        if math.isfinite(factor) and factor > 0.0:
            inside, outside = (_radius(system, number, factor * (1.0 + s * turn * _NEAR)) for s in (-1.0, 1.0))
            if not inside < 1.0 < outside:
                return f"gain margin {factor:.6g}: spectral radius {inside:.6f} below and {outside:.6f} above it"
    return ""


_SEEN = 1e-2  # size of a multiplier that must be found: multiple ones at 0 are spread by differences
_NEAR = 1e-3


def _radius(system: System, number: int, factor: float) -> float:
    """Return the spectral radius with a factor on the output of a node."""
    K = system.K.copy()
    K[:, number] *= factor
    return replace(system, K=K).truth.radius
