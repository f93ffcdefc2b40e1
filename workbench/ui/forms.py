"""The form of a request: what it can be asked for, as the browser shows it, and a request from what was filled in."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from workbench.commands import GROUPS, REQUESTS, request_of
from workbench.core.records.option import DeclaredOption, Option
from workbench.errors import InputError
from workbench.model.loading import Loading
from workbench.requests.request import Request, asked_options, request_from
from workbench.ui.root import NotHereError, ServedFolder
from workbench.ui.studies import RunStudy

__all__ = [
    "FILED", "MEASURED", "OFFERED", "FormError", "form_of", "in_the_form", "kind_named", "request_of_form",
    "without_flags",
]  # fmt: skip

# Commands that a model's page offers, in their order; the others take blocks or files of data, or write FMUs.
_OTHERS = {"info", "blocks", "identify", "fit", "build", "compile", "export", "compare", "envelope"}
MEASURED = tuple(name for name in REQUESTS if name not in _OTHERS)
FILED = ("identify", "fit", "build", "compile", "export")  # whose forms stand on pages of files

OFFERED = (*MEASURED, *FILED, "info", "envelope", RunStudy.command)  # what is begun for a browser

# Command → what a person wants to know, in plain words.
_QUESTIONS: Mapping[str, str] = {
    "check": "Does it do what it declares?",
    "delays": "Where are signals delayed, and what does it cost?",
    "simulate": "How does it move in time?",
    "trim": "Where is it at rest?",
    "lin": "What is its linear model: poles, response, matrices?",
    "modes": "At which parameter does a mode become unstable?",
    "nfr": "How does it respond to sines of real amplitude?",
    "branches": "Does its response jump from one motion to another?",
    "bla": "How does it respond to noise, and how linear is that?",
    "loop": "What are the margins of this loop?",
    "robust": "Does it stay stable for all parameters in their ranges?",
    "limit-cycle": "Does it oscillate by itself?",
    "onset": "From which amplitude on does a rate limit act?",
    "feedback": "Which feedback removes an oscillation?",
    "feed-forward": "Which filter cancels an oscillation?",
    "excite": "Record data to identify a model from",
    "calibrate": "Which parameters does a measurement tell?",
    "tune": "Which parameters meet the requirements of a study?",
    "identify": "What is the model behind these data?",
    "fit": "What is the model behind this response?",
    "build": "Make an FMU of this Modelica model",
    "compile": "Compile the sources of this FMU",
    "export": "Make an FMU of this model",
}

_LABELS = {"at": "Operating point"}  # of options whose names say less
_SWITCH, _NUMBER, _WHOLE, _CHOICE, _TEXT, _LIST = "switch", "number", "whole", "choice", "text", "list"
_TYPES: Mapping[Any, str] = {bool: _SWITCH, float: _NUMBER, int: _WHOLE}
# What runs elsewhere, or is written beside the page that the browser shows.
_WITHOUT = {"in_process", "scheduler", "tls"}
_NEW = {"store", "out"}  # what these options name need not be there yet
_WRITTEN = "out"  # what this one names must not be: nothing is overwritten


class FormError(InputError):
    """Fields that cannot be used.

    Attributes:
        fields: name of an option → what is wrong with it, in a line; "" is the form as a whole.
    """

    def __init__(self, fields: Mapping[str, str]) -> None:
        super().__init__("; ".join(fields.values()))
        self.fields = dict(fields)


def kind_named(command: str) -> type[Request[Any, Any]]:
    """Return the class of what a command asks for.

    Args:
        command: one of `OFFERED`.
    """
    return RunStudy if command == RunStudy.command else request_of(command)


def form_of(command: str) -> dict[str, Any]:
    """Return the fields of a command's request, ready for JSON.

    Args:
        command: one of `REQUESTS`.
    """
    request = kind_named(command)
    first, *_ = inspect.cleandoc(request.__doc__ or "").split("\n\n")
    return {
        "command": command,
        "words": [request.command, *filter(None, [request.chosen_by])],
        "question": _QUESTIONS.get(command, " ".join(first.split())),
        "theme": next((group for group, commands in GROUPS.items() if command in _named_in(commands)), "More"),
        "help": " ".join(first.split()),
        "counts": request.counts,
        "of_system": request.of_system,
        "fields": [
            _field(name, d, without_flags(request, group), needed=name in request.needs)
            for name, (d, group) in _options(request).items()
        ],
    }


def _named_in(commands: Mapping[str, Mapping[str, str]]) -> set[str]:
    return {name for requests in commands.values() for name in requests}


def _options(request: type[Request[Any, Any]]) -> dict[str, tuple[DeclaredOption, str]]:
    return {
        name: (declared, group) for name, (declared, group) in asked_options(request).items() if name not in _WITHOUT
    }


def _label(name: str) -> str:
    """Return what stands above a field."""
    return _LABELS.get(name) or name.replace("_", " ").strip().capitalize()


def _field(name: str, declared: DeclaredOption, group: str, *, needed: bool) -> dict[str, Any]:
    option = declared.option
    needed = needed or declared.required
    default = [] if needed or declared.default in (None, (), {}) else declared.write(declared.default)
    return {
        "name": name,
        "label": _label(name),
        "flag": declared.flag,
        "kind": _kind(declared),
        "help": " ".join([option.help, *_range(option)]),
        "unit": option.unit,
        "sample": _sample(declared),
        "choices": list(declared.choices),
        "group": group,
        "first": option.first,
        "required": needed,
        "default": declared.default if declared.type is bool else ", ".join(t.partition("=")[2] for t in default),
    }


def _sample(declared: DeclaredOption) -> str:
    """Return what stands in a field that is empty and has no default."""
    form, own = declared.form, declared.option.metavar
    if form is not None and form.example and (not own or form.metavar.count(":") == own.count(":")):
        return f"e.g. {form.example}"
    # A letter says nothing of a number, and a word no more of a choice.
    return own if declared.type is str else "" if _kind(declared) != _TEXT else declared.metavar


def _range(option: Option) -> Iterator[str]:
    """Yield what values an option takes, a sentence each."""
    if option.positive:
        yield "Positive."
    elif option.least is not None:
        yield f"At least {option.least:g}."
    if option.below is not None:
        yield f"Less than {option.below:g}."


def _kind(declared: DeclaredOption) -> str:
    if declared.repeated:
        return _LIST
    return _CHOICE if declared.choices else _TYPES.get(declared.type, _TEXT)


def request_of_form(command: str, given: Mapping[str, Any], root: ServedFolder) -> tuple[Request[Any, Any], Loading]:
    """Return a request from what was filled in.

    Args:
        command: one of `REQUESTS`.
        given: name of an option → text, texts of a list, or true and false of a switch; an empty text: not given.
        root: in which files lie.

    Raises:
        FormError: fields that cannot be used.
    """
    request = kind_named(command)
    options = _options(request)
    wrong = {name: "there is no such option" for name in given if name not in options}
    values: dict[str, Any] = {}
    for name, (declared, _) in options.items():
        try:
            value = _given(declared, given.get(name))
            if value is not None:
                _check_files(declared, value, root, name)
                declared.read(value)
                values[name] = value
            elif declared.required or name in request.needs:
                wrong[name] = "is needed"
        except InputError as error:
            wrong[name] = in_the_form(request, str(error))[1]
        except NotHereError as error:
            wrong[name] = str(error)
    # What does not go together is told beside what is wrong by itself; in the place of that stands what can be read.
    stand_in = {name: _stand_in(options[name][0]) for name in wrong if name in options}
    try:
        asked = request_from(request, {**stand_in, **values})
    except InputError as error:
        name, words = in_the_form(request, str(error))
        raise FormError({name: words, **wrong}) from None
    if wrong:
        raise FormError(wrong)
    return asked


def _check_files(declared: DeclaredOption, value: Any, root: ServedFolder, name: str) -> None:  # noqa: ANN401 - of a form
    """Refuse files that are not in the folder, and to write one that is.

    Raises:
        NotHereError: what is told of the first one.
        InputError: the file exists.
    """
    if declared.form is None:
        return
    for file in declared.form.files(value if isinstance(value, list) else [value]):
        path = root.find(file, new=name in _NEW)
        if name == _WRITTEN and (root.folder / path).exists():
            raise InputError(f"{file} exists already; choose another name")


def _stand_in(declared: DeclaredOption) -> Any:  # noqa: ANN401 - of a form
    """Return a value that an option can have; None: none is known."""
    for text in ("1", "1:2", "1=1", "1=1:2"):
        with suppress(InputError):
            given = _given(declared, [text])
            declared.read(given)
            return given
    return None


def in_the_form(request: type[Request[Any, Any]], message: str) -> tuple[str, str]:
    """Return which option a message is about (empty: none), and the message as it stands at its field.

    Options have the names of their fields; the one that the message begins with is not said again.

    Args:
        request: class of what was asked for.
        message: as the command line shows it.
    """
    options = _options(request)
    name = _named(message, options)
    message = without_flags(request, message)
    if name:
        own = {_label(name), *_spoken(options[name][0])}
        message = re.sub(rf"^({'|'.join(map(re.escape, sorted(own, key=len, reverse=True)))}): +", "", message)
    return name, message


def without_flags(request: type[Request[Any, Any]], message: str) -> str:
    """Return a message with the names of fields in place of the command line's options."""
    options = _options(request)
    for flag, label in sorted(((d.flag, _label(name)) for name, (d, _) in options.items()), key=lambda f: -len(f[0])):
        message = re.sub(rf"{re.escape(flag)}(?![\w-])", label, message)
    return re.sub(r"`(\w+)`", lambda match: _label(match[1]) if match[1] in options else match[1], message)


