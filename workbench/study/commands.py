"""The commands that do a study's analyses, and the options that a table of TOML gives to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from workbench.commands import COMMANDS as EVERY
from workbench.commands import request_of
from workbench.core.records.option import DeclaredOption, options_of, parts_of, put_together
from workbench.errors import InputError, suggest
from workbench.model.loading import Loading
from workbench.requests.request import Request, asked_options
from workbench.show.files_written import Written, written_of

__all__ = ["COMMANDS", "Command", "Reference", "command", "filled", "meant", "references"]

COMMANDS = EVERY.without("run", "schema", "ui")
_MODEL = "model"
_ON_MODELS = (_MODEL, "models")
_KINDS = {float: "a number", int: "a whole number", str: "text"}


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What another analysis wrote, in place of a file.

    Attributes:
        analysis: its name.
        kind: "json" for its result, "csv", or what follows NAME_ in the name of a further CSV file.
    """

    analysis: str
    kind: str = "json"

    @property
    def file(self) -> str:
        """The name that the file would have."""
        return f"{self.analysis}.{self.kind}" if self.kind in ("json", "csv") else f"{self.analysis}_{self.kind}.csv"


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command.

    Attributes:
        name: of its request, see `workbench.commands.REQUESTS`.
        subject: key of what it works on.
        request: what is run.
        options: key in a study → name and option.
        written: what its record can be written to.
    """

    name: str
    subject: str
    request: type[Request[Any, Any]]
    options: Mapping[str, tuple[str, DeclaredOption]]
    written: type[Written]

    @property
    def on_models(self) -> bool:
        """Whether it works on models."""
        return self.subject in _ON_MODELS

    @property
    def several(self) -> bool:
        """Whether it works on several of them."""
        return self.request.subject.several

    def chosen(self, table: Mapping[str, Any]) -> bool:
        """Return whether a table asks for this one, if its command has several.

        Args:
            table: key → value as TOML has it.
        """
        flag = self.request.chosen_by.lstrip("-")
        return bool(table.get(flag)) if flag else self.subject in table

    @property
    def head(self) -> list[str]:
        """Words with which its command line begins."""
        return [self.request.command, *filter(None, [self.request.chosen_by])]

    def key(self, given: str) -> str:
        """Return the key as the command spells it; underscores stand for hyphens.

        Raises:
            InputError: there is no such option.
        """
        for key in (given, given.replace("_", "-")):
            if key in self.options or key == self.subject:
                return key
        if given == self.request.subject.spelt:
            return self.subject
        raise InputError(f"key '{given}' is not an option of '{self.request.command}'; {suggest(given, self.options)}")

    def values(self, table: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of a request's options by name.

        Args:
            table: key → value as TOML has it; keys of other options are passed over.

        Raises:
            InputError: a value that its option cannot take.
        """
        known = ((key, value, *self.options[key]) for key, value in table.items() if key in self.options)
        return {name: _value(key, declared, value) for key, value, name, declared in known}

    def table(self, key: str, value: Any) -> Mapping[str, Any]:  # noqa: ANN401 - what TOML can hold
        """Return what is given for `set` or `bias` as a table.

        Raises:
            InputError: it is not a table.
        """
        result = value if isinstance(value, Mapping) else next(iter(self.values({key: value}).values()), None)
        if not isinstance(result, Mapping):
            raise InputError(f"key '{key}' takes a table, as in {{NAME = VALUE}}, where the model has one, too")
        return result

    def words(self, key: str, value: Any) -> list[str]:  # noqa: ANN401 - what TOML can hold
        """Return the words by which a command line gives an option.

        Args:
            key: of the option, or of the subject.
            value: as TOML has it.

        Raises:
            InputError: a value that the option cannot take.
        """
        declared = None if key == self.subject else self.options[key][1]
        if declared is not None and not any(references(value)):
            result = _value(key, declared, value)
            if not _as_text(declared, value):
                return declared.write(result)
        if isinstance(value, bool):
            return [f"--{key}" if value else f"--no-{key}"]
        texts = _texts(filled(value, lambda reference: reference.file))
        return texts if key == self.subject else [f"--{key}={text}" for text in texts]

    def asks(self, table: Mapping[str, Any]) -> dict[str, list[str]]:
        """Return name → words of what is asked for, the same for all ways of writing it; defaults are left out.

        Args:
            table: key → value as TOML has it, references in it.

        Raises:
            InputError: a value that its option cannot take.
        """
        result = {}
        for key, value in table.items():
            name, declared = (key, None) if key == self.subject else self.options[key]
            if declared is None or any(references(value)):
                result[name] = self.words(key, value)
            elif not self._usual(name, declared, taken := _value(key, declared, value)):
                result[name] = declared.write(taken)
        return result

    def _usual(self, name: str, declared: DeclaredOption, value: Any) -> bool:  # noqa: ANN401 - of this option
        """Return whether a value is that of an option which is not given."""
        usual = declared.default
        if name == "tolerance" and name not in {d.name for d in options_of(self.request)}:
            usual = self.request.usual_tolerance  # the model's
        return value is None or (usual is not None and declared.write(value) == declared.write(usual))

    def check(self, table: Mapping[str, Any]) -> None:
        """Look for mistakes before anything runs; an option whose value another analysis gives is left out.

        Args:
            table: key → value as TOML has it, references in it.

        Raises:
            InputError: an option is missing, or has a value that it cannot have.
        """
        given = {self.options[key][0] for key in table if key in self.options}
        for key, (name, declared) in self.options.items():
            if declared.required and name not in given:
                raise InputError(f"key '{key}' is missing: {declared.help}")
        subject = self.request.subject
        if not (self.on_models or self.subject in table or subject.optional):
            raise InputError(f"key '{self.subject}' is missing: {subject.words}")
        if not any(references(table)):
            self.asked(table)

    def asked(self, table: Mapping[str, Any]) -> tuple[Request[Any, Any], Written, Loading]:
        """Return the request, what its record is written to, and how its model is opened.

        Args:
            table: key → value as TOML has it.

        Raises:
            InputError: a value that its option cannot have.
        """
        if table.get("order") == "ask":
            raise InputError("key 'order': nobody can be asked in a study; give a number or auto")
        values = self.values(table)
        request, written = put_together(self.request, values), put_together(self.written, values)
        written.check(request)
        return request if written.report is None else request.for_page(), written, self.request.loading(values)


