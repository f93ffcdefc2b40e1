"""Hooks of ProperDocs: generated pages, formulas as MathML, and a look at what the built pages would fetch."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from properdocs.config.defaults import ProperDocsConfig
from properdocs.exceptions import PluginError
from properdocs.plugins import event_priority
from properdocs.structure.files import File, Files
from properdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # the workbench and `docs` of this checkout

from docs.tools.command_pages import command_names, command_page
from docs.tools.mathematics import with_mathml
from docs.tools.python_pages import python_page, python_pages
from docs.tools.record_keys import with_keys
from docs.tools.study_pages import requirements_page
from docs.tools.target_pages import targets_page
from workbench import __version__

__all__ = ["on_config", "on_files", "on_page_content", "on_page_markdown", "on_post_build"]

_COMMANDS, _PYTHON = "commands (generated)", "python (generated)"
_FETCHED = re.compile(r"<(?:script|img|iframe|link)\b[^>]*?\b(?:src|href)=[\"']?((?:https?:)?//[^\"' >]+)[^>]*>")
_PICTURE = re.compile(r"<img\b[^>]*?\bsrc=[\"']?([^\"' >]+)")
_STYLE = re.compile(r"url\(\s*[\"']?(?:https?:)?//|@import\s+[\"']?(?:https?:)?//")


def on_config(config: ProperDocsConfig) -> ProperDocsConfig:
    """Put the version into the head, and the generated pages in their places of the navigation."""
    config.site_name = f"{config.site_name} {__version__}"
    pages = {
        _COMMANDS: [{name: f"reference/commands/{name}.md"} for name in command_names()],
        _PYTHON: [{title: f"reference/python/{page}.md"} for page, title in python_pages().items()],
    }
    config.nav = _expanded(config.nav or [], pages)
    return config


def _expanded(nav: list[object], pages: dict[str, list[dict[str, str]]]) -> list[object]:
    found: list[object] = []
    for item in nav:
        if isinstance(item, str) and item in pages:
            found += pages[item]
        elif isinstance(item, dict):
            found.append({k: _expanded(v, pages) if isinstance(v, list) else v for k, v in item.items()})
        else:
            found.append(item)
    return found


def on_files(files: Files, config: ProperDocsConfig) -> Files:
    """Add the generated pages."""
    texts = {f"reference/commands/{name}.md": command_page(name) for name in command_names()}
    texts |= {f"reference/python/{page}.md": python_page(page) for page in python_pages()}
    texts |= {"reference/requirements.md": requirements_page(), "reference/targets.md": targets_page()}
    for path, text in texts.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: ProperDocsConfig, files: Files) -> str:  # noqa: ARG001 - see below
    """Put the tables of keys in their places."""
    return with_keys(markdown)


def on_page_content(html: str, page: Page, config: ProperDocsConfig, files: Files) -> str:  # noqa: ARG001 - as ProperDocs calls it
    """Draw the formulas."""
    try:
        return with_mathml(html)
    except ValueError as error:
        raise PluginError(f"{page.file.src_uri}: {error}") from None


@event_priority(-200)  # after the plug-in that writes the index
def on_post_build(config: ProperDocsConfig) -> None:
    """Refuse pages that fetch from elsewhere, show a picture that is not there, or need a server to be searched."""
    site = Path(config.site_dir)
    if not (site / "search" / "search_index.js").is_file():
        raise PluginError("the site cannot be searched from a folder: properdocs.yml needs the plug-in offline")
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        for found in _FETCHED.finditer(text):
            if 'rel="canonical"' not in found.group() and 'rel="edit"' not in found.group():
                raise PluginError(f"{path.relative_to(site)} fetches {found.group(1)}; pages must stand alone")
        for source in _PICTURE.findall(text):
            if not source.startswith("data:") and not (path.parent / source).is_file():
                raise PluginError(f"{path.relative_to(site)} shows {source}, which is not there")
    for path in site.rglob("*.css"):
        if _STYLE.search(path.read_text(encoding="utf-8")):
            raise PluginError(f"{path.relative_to(site)} fetches from elsewhere; pages must stand alone")
