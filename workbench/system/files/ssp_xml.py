"""XML of SSP: safe parsing, and reading that does not mind namespaces (SSP 1.0, 2.0 and drafts differ in them)."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TypeAlias
from urllib.parse import unquote, urlsplit

from lxml import etree

from workbench.core.machine.files import content_of
from workbench.errors import InputError, shortened
from workbench.fmi.archive import DAMAGED

__all__ = [
    "NAMESPACES",
    "Element",
    "Files",
    "Package",
    "boolean",
    "children",
    "descend",
    "linear",
    "number",
    "parse",
    "root_of",
    "tag",
]

Element: TypeAlias = etree._Element  # noqa: SLF001 - lxml has no public name for it

_ROOT = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "ssd": f"{_ROOT}Description",
    "ssc": f"{_ROOT}Common",
    "ssv": f"{_ROOT}ParameterValues",
    "ssm": f"{_ROOT}ParameterMapping",
}
MAX_XML_BYTES = 64 << 20
_TOO_LARGE = f"{{}}: larger than {MAX_XML_BYTES >> 20} MiB; refused"


def parse(path: Path, expected: str) -> Element:
    """Return the root of an XML file.

    Args:
        path: of the file.
        expected: local name of the root.

    Raises:
        InputError: no such file, not well-formed, a document type, another root.
    """
    try:
        if path.stat().st_size > MAX_XML_BYTES:
            raise InputError(_TOO_LARGE.format(path.name))
        data = content_of(path)
    except OSError as error:
        raise InputError(f"{path.name}: cannot be read: {error.strerror or error}") from None
    return root_of(data, path.name, expected)


def root_of(data: bytes, name: str, expected: str) -> Element:
    """Return the root of the XML that a file holds.

    Args:
        data: its bytes.
        name: of the file, for messages.
        expected: local name of the root.

    Raises:
        InputError: see `parse`.
    """
    if len(data) > MAX_XML_BYTES:
        raise InputError(_TOO_LARGE.format(name))
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise InputError(f"{name}: is not well-formed XML: {error}") from None
    if root.getroottree().docinfo.doctype:
        raise InputError(f"{name}: declares a document type, as XML bombs do; refused")
    if tag(root) != expected:
        raise InputError(f"{name}: the root is '{tag(root)}', but '{expected}' is expected")
    return root


def tag(element: Element) -> str:
    """Return the local name of an element."""
    return str(etree.QName(element).localname)


def children(element: Element | None, *path: str) -> Iterator[Element]:
    """Yield the elements at a path of local names below `element`; none if that is None."""
    if element is not None:
        yield from element.iterfind("/".join(f"{{*}}{name}" for name in path))


def descend(element: Element | None, *path: str) -> Element | None:
    """Return the first element at a path of local names; None: there is none."""
    return next(children(element, *path), None)


def number(element: Element, attribute: str, default: float, where: str) -> float:
    """Return a number that an attribute holds.

    Raises:
        InputError: it holds none.
    """
    text = element.get(attribute)
    try:
        return default if text is None else float(text)
    except ValueError:
        raise InputError(f"{where}: {attribute}='{text}' is not a number") from None


def boolean(element: Element, attribute: str) -> bool:
    """Return an attribute of type xs:boolean, False where it is absent."""
    return (element.get(attribute) or "").strip() in ("true", "1")


def linear(element: Element, where: str) -> tuple[float, float]:
    """Return factor and offset of the LinearTransformation in an element; 1 and 0 where there is none.

    Raises:
        InputError: one of them is not a number.
    """
    result = descend(element, "LinearTransformation")
    if result is None:
        return 1.0, 0.0
    return number(result, "factor", 1.0, where), number(result, "offset", 0.0, where)


@dataclass(frozen=True)
class Package:
    """Where files are looked for.

    Attributes:
        folder: of the SSD.
        within: outside of this folder nothing may be read (an unpacked archive); None: anything may.
        called: what the user calls the archive.
    """

    folder: Path
    within: Path | None = None
    called: str = ""

    def name_of(self, path: Path) -> str:
        """Return what the user calls a file of an archive, by its place in it; empty: there is no archive."""
        return "" if self.within is None else f"{self.called}/{path.relative_to(self.within.resolve()).as_posix()}"

    def file(self, source: str, where: str) -> Path:
        """Return the file that a relative URI names.

        Args:
            source: the URI.
            where: for messages.

        Raises:
            InputError: not relative, outside of the package, or no such file.
        """
        try:
            uri = urlsplit(source)
            if uri.scheme or uri.netloc:
                raise InputError(
                    f"{where}: source '{source}' is not a file in the package; only relative paths are read"
                )
            inside = PurePosixPath(unquote(uri.path).replace("\\", "/"))
            path = (self.folder / inside).resolve()
            path.exists()
        except (OSError, ValueError):  # a name that no file can have
            raise InputError(f"{where}: source '{shortened(source)}' is not the name of a file") from None
        if self.within is not None and not path.is_relative_to(self.within.resolve()):
            raise InputError(f"{where}: source '{source}' leads out of the package; refused")
        if not path.exists():
            place = self.folder if self.within is None else "the package"
            raise InputError(f"{where}: the file '{source}' is missing in {place}")
        return path


@dataclass(frozen=True)
class Files:
    """Where the files of a component's parameters are: beside the SSD, or inside the component.

    Attributes:
        package: of the SSD.
        component: source of the component; None: a system has none.
    """

    package: Package
    component: str | None

    def root(self, element: Element, source: str, expected: str, where: str) -> Element:
        """Return the root of the XML file that an element names.

        Args:
            element: with the attribute `sourceBase`.
            source: the file's URI.
            expected: local name of the root.
            where: for messages.

        Raises:
            InputError: no such file, or it is broken.
        """
        if element.get("sourceBase") != "component":
            return parse(self.package.file(source, where), expected)
        if self.component is None:
            raise InputError(
                f"{where}: sourceBase='component' needs a component that is a file, and this is a system; "
                f"put '{source}' beside the SSD"
            )
        inside = self.package.file(self.component, where)
        if inside.is_dir():
            return parse(Package(inside, within=inside).file(source, where), expected)
        name = PurePosixPath(unquote(urlsplit(source).path)).as_posix()
        try:
            with zipfile.ZipFile(inside) as archive:
                if archive.getinfo(name).file_size > MAX_XML_BYTES:
                    raise InputError(f"{where}: {name} is larger than {MAX_XML_BYTES >> 20} MiB; refused")
                data = archive.read(name)
        except KeyError:
            raise InputError(f"{where}: the file '{source}' is missing in {self.component}") from None
        except (*DAMAGED, OSError, RuntimeError, NotImplementedError) as error:
            raise InputError(f"{where}: {self.component} cannot be read: {error}") from None
        return root_of(data, name, expected)
