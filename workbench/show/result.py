"""Results: records that are shown. Each class names the functions that make its page and its picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from workbench import __version__
from workbench.core.machine.files import file_path
from workbench.core.records.named import named
from workbench.core.records.record import Record, plain
from workbench.errors import InputError, one_line, visible
from workbench.requests.kept import origin_of
from workbench.requests.origin import Origin
from workbench.show.facts import finished, point_facts
from workbench.show.page import SUFFIXES, Page, write_page
from workbench.show.stmd import write_stmd
from workbench.show.svg import svg_of
from workbench.show.terminal import text_of
from workbench.show.verdicts import worst_first

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Reportable", "Result", "drawn", "line_of", "notebook_of", "page_of", "picture_of", "write_report"]

_VERDICTS = 6  # of a result in a notebook; the others are folded
_LINE = 200  # characters of a result in one line


class Reportable:
    """What can be drawn and written as a page, by functions of its own folder that it names ("module:function")."""

    _page: ClassVar[str] = ""
    _picture: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):  # a dataclass leaves it as it is then
            cls.__repr__ = Reportable.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return one line: what it is, and its page's first sentence."""
        return line_of(self)

    def _repr_html_(self) -> str:
        """Return the page for a notebook."""
        return notebook_of(self)

    def plot(self, path: str | Path | None = None, *, axes: Axes | Sequence[Axes] | None = None) -> Figure:
        """Draw the result.

        Args:
            path: also write the picture here; png, svg or pdf by suffix.
            axes: to draw on, as many as the picture has panels, row by row; their figure is returned. None: a figure of
                its own.

        Raises:
            InputError: unknown suffix, file cannot be written, another number of axes.
        """
        return picture_of(self, path, axes)

    def report(self, path: str | Path) -> None:
        """Write a page that stands alone: what was asked, on which FMU, pictures, tables, versions, the data as JSON.

        Args:
            path: path of the page, .html.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        write_report(self, path)


class Result(Record, Reportable):
    """What an analysis returns: a record that is shown."""


def drawn(
    name: str, path: str | Path | None, *shown: object, axes: Axes | Sequence[Axes] | None = None, **options: object
) -> Figure:
    """Return a picture; matplotlib, which is slow to import, is imported then.

    Args:
        name: "module:function" that draws it.
        path: also write the picture here; png, svg or pdf by suffix.
        shown: what the function draws.
        axes: of the caller, to draw on; None: a figure of its own.
        options: it is told.

    Raises:
        InputError: unknown suffix, file cannot be written, or the function refuses.
    """
    from workbench.show.figure import on_axes, save, with_point  # noqa: PLC0415 - matplotlib

    figure: Figure
    if path is not None:
        file_path(path, otherwise="give axes of your own as `axes`")  # said before the picture is drawn
    if axes is None:
        figure = with_point(named(name)(*shown, **options), shown[0])
    else:
        with on_axes(axes) as figure:
            named(name)(*shown, **options)
    if path is not None:
        save(figure, path)
    return figure


def picture_of(result: object, path: str | Path | None, axes: Axes | Sequence[Axes] | None = None) -> Figure:
    """Draw the picture of a result.

    Args:
        result: whose class names one.
        path: also write the picture here; png, svg or pdf by suffix.
        axes: of the caller, to draw on; None: a figure of its own.

    Raises:
        InputError: it has no picture, unknown suffix, file cannot be written.
    """
    return drawn(_function(result, "picture"), path, result, axes=axes)


def page_of(result: object, **notes: object) -> Page:
    """Return what a result says of itself, without how it was made.

    Args:
        result: whose class names a page.
        **notes: what the function of its page can be told.

    Raises:
        InputError: it has no page.
    """
    page: Page = named(_function(result, "page"))(result, **notes)
    return page


def _function(result: object, what: str) -> str:
    """Return the name of the function that makes the "page" or the "picture" of a result."""
    name: str = getattr(result, f"_{what}", "")
    if not name:
        raise InputError(f"{type(result).__name__} has no {what}")
    return name


def line_of(result: object) -> str:
    """Return what a result is in one line; one that is put together by hand may be too incomplete for a page.

    Args:
        result: any.
    """
    name = type(result).__name__
    try:
        page = page_of(result)
    except Exception:  # noqa: BLE001 - whatever is missing: a debugger shows such objects, too
        return f"<{name}>"
    text = one_line(f"{name}: {page.title}. {page.lead}")
    return f"<{text if len(text) <= _LINE else f'{text[: _LINE - 1]}…'}>"


def notebook_of(result: object) -> str:
    """Return the page of a result for a notebook: what was found, the first picture, the rest folded.

    Args:
        result: whose class names a page.
    """
    page = page_of(result)
    figures = [figure for section in page.sections for figure in section.figures][:1]
    pictures = [svg_of(draw(), "workbench", words) for draw, words in figures]
    verdicts = "".join(f"<li>{escape(v.word)}: {escape(v.text)}</li>" for v in worst_first(page.summary)[:_VERDICTS])
    return "".join(
        [
            f"<strong>{escape(visible(page.title))}</strong><p>{escape(visible(page.lead))}</p>",
            f"<ul>{visible(verdicts)}</ul>" if verdicts else "",
            *pictures,
            "<details><summary>facts and values</summary>",
            f'<pre style="overflow-x:auto">{escape(text_of(page, None))}</pre></details>',
        ]
    )


def write_report(result: object, path: str | Path, origin: Origin | None = None) -> None:
    """Write the page of a result, and beside it the same facts as traceability metadata (STMD).

    Args:
        result: whose class names a page, or a page that was made already.
        path: of the page, .html.
        origin: how the result was made; None: what it remembers.

    Raises:
        InputError: it has no page, another suffix, or the file cannot be written.
    """
    if file_path(path).suffix.lower() not in SUFFIXES:  # said before the pictures are drawn
        raise InputError(f"{path}: a report is a page; name it {SUFFIXES[0]}")
    known = origin or origin_of(result) or Origin()
    page = result if isinstance(result, Page) else page_of(result)
    data = _data(result, page, known)
    page = finished(replace(page, facts={**page.facts, **point_facts(data), **page.facts}), known)
    write_page(replace(page, data=data), path)
    write_stmd(page, known, path)


def _data(result: object, page: Page, origin: Origin) -> Mapping[str, Any]:
    """Return what is embedded: what the command line writes to JSON, or the same made of the result itself."""
    if origin.data is not None:
        return origin.data
    own = page.data or getattr(result, "to_dict", dict)()
    model = origin.models[0] if origin.models else None
    who = {} if model is None else {"model": model.name, "interface": model.interface, "solver": model.solver}
    full: Mapping[str, Any] = plain(
        {"command": origin.command, "version": __version__, "seconds": origin.seconds, **who, **own}
    )
    return full
