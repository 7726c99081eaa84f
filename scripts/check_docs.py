"""Checks the documents: links and anchors resolve, the commands, make targets and Python names they show exist.

python scripts/check_docs.py        # lists what is wrong, one a line; exit code 1 if anything is
"""

import ast
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from poseloom.cli._app import build_app

ROOT = Path(__file__).resolve().parents[1]
FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`([^`\n]+)`")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ +(.+?) *#*$", re.MULTILINE)


def documents() -> list[Path]:
    """The project's Markdown files."""
    folders = ("docs", "examples", "tests", "src")
    return sorted([*ROOT.glob("*.md"), *(path for folder in folders for path in (ROOT / folder).rglob("*.md"))])


def anchors(text: str) -> set[str]:
    """The anchors that a page's headings make, as code forges write them."""
    slugs: set[str] = set()
    for heading in HEADING.findall(FENCE.sub("", text)):
        words = re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower())
        slug = words.strip().replace(" ", "-")
        slugs.add(slug if slug not in slugs else f"{slug}-1")
    return slugs


def check_links(path: Path, text: str) -> Iterator[str]:
    for target in LINK.findall(INLINE.sub("", FENCE.sub("", text))):
        if re.match(r"[a-z]+:", target):
            continue
        place, _, anchor = target.partition("#")
        file = (path.parent / place).resolve() if place else path
        if not file.exists():
            yield f"link to {target}: no such file"
        elif anchor and file.suffix == ".md" and anchor not in anchors(file.read_text(encoding="utf-8")):
            yield f"link to {target}: no such heading"


def shown_commands(text: str) -> Iterator[str]:
    """Command lines in fenced blocks and in inline code, continuation lines joined."""
    for language, block in FENCE.findall(text):
        if language in ("", "sh", "bash", "console"):
            for line in block.replace("\\\n", " ").splitlines():
                yield line.strip().removeprefix("$ ").partition("#")[0].strip()
    yield from INLINE.findall(FENCE.sub("", text))


def check_command(line: str, root: Any, targets: set[str]) -> Iterator[str]:
    words = re.sub(r"[\[\]()|]", " ", line).split()
    if len(words) < 2 or words[0] not in ("poseloom", "make"):
        return
    if words[0] == "make":
        yield from (f"`{line}`: no such target" for word in words[1:2] if "=" not in word and word not in targets)
        return
    command, known = root, {"--help", "-h"}
    options = [word.partition("=")[0] for word in words[1:] if word.startswith("-") and word != "-"]
    for word in words[1:]:
        inner = getattr(command, "commands", None)
        if inner is None or word.startswith("-"):
            break
        if word not in inner:
            yield f"`{line}`: no command {word!r}; there are {', '.join(sorted(inner))}"
            return
        command = inner[word]
    for parameter in command.params:
        known.update(parameter.opts, parameter.secondary_opts)
    yield from (f"`{line}`: no option {option}" for option in options if option not in known)


def check_python(block: str) -> Iterator[str]:
    try:
        tree = ast.parse(block)
    except SyntaxError as error:
        yield f"Python block does not parse: {error}"
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "poseloom":
            module = importlib.import_module(node.module or "")
            missing = [name.name for name in node.names if not hasattr(module, name.name)]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "poseloom":
            module = importlib.import_module("poseloom")
            missing = [node.attr] if not hasattr(module, node.attr) else []
        else:
            continue
        yield from (f"Python block: {module.__name__} has no {name!r}" for name in missing)


def main() -> int:
    """Prints every defect and returns the exit code."""
    root = typer.main.get_command(build_app())
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = {word for line in re.findall(r"^(\w[\w ]*):", makefile, re.MULTILINE) for word in line.split()}
    defects: list[str] = []
    for path in documents():
        text = path.read_text(encoding="utf-8")
        found = list(check_links(path, text))
        for line in shown_commands(text):
            found += check_command(line, root, targets)
        for language, block in FENCE.findall(text):
            if language == "python":
                found += check_python(block)
        defects += [f"{path.relative_to(ROOT)}: {what}" for what in found]
    print("\n".join(defects) or f"{len(documents())} documents: links, commands and names resolve")
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
