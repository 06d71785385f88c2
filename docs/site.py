"""What the website has beside the pages of this folder.

MkDocs calls the functions below. The home page is the README, each robot has its own README, the
page of commands is the help of the command line, and links that lead out of this folder become
links between these pages.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

import click
import typer
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent

PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "robots/puma560/README.md": "robots/puma560.md",
    "robots/irb6700/README.md": "robots/irb6700.md",
}
"""Pages from outside this folder: their file, and their place on the website."""

_LINK = re.compile(r"(!?\[[^\]]*\])\(([^)#\s]+)(#[^)]*)?\)")

_KEY = re.compile(r"\[(\w+)\](?![(:\[])")
"""A source such as [AKB], which is not the text of a link."""


@event_priority(100)  # before the plugin that reads docstrings
def on_config(config: Any) -> None:
    """Lay out the packages as they are installed, so that the reference finds their docstrings."""
    package = ROOT / "build" / "reference" / "faultgen"
    package.mkdir(parents=True, exist_ok=True)
    for part in [*(ROOT / "faultgen").iterdir(), ROOT / "analysis"]:
        if not (package / part.name).exists() and part.name != "__pycache__":
            (package / part.name).symlink_to(part)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that lie elsewhere, their pictures and the page of commands."""
    for source, page in PAGES.items():
        text = (ROOT / source).read_text()
        for picture in sorted(set(re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text))):
            own = posixpath.normpath(posixpath.join(posixpath.dirname(source), picture))
            place = f"pictures/{own}"
            if not own.startswith("docs/") and files.get_file_from_path(place) is None:
                files.append(File.generated(config, place, content=(ROOT / own).read_bytes()))
        files.append(File.generated(config, page, content=_KEY.sub(r"\\[\1\\]", text)))
    files.append(File.generated(config, "reference/commands.md", content=_commands()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn links between files of the repository into links between pages."""
    here = page.file.src_uri
    source = {page: source for source, page in PAGES.items()}.get(here, f"docs/{here}")

    def link(match: re.Match[str]) -> str:
        text, target, anchor = match[1], match[2], match[3] or ""
        if "://" in target or target.startswith("mailto:"):
            return match[0]
        own = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        place = PAGES.get(own) or own.removeprefix("docs/")
        if files.get_file_from_path(place) is None:
            place = f"pictures/{own}"
        if files.get_file_from_path(place) is None:
            if (ROOT / own).exists():  # a file that is only in the repository
                return f"{text.strip('![]')} (`{own}`)"
            return match[0]
        return f"{text}({posixpath.relpath(place, posixpath.dirname(here) or '.')}{anchor})"

    return _LINK.sub(link, markdown)


def _commands() -> str:
    """The help of every command, as a page."""
    from faultgen.cli import app

    group = typer.main.get_command(app)
    lines = ["# Commands", "", "Every command explains itself with `--help`.", ""]
    for path, command in _all(group, "faultgen"):
        context = click.Context(command, info_name=path, max_content_width=76, terminal_width=76)
        lines += [f"## {path}", "", "```text", command.get_help(context), "```", ""]
    return "\n".join(lines)


def _all(group: Any, path: str) -> list[tuple[str, Any]]:
    found = []
    for name, command in group.commands.items():
        own = f"{path} {name}"
        found += _all(command, own) if hasattr(command, "commands") else [(own, command)]
    return found
