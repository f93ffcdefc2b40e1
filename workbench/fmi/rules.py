"""Rules of the FMI standard that its schemas cannot say: of variables, of the model structure, of names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping

from workbench.fmi.declared import Declared, DeclaredUnit, DeclaredVariable
from workbench.fmi.variable import FLOAT_TYPES

__all__ = ["broken_rules", "complete", "less_kept_rules", "structured_name"]

_PARAMETERS = ("parameter", "calculatedParameter", "structuralParameter")
_ANY = ("calculated", "exact", "approx")
# (causality, variability) → what `initial` may be, its default first: FMI 2.0.4, 2.2.7; FMI 3.0.1, 2.4.7.5.
_INITIAL: Mapping[tuple[str, str], tuple[str | None, ...]] = {
    **{(c, v): ("exact",) for c in ("parameter", "structuralParameter") for v in ("fixed", "tunable")},
    **{("calculatedParameter", v): ("calculated", "approx") for v in ("fixed", "tunable")},
    **{("input", v): ("exact",) for v in ("discrete", "continuous")},
    **{(c, "constant"): ("exact",) for c in ("output", "local")},
    **{(c, v): _ANY for c in ("output", "local") for v in ("discrete", "continuous")},
    **{("local", v): ("calculated", "approx") for v in ("fixed", "tunable")},
    ("independent", "continuous"): (None,),
}
_SHOWN = 5  # names in a message

Find = Callable[[int | None], DeclaredVariable]


def complete(declared: Declared) -> None:
    """Fill in what the standard says where the file says nothing, in FMI 2.0's words: causality, variability, initial.

    Args:
        declared: changed in place.
    """
    major = declared.major
    for v in declared.variables:
        v.causality = v.causality or "local"
        if major == 1:
            _as_in_fmi_2(v)
        v.variability = v.variability or _variability(v, major)
        if v.initial is None and major > 1:
            v.initial = _INITIAL.get((v.causality, v.variability), (None,))[0]


def _as_in_fmi_2(v: DeclaredVariable) -> None:
    if v.causality == "internal":
        v.causality = "local"
    if v.variability == "parameter":
        v.causality, v.variability = "parameter", "fixed"


def _variability(v: DeclaredVariable, major: int) -> str:
    if major < 3:
        return "continuous"
    if v.causality in _PARAMETERS:
        return "fixed"
    return "continuous" if v.kind in FLOAT_TYPES else "discrete"


# -- variables ---------------------------------------------------------------------------------


def broken_rules(declared: Declared) -> Iterator[str]:
    """Yield what is wrong with the variables: names, variability, causality, start values, units, references.

    Args:
        declared: after `complete`.
    """
    rules = [_of_variability(), _of_uniqueness(lambda v: v.name, "name")]
    if declared.major > 1:
        rules += [_of_causality(), _of_starts(), _of_units(declared)]
    if declared.major == 2:
        rules.append(_of_aliases())
    if declared.major > 2:
        rules.append(_of_uniqueness(lambda v: v.value_reference, "value reference"))
    for rule in rules:
        for v in declared.variables:
            problem = rule(v)
            if problem:
                yield f"line {v.line}: variable {v.name} {problem}"
    yield from _of_unit_names(declared)
    if declared.major > 2 and sum(v.causality == "independent" for v in declared.variables) != 1:
        yield "there must be exactly one independent variable"


def _of_unit_names(declared: Declared) -> Iterator[str]:
    known: dict[str | None, DeclaredUnit] = {}
    for unit in declared.units:
        if known.setdefault(unit.name, unit) != unit:
            yield f'the unit "{unit.name}" is defined twice, differently; the last one holds'


_Rule = Callable[[DeclaredVariable], str | None]


def _of_variability() -> _Rule:
    def rule(v: DeclaredVariable) -> str | None:
        if v.variability == "continuous" and v.kind not in FLOAT_TYPES:
            return f"is of type {v.kind}, which cannot be continuous"
        return None

    return rule


def _of_uniqueness(key: Callable[[DeclaredVariable], object], what: str) -> _Rule:
    seen: dict[object, DeclaredVariable] = {}

    def rule(v: DeclaredVariable) -> str | None:
        other = seen.setdefault(key(v), v)
        return None if other is v else f"has the {what} of {other.name} (line {other.line})"

    return rule


def _of_aliases() -> _Rule:
    """FMI 2.0.4, 2.2.7: of variables with one value, at most one has a start value, unless they are constants."""
    seen: dict[tuple[object, ...], DeclaredVariable] = {}

    def rule(v: DeclaredVariable) -> str | None:
        if v.start is None or v.variability == "constant":
            return None
        kind = "Integer" if v.kind == "Enumeration" else v.kind
        other = seen.setdefault((kind, v.value_reference), v)
        return None if other is v else f"has a start value, as has {other.name} of the same value reference"

    return rule


def _of_causality() -> _Rule:
    def rule(v: DeclaredVariable) -> str | None:
        allowed = _INITIAL.get((v.causality or "", v.variability or ""))
        if allowed is None:
            return f'has causality="{v.causality}" and variability="{v.variability}", which do not go together'
        if v.initial not in allowed:
            return f'has initial="{v.initial}", which a {v.variability} {v.causality} must not have'
        return None

    return rule


def _of_starts() -> _Rule:
    def rule(v: DeclaredVariable) -> str | None:
        given = v.start is not None or bool(v.starts)
        if given and (v.initial == "calculated" or v.causality == "independent"):
            return f"has a start value, which a {v.initial or v.causality} variable must not have"
        if not given and v.kind != "Clock" and (v.initial in ("exact", "approx") or v.causality == "input"):
            return "has no start value"
        return None

    return rule


def _of_units(declared: Declared) -> _Rule:
    units = {u.name: {d.name for d in u.display} for u in declared.units}
    types = {t.name: t for t in declared.types}

    def rule(v: DeclaredVariable) -> str | None:
        if v.declared_type is not None and v.declared_type not in types:
            return f'has the type "{v.declared_type}", which is not defined'
        unit = v.unit
        if unit is None and v.declared_type is not None:
            unit = types[v.declared_type].unit
        if unit is not None and unit not in units:
            return f'has the unit "{unit}", which is not defined'
        for shown in (v.display_unit, *(a.display_unit for a in v.aliases or ())):
            if shown is not None and shown not in units.get(unit, ()):
                return f'has the display unit "{shown}", which is not defined'
        return None

    return rule


# -- model structure and names -----------------------------------------------------------------


def less_kept_rules(declared: Declared, find: Find) -> Iterator[str]:
    """Yield what is wrong with the model structure and with names: many exporters bend these rules, few importers ask.

    Args:
        declared: after `complete`.
        find: returns the variable that an entry of the model structure means.
    """
    if declared.major > 1:
        yield from _of_dependencies(declared)
        yield from _of_outputs(declared, find)
        yield from _of_derivatives(declared, find)
        yield from _of_initial_unknowns(declared, find)
    if declared.root.variable_naming_convention == "structured":
        for v in declared.variables:
            if v.name is not None and not structured_name(v.name):
                yield f"line {v.line}: '{v.name}' is not a structured name"


def _of_dependencies(declared: Declared) -> Iterator[str]:
    for section, unknowns in declared.structure.items():
        for unknown in unknowns:
            if unknown.dependencies_kind is None:
                continue
            kinds, known = unknown.dependencies_kind.split(), unknown.dependencies
            if known is None or len(kinds) != len(known):
                number = "no" if known is None else len(known)
                yield f"line {unknown.line}: {section}: {len(kinds)} kinds for {number} dependencies"


def _of_outputs(declared: Declared, find: Find) -> Iterator[str]:
    wanted = [v for v in declared.variables if v.causality == "output"]
    yield from _differ("Outputs", wanted, _meant(declared, "Outputs", find))


def _meant(declared: Declared, section: str, find: Find) -> list[DeclaredVariable]:
    return [find(u.variable) for u in declared.structure.get(section, ())]


def _of_derivatives(declared: Declared, find: Find) -> Iterator[str]:
    for derivative in _meant(declared, "Derivatives", find):
        if derivative.derivative is None:
            yield f"line {derivative.line}: {derivative.name} is listed as a derivative, and does not say of what"


def _of_initial_unknowns(declared: Declared, find: Find) -> Iterator[str]:
    guessed = ("approx", "calculated")
    wanted = [
        v
        for v in declared.variables
        if v.causality == "calculatedParameter" or (v.causality == "output" and v.initial in guessed and not v.clocks)
    ]
    for derivative in _meant(declared, "Derivatives", find):
        state = [] if derivative.derivative is None else [find(derivative.derivative)]
        wanted += [v for v in (*state, derivative) if v.initial in guessed]
    yield from _differ("InitialUnknowns", wanted, _meant(declared, "InitialUnknowns", find))


def _differ(section: str, wanted: Iterable[DeclaredVariable], given: Iterable[DeclaredVariable]) -> Iterator[str]:
    want, have = ({id(v): v for v in some} for some in (wanted, given))
    for word, names in (
        ("lacks", [v.name for i, v in want.items() if i not in have]),
        ("must not list", [v.name for i, v in have.items() if i not in want]),
    ):
        if names:
            more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
            yield f"ModelStructure: {section} {word} {', '.join(map(str, names[:_SHOWN]))}{more}"


# FMI 2.0.4, 2.2.9.
_WORD = r"[_A-Za-z][_A-Za-z0-9]*"
_QUOTED = r"""'(?:[-_A-Za-z0-9!#$%&()*+,./:;<>=?@\[\]^{}|~ ]|\\['"?\\abfnrtv])+'"""
_PART = rf"(?:{_WORD}|{_QUOTED})(?:\[\d+(?:,\d+)*\])?"
_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"
_STRUCTURED = re.compile(rf"(?:{_IDENTIFIER}|der\({_IDENTIFIER}(?:,\d+)?\))\Z")


def structured_name(name: str) -> bool:
    """Whether a name keeps the structured naming convention: identifiers, dots, indices, one der( ).

    Args:
        name: of a variable.
    """
    return _STRUCTURED.match(name) is not None