def _spoken(declared: DeclaredOption) -> set[str]:
    """Return by which names messages speak of an option."""
    words = declared.name.replace("_", " ")
    one = re.sub("ies$", "y", words) if words.endswith("ies") else words.removesuffix("s")
    return {declared.flag, declared.flag.removeprefix("--"), declared.name, words, one}


def _given(declared: DeclaredOption, value: Any) -> Any:  # noqa: ANN401 - of a form
    """Return what a command line would give for what a form holds; None: nothing."""
    kind = _kind(declared)
    if kind == _SWITCH:
        return None if value is None else bool(value)
    texts = [str(text).strip() for text in (value if isinstance(value, list) else [value]) if text is not None]
    texts = [text for text in texts if text]
    return None if not texts else texts if kind == _LIST else texts[0]


def _named(message: str, options: Mapping[str, tuple[DeclaredOption, str]]) -> str:
    """Return the option that a message begins with, or the only one that it names; empty: none."""
    begun = [
        (len(word), name)
        for name, (declared, _) in options.items()
        for word in _spoken(declared)
        if re.match(rf"{re.escape(word)}(:| )", message)
    ]
    named = {name: rf"(?<!\w){re.escape(d.flag)}(?![\w-])|`{re.escape(name)}`" for name, (d, _) in options.items()}
    flags = [name for name, pattern in named.items() if re.search(pattern, message)]
    return max(begun, default=(0, flags[0] if len(flags) == 1 else ""))[1]
