"""Make a `ModelDescription` of what an XML file declares: arrays taken apart, types and references looked up."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain

from workbench.core.records.names_in_text import OUR_TOOL, plain_unit
from workbench.errors import FmuError
from workbench.fmi import declared as said
from workbench.fmi.clocks import clocked_by, clocks_of
from workbench.fmi.declared import Declared
from workbench.fmi.description import Capabilities, DefaultExperiment, DisplayUnit, ModelDescription, UnitDefinition
from workbench.fmi.rules import broken_rules, complete, less_kept_rules
from workbench.fmi.variable import FLOAT_TYPES, NEGATED, Value, Variable

__all__ = ["described"]

MAX_ELEMENTS = 1_000_000

_INTERFACES = {"me": "ModelExchange", "cs": "CoSimulation", "scheduled": "ScheduledExecution"}
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def described(declared: Declared, *, resized: bool = False) -> ModelDescription:
    """Return what the description means; `platforms` and `terminals` stay empty.

    Args:
        declared: as it stands in the file; defaults of the standard are filled in.
        resized: whether arrays have other sizes than in the file, which its start values need not fit.

    Raises:
        FmuError: a reference to a variable that is not there, an array without an extent or of too many elements.
    """
    complete(declared)
    problems = [*declared.problems, *broken_rules(declared)]
    made = _Variables(declared, resized=resized)
    every = made.all()
    root = declared.root
    states, derivatives = made.states(every)
    clocked = clocked_by(declared.variables)
    return ModelDescription(
        fmi_version=root.fmi_version,
        major=declared.major,
        model_name=root.model_name or "unnamed",
        token=root.token or "",
        generation_tool=root.generation_tool,
        has_history=_has_history(declared),
        description=root.description,
        interfaces=_interfaces(declared),
        platforms=(),
        experiment=_experiment(declared.experiment),
        variables=every,
        states=states,
        derivatives=derivatives,
        state_count=root.number_of_continuous_states if declared.major == 1 else len(derivatives),
        indicator_count=made.indicators() if declared.major == 3 else root.number_of_event_indicators,
        shapes=made.shapes(),
        log_categories=tuple(c.name for c in declared.categories if c.name),
        notes=(*_violations(problems, declared.lost), *made.notes),
        problems=(*problems, *less_kept_rules(declared, made.find)),
        lost=(*declared.lost, *made.lost),
        units=_units(declared),
        enumerations={t.name: _items(t) for t in declared.types if t.name and t.items},
        scheduled=_claims(declared, "scheduled"),
        clocks=clocks_of(declared.variables, clocked),
        clocked=clocked,
        intermediate=frozenset(
            v.value_reference
            for v in declared.variables
            if v.intermediate_update and v.causality == "input" and v.value_reference is not None
        ),
    )


def _violations(problems: list[str], lost: list[str]) -> tuple[str, ...]:
    if not problems:
        return ()
    first = lost[0] if lost else problems[0]
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    what = "; an input, output, state or start value may be lost by it" if lost else ""
    return (f"modelDescription.xml violates the FMI standard: {first}{more}{what}",)


# -- what is not about variables ---------------------------------------------------------------


def _interfaces(declared: Declared) -> dict[str, Capabilities]:
    result = {name: _claims(declared, name) for name in ("me", "cs")}
    return {name: claims for name, claims in result.items() if claims is not None}


def _claims(declared: Declared, name: str) -> Capabilities | None:
    """Return what an interface claims; None: it is not offered."""
    element = declared.interfaces.get(_INTERFACES[name])
    if element is None or not element.model_identifier:
        return None
    return _capabilities(declared.major, name, element, element.model_identifier)


def _capabilities(major: int, name: str, element: said.Interface, identifier: str) -> Capabilities:
    me, cs = name == "me", name == "cs"
    not_needed = element.completed_integrator_step_not_needed
    completed = {1: True, 2: not not_needed, 3: element.needs_completed_integrator_step}
    # FMI 1.0's default, constant steps, is the cautious one; most of its FMUs that do not speak of it take any step.
    variable_step = element.can_handle_variable_communication_step_size
    return Capabilities(
        identifier=identifier,
        state=bool(element.state),
        directional_derivatives=bool(element.directional_derivatives),
        variable_step=not cs or (variable_step is not False if major == 1 else bool(variable_step)),
        interpolates_inputs=cs and major == 2 and element.can_interpolate_inputs,
        event_mode=cs and element.has_event_mode,
        completed_step=me and completed[major],
        once_per_process=element.can_be_instantiated_only_once_per_process,
        needs_tool=element.needs_execution_tool,
        adjoint_derivatives=major == 3 and element.provides_adjoint_derivatives,
        intermediate_update=major == 3 and element.provides_intermediate_update,
        internal_step=_positive(element.fixed_internal_step_size) if cs and major == 3 else None,
    )


def _has_history(declared: Declared) -> bool:
    """Whether an FMU that this workbench has built has a delay(): only those ask to be told of accepted steps."""
    me = _claims(declared, "me")
    return declared.root.generation_tool == OUR_TOOL and me is not None and me.completed_step


def _experiment(given: said.DeclaredExperiment | None) -> DefaultExperiment:
    if given is None:
        return DefaultExperiment()
    return DefaultExperiment(
        start_time=given.start_time,
        stop_time=given.stop_time,
        tolerance=_positive(given.tolerance),
        step=_positive(given.step_size),
    )


def _positive(value: float | None) -> float | None:
    return value if value is not None and value > 0.0 else None


def _units(declared: Declared) -> dict[str, UnitDefinition]:
    return {plain_unit(u.name): _unit(u) for u in declared.units if u.name is not None}


def _unit(unit: said.DeclaredUnit) -> UnitDefinition:
    display = tuple(DisplayUnit(d.name, _or(d.factor, 1.0), _or(d.offset, 0.0)) for d in unit.display if d.name)
    if not unit.base:
        return UnitDefinition(display=display)
    base = unit.base[0]
    exponents = {name: getattr(base, name) or 0 for name in _BASE}
    return UnitDefinition(exponents, _or(base.factor, 1.0), _or(base.offset, 0.0), display)


def _or(value: float | None, default: float) -> float:
    return default if value is None else value


def _items(declared: said.DeclaredType) -> dict[str, int]:
    # FMI 1.0 numbers its items from 1 by their order.
    return {i.name or "": n if i.value is None else i.value for n, i in enumerate(declared.items, 1)}


# -- variables ---------------------------------------------------------------------------------


class _Variables:
    """The variables of one description.

    Attributes:
        notes: what of them could not be taken as it stands.
        lost: those of `notes` that leave out a variable or a state.
    """

    def __init__(self, declared: Declared, *, resized: bool) -> None:
        self._major = declared.major
        self._declared = declared.variables
        self._structure = declared.structure
        self._resized = resized
        self._has_states = self._major > 1 and "ModelExchange" in declared.interfaces
        self._types = {t.name: t for t in declared.types}
        self._by_reference = {v.value_reference: v for v in declared.variables} if self._major == 3 else {}
        self._extents = {id(v): self._shape(v) for v in declared.variables if v.dimensions}
        self.notes: list[str] = []
        self.lost: list[str] = []
        self._name_apart()
        self._same = self._joined()
        self._set_negated_apart()
        self._depends = self._dependencies()
        for v in declared.variables:
            if not v.kind:
                self._lose(f"variable {v.name} (line {v.line}) has no type, and is left out")
            if v.derivative is not None and self._knows(v.derivative) and self.find(v.derivative) is v:
                self._lose(f"variable {v.name} (line {v.line}) is said to be the derivative of itself")
                v.derivative = None
            if v.derivative is not None and not self._knows(v.derivative):
                self._lose(f"variable {v.name} (line {v.line}) is the derivative of one that is not there")
                v.derivative = None

    def _lose(self, note: str) -> None:
        self.notes.append(note)
        self.lost.append(note)

    def _name_apart(self) -> None:
        """Give a name of its own to each variable that has none, or another one's."""
        known: set[str] = set()
        for v in self._declared:
            if not v.name or v.name in known:
                given = f"{v.name or 'unnamed'}#{v.value_reference}"
                what = f"the name of another, {v.name}," if v.name else "no name,"
                self.notes.append(f"the variable of line {v.line} has {what} and is called {given}")
                v.name = given
            known.add(v.name)

    def _joined(self) -> dict[int, said.DeclaredVariable]:
        """Return the inputs and parameters that are another name of one before them, by id: one value, set once."""
        known: dict[tuple[object, ...], said.DeclaredVariable] = {}
        joined = {}
        for v in self._declared:
            if v.causality not in ("input", "parameter") or not v.kind or v.dimensions or v.value_reference is None:
                continue
            if v.alias == "negatedAlias":
                continue
            kind = "Integer" if v.kind == "Enumeration" and self._major < 3 else v.kind
            own = known.setdefault((v.causality, kind, v.value_reference), v)
            if own is v:
                continue
            joined[id(v)] = own
            own.aliases = [*(own.aliases or ()), said.Alias(v.name, v.description, v.display_unit), *(v.aliases or ())]
            own.start = v.start if own.start is None else own.start
            if v.start not in (None, own.start) or v.unit != own.unit:
                what = f"the value reference of {own.name}, and is another name of it: that one's start and unit hold"
                self.notes.append(f"variable {v.name} (line {v.line}) has {what}")
        return joined

    def _set_negated_apart(self) -> None:
        """Let what is minus another variable be listed only (FMI 1.0): nothing that reads or sets it turns the sign."""
        negated = [v for v in self._declared if v.alias == "negatedAlias" and v.kind]
        for v in negated:
            v.kind, v.start = NEGATED + v.kind, None
        if negated:
            more = f" and {len(negated) - 1} more" if len(negated) > 1 else ""
            self.notes.append(f"{negated[0].name}{more}: minus another variable (negatedAlias), and only listed")

    def find(self, which: int | None) -> said.DeclaredVariable:
        """Return the variable that the file means by a number: its position before FMI 3.0, there its reference.

        Raises:
            FmuError: there is none.
        """
        if which is not None and self._knows(which):
            found = self._by_reference[which] if self._major == 3 else self._declared[which - 1]
            return self._same.get(id(found), found)
        what = "value reference" if self._major == 3 else "index"
        if which is None:
            raise FmuError(f"the model structure has an entry whose {what} is missing")
        raise FmuError(f"the model structure names a variable with {what} {which}, which is not there")

    def _knows(self, which: int) -> bool:
        return which in self._by_reference if self._major == 3 else 0 < which <= len(self._declared)

    def all(self) -> tuple[Variable, ...]:
        """Return every scalar, aliases last."""
        own = chain.from_iterable(self._scalars(v) for v in self._declared if self._usable(v))
        aliases = [(v, a) for v in self._declared for a in v.aliases or ()]
        return (*own, *chain.from_iterable(self._alias(v, a) for v, a in aliases if self._usable(v)))

    def _usable(self, v: said.DeclaredVariable) -> bool:
        return bool(v.kind) and id(v) not in self._same

    def _alias(self, v: said.DeclaredVariable, alias: said.Alias) -> Iterator[Variable]:
        name = alias.name or ""
        for element, scalar in enumerate(self._scalars(v)):
            yield scalar._replace(
                name=name + self._index(v, element),
                description=alias.description or scalar.description,
                display_unit=alias.display_unit or scalar.display_unit,
                dependencies=None,
                causality="local",  # listed once: it is an input, say, by the variable's own name
                derivative_of=None,
                alias_of=scalar.name,
            )

    def _scalars(self, v: said.DeclaredVariable) -> Iterator[Variable]:
        """Yield the scalars of one variable: itself, or the elements of the array."""
        if v.value_reference is None:
            raise FmuError(f"line {v.line}: variable {v.name} has no valueReference")
        base = self._types.get(v.declared_type) or _NO_TYPE
        unit = v.unit or base.unit
        starts = self._starts(v)
        made = Variable(
            v.name or "",
            v.kind,
            (plain_unit(unit) or None) if unit else None,
            starts[0],
            v.description,
            v.causality or "",
            v.variability or "",
            base.min if v.min is None else v.min,
            base.max if v.max is None else v.max,
            abs(v.nominal or base.nominal or 0.0) or None,
            v.value_reference,
            0,
            self._state(v, 0) if v.derivative is not None else None,
            self._depends.get(id(v)),
            v.initial,
            v.display_unit or base.display_unit,
            v.declared_type,
        )
        if not v.dimensions:
            yield made
            return
        for element, start in enumerate(starts):
            name, state = made.name + self._index(v, element), self._state(v, element)
            yield made._replace(name=name, start=start, element=element, derivative_of=state)

    # -- arrays --

    def _shape(self, v: said.DeclaredVariable) -> tuple[int, ...]:
        extents = [self._extent(v, d) for d in v.dimensions or ()]
        if min(extents) < 0 or math.prod(extents) > MAX_ELEMENTS:
            raise FmuError(f"line {v.line}: array {v.name} has {math.prod(extents)} elements")
        return tuple(extents)

    def _extent(self, v: said.DeclaredVariable, dimension: said.Dimension) -> int:
        if dimension.start is not None:
            return dimension.start
        holder = self._by_reference.get(dimension.value_reference)
        if holder is None or not (holder.start or "").isdecimal() or len(holder.start or "") > said.LONGEST:
            raise FmuError(f"line {v.line}: array {v.name} does not say how large it is")
        return int(holder.start or "")

    def _size(self, v: said.DeclaredVariable) -> int:
        return math.prod(self._extents.get(id(v), ()))

    def _index(self, v: said.DeclaredVariable, element: int) -> str:
        """Return the 1-based indices of an element, in brackets; the last index runs first."""
        shape = self._extents.get(id(v))
        if not shape:
            return ""
        indices = []
        for extent in reversed(shape):
            element, index = divmod(element, extent)
            indices.append(str(index + 1))
        return f"[{','.join(reversed(indices))}]"

    def shapes(self) -> dict[int, tuple[int, ...]]:
        """Return value reference → shape of the arrays."""
        return {
            v.value_reference: self._extents[id(v)]
            for v in self._declared
            if v.dimensions and v.value_reference is not None
        }

    # -- references --

    def _state(self, v: said.DeclaredVariable, element: int) -> str | None:
        """Return the name of the variable whose derivative this is."""
        if v.derivative is None:
            return None
        state = self.find(v.derivative)
        return (state.name or "") + self._index(state, element)

    def _dependencies(self) -> dict[int, tuple[str, ...]]:
        return {
            id(self.find(u.variable)): tuple(self.find(d).name or "" for d in u.dependencies)
            for section in ("Outputs", "Derivatives")
            for u in self._structure.get(section, ())
            if u.dependencies is not None
        }

    def indicators(self) -> int:
        """Return the number of event indicators (FMI 3.0)."""
        return sum(self._size(self.find(u.variable)) for u in self._structure.get("EventIndicators", ()))

    def states(self, every: tuple[Variable, ...]) -> tuple[tuple[Variable, ...], tuple[Variable, ...]]:
        """Return states and derivatives in the order of the FMU's state vector.

        Args:
            every: all scalars.
        """
        listed = self._listed_derivatives()
        by_name = {v.name: v for v in every}
        derivatives = tuple(by_name[(v.name or "") + self._index(v, e)] for v in listed for e in range(self._size(v)))
        states: list[Variable] = []
        known: set[str | None] = set()
        for number, derivative in enumerate(derivatives, 1):
            state = by_name.get(derivative.derivative_of or "")
            if state is None or state.name in known:
                what = (
                    "does not name its state" if state is None else f"names {state.name}, as another does, as its state"
                )
                self.notes.append(f"derivative {derivative.name} {what}, which is called state[{number}]")
                state = Variable(name=f"state[{number}]")
            known.add(derivative.derivative_of)
            states.append(state)
        self._tell_of_others(states)
        return tuple(states), derivatives

    def _tell_of_others(self, states: Iterable[Variable]) -> None:
        """Say what begins at a start value, as a state does, and has a derivative that the model structure lacks."""
        known = {v.value_reference for v in states}
        pairs = [(v, self.find(v.derivative)) for v in self._declared if v.derivative is not None and self._has_states]
        others = [(v, x) for v, x in pairs if x.start is not None and x.value_reference not in known]
        if others:
            (derivative, begins), more = others[0], f" (and {len(others) - 1} more)" if len(others) > 1 else ""
            what = f"{derivative.name}, which the model structure does not list: it is taken for no state"
            self.notes.append(f"{begins.name} has a start value and the derivative {what}{more}")

    def _listed_derivatives(self) -> list[said.DeclaredVariable]:
        """Return the derivatives as they are listed, each once.

        Raises:
            FmuError: one has no type.
        """
        listed = {id(v): v for v in (self.find(u.variable) for u in self._structure.get("Derivatives", ()))}
        if len(listed) < len(self._structure.get("Derivatives", ())):
            self.notes.append("a derivative is listed twice, and taken once")
        for v in listed.values():
            if not self._usable(v):
                raise FmuError(f"line {v.line}: variable {v.name} is listed as a derivative, and has no type")
        return list(listed.values())

    # -- start values --

    def _starts(self, v: said.DeclaredVariable) -> list[Value | None]:
        """Return one start value an element."""
        size = self._size(v)
        texts = _words(v)
        if texts is None:
            return [None] * size
        convert = _STARTS.get(v.kind, int)
        try:
            values: list[Value | None] = [convert(text) for text in texts]
            if any(v in _INFINITE and re.search(r"\d", t) for v, t in zip(values, texts, strict=True)):
                raise OverflowError
        except (ValueError, OverflowError):
            shown = v.start if v.start is not None else " ".join(texts)
            self.notes.append(f"start value '{shown}' of {v.name} is not a valid {v.kind}; ignored")
            return [None] * size
        if len(values) == 1:
            return values * size
        if len(values) != size and not self._resized:
            self.notes.append(f"{v.name} has {len(values)} start values for {size} elements; ignored")
        return values if len(values) == size else [None] * size


_NO_TYPE = said.DeclaredType()
_INFINITE = (math.inf, -math.inf)  # which may be written, as INF; with digits it is a number that no computer has


def _words(v: said.DeclaredVariable) -> list[str] | None:
    """Return the texts of the start values: elements of FMI 3.0, a list with blanks, or one."""
    if v.starts:
        return [s.value or "" for s in v.starts]
    if v.start is None:
        return None
    return v.start.split() if v.dimensions and v.kind != "String" else [v.start]


def _boolean(text: str) -> bool:
    if text not in ("true", "false", "1", "0"):
        raise ValueError(text)
    return text in ("true", "1")


# How a start value is read, by type; those that are not here are whole numbers.
_STARTS: Mapping[str, Callable[[str], Value]] = {
    **dict.fromkeys((*FLOAT_TYPES, "Clock"), float),
    "Boolean": _boolean,
    "String": str,
    "Binary": str,
}