def meant(name: str, table: Mapping[str, Any]) -> Command:
    """Return what a table of a study asks a command for.

    Args:
        name: one of `COMMANDS`.
        table: key → value as TOML has it.
    """
    known = [command(request) for request in EVERY[name]]
    return next((c for c in known[1:] if c.chosen(table)), known[0])


@cache
def command(name: str) -> Command:
    """Return what is known of a request by its name, see `workbench.commands.REQUESTS`."""
    request = request_of(name)
    subject = _MODEL if request.subject.metavar == _MODEL.upper() else request.subject.spelt
    written = written_of(request)
    every = {n: d for n, (d, _) in asked_options(request).items()}
    every |= {d.name: d for d, _ in parts_of(written) if d.name not in request.unwritten}
    options = {f.lstrip("-"): (n, d) for n, d in every.items() for f in (d.flag, d.option.also) if f}
    return Command(name=name, subject=subject, request=request, options=options, written=written)


# -- values ------------------------------------------------------------------------------------


def _value(key: str, declared: DeclaredOption, value: Any) -> Any:  # noqa: ANN401 - what TOML can hold, or its option
    """Return the value of an option from what TOML holds: typed, or as text as on the command line."""
    form = declared.form
    if form is None:
        if not isinstance(value, bool):
            raise InputError(f"key '{key}' is true or false, not {value!r}")
        return value
    kind = declared.option.metavar or _KINDS.get(declared.type, form.metavar)
    if isinstance(value, bool):
        raise InputError(f"key '{key}' takes a value ({kind}), not {str(value).lower()}")
    if isinstance(value, Mapping) and not ("object" in form.items or form.layout.inner is not None):
        raise InputError(f"key '{key}' is not a table; it takes {kind}")
    if isinstance(value, list) and not (form.repeated or form.layout.kind in {"list", "span"}):
        raise InputError(f"key '{key}' takes one value, not a list")
    try:
        return declared.checked(form.parts(value))
    except InputError as error:
        text = str(error).removeprefix(f"{declared.name}: ").removeprefix(f"{declared.name} ")
        raise InputError(f"key '{key}': {text}") from None
    except ValueError as error:
        raise InputError(f"key '{key}': {error}") from None


def _as_text(declared: DeclaredOption, value: Any) -> bool:  # noqa: ANN401
    """Return whether a value is written as on the command line already: names of files stay as they are there."""
    several = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
    return isinstance(value, str) or (
        declared.repeated and bool(several) and all(isinstance(item, str) for item in several)
    )


def references(value: Any) -> Iterator[Reference]:  # noqa: ANN401 - what TOML can hold, references in it
    """Yield the references in a value."""
    if isinstance(value, Reference):
        yield value
    elif isinstance(value, Mapping | list):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from references(item)


def filled(value: Any, fill: Callable[[Reference], str]) -> Any:  # noqa: ANN401
    """Return a value with a text in place of each reference.

    Args:
        value: what TOML can hold, references in it.
        fill: reference → text.
    """
    if isinstance(value, Mapping):
        return {key: filled(item, fill) for key, item in value.items()}
    if isinstance(value, list):
        return [filled(item, fill) for item in value]
    return fill(value) if isinstance(value, Reference) else value


def _texts(value: Any) -> list[str]:  # noqa: ANN401 - what TOML can hold
    """Return a value as a program's command takes it: a text each time the option stands there."""
    if isinstance(value, list):
        return [_text(item) for item in value]
    if isinstance(value, Mapping):
        return [f"{name}={_text(v)}" for name, v in value.items()]
    return [_text(value)]


def _text(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, list):
        return ":".join(map(_text, value))
    return str(value).lower() if isinstance(value, bool) else str(value)
