"""Makes the site in build/site: the pages of docs as its guide, and a reference of every public name from docstrings.

python scripts/build_site.py        # lists what is wrong, one a line; exit code 1 if anything is

Warnings of Sphinx are errors. Then every link of the site is followed: to a page, and to a place in it.
"""

import importlib
import importlib.util
import pkgutil
import re
import shutil
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[1]
SOURCE, SITE = ROOT / "build" / "site-source", ROOT / "build" / "site"
INTERNAL = ("poseloom.benchmark", "poseloom.cli")
LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)([^)]*\))")


def faces() -> dict[str, list[str]]:
    """The public names (`__all__`) of the front door and of every package, the front door first, then the shallow."""
    import poseloom

    packages = [found.name for found in pkgutil.walk_packages(poseloom.__path__, "poseloom.") if found.ispkg]
    names = ["poseloom", *(name for name in packages if not name.startswith(INTERNAL))]
    names += ["poseloom.errors", "poseloom.testing"]
    modules = {name: importlib.import_module(name) for name in names if importlib.util.find_spec(name)}
    listed = {name: list(getattr(module, "__all__", ())) for name, module in modules.items()}
    errors = modules["poseloom.errors"]
    listed["poseloom.errors"] = [
        n for n, o in vars(errors).items() if getattr(o, "__module__", "") == "poseloom.errors"
    ]
    return {name: listed[name] for name in sorted(listed, key=lambda name: (name.count("."), name)) if listed[name]}


def homes(public: dict[str, list[str]]) -> dict[str, dict[str, str]]:
    """For each face and name the face that describes it: the shallowest package, else the front door."""
    described: dict[int, str] = {}
    shown: dict[str, dict[str, str]] = {}
    for face in sorted(public, key=lambda face: face == "poseloom"):  # the front door last
        module = importlib.import_module(face)
        shown[face] = {}
        for name in public[face]:
            value = getattr(module, name)
            own = isinstance(value, type) or callable(value)
            shown[face][name] = described.setdefault(id(value), face) if own else face
    return shown


def reference_page(face: str, shown: dict[str, str]) -> str:
    """A page of the reference: a face's own names in full, and links to those that another face describes."""
    parts = [f"# {face}\n", f".. automodule:: {face}\n   :no-members:\n"]
    elsewhere = sorted((name for name, home in shown.items() if home != face), key=str.lower)
    if elsewhere:
        links = "\n".join(f"- :py:obj:`{name} <{shown[name]}.{name}>`" for name in elsewhere)
        parts.append(f"Described elsewhere:\n\n{links}\n")
    for name in sorted((name for name, home in shown.items() if home == face), key=str.lower):
        directive = _directive(face, name)
        members = "   :members:\n" if directive in ("autoclass", "autoexception") else ""
        parts.append(f".. {directive}:: {face}.{name}\n{members}")
    return parts[0] + "".join(f"\n```{{eval-rst}}\n{part}```\n" for part in parts[1:])


def _directive(face: str, name: str) -> str:
    value = getattr(importlib.import_module(face), name)
    if isinstance(value, type):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction" if callable(value) and hasattr(value, "__code__") else "autodata"


def stage() -> dict[str, dict[str, str]]:
    """Writes what Sphinx reads: the guide with its tables of contents, and the reference."""
    shutil.rmtree(SOURCE, ignore_errors=True)
    shutil.copytree(ROOT / "docs", SOURCE, ignore=shutil.ignore_patterns("__pycache__"))
    pages = sorted(SOURCE.rglob("*.md"))
    for page in pages:
        text = page.read_text(encoding="utf-8")
        text = LINK.sub(lambda match, page=page: match[1] + _staged(match[2], page) + match[3], text)
        if page.name == "index.md":
            text += _contents(text, page)
        page.write_text(text, encoding="utf-8")
    shown = homes(faces())
    (SOURCE / "api").mkdir()
    for face, names in shown.items():
        (SOURCE / "api" / f"{face}.md").write_text(reference_page(face, names), encoding="utf-8")
    entries = "\n".join(sorted(shown))
    (SOURCE / "api" / "index.md").write_text(
        "# Reference\n\nEvery public name, from its docstring. Names that are not here may change without notice.\n\n"
        f"```{{toctree}}\n:maxdepth: 1\n\n{entries}\n```\n",
        encoding="utf-8",
    )
    return shown


def _staged(target: str, page: Path) -> str:
    """A link's target; files outside docs are copied to the site."""
    if re.match(r"[a-z]+:", target):
        return target
    file = (ROOT / "docs" / page.relative_to(SOURCE)).parent.joinpath(target).resolve()
    if file.is_relative_to(ROOT / "docs") or not file.is_file():
        return target
    copied = SOURCE / "files" / file.name
    copied.parent.mkdir(exist_ok=True)
    shutil.copy(file, copied)
    return "../" * len(page.relative_to(SOURCE).parents[:-1]) + f"files/{file.name}"


def _contents(text: str, page: Path) -> str:
    """The hidden table of contents of an index: the pages that it links, in its order."""
    linked = [match[2] for match in LINK.finditer(text) if match[2].endswith(".md")]
    own = dict.fromkeys(name for name in linked if (page.parent / name).resolve().is_relative_to(page.parent))
    extra = ["api/index.md"] if page.parent == SOURCE else []
    return "\n\n```{toctree}\n:hidden:\n\n" + "\n".join([*own, *extra]) + "\n```\n"


class _Page(HTMLParser):
    """The places of a page, and where its links lead."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if value is None:
                continue
            if key in ("id", "name"):
                self.ids.add(value)
            if key in ("href", "src"):
                self.links.append(value)


def broken_links(site: Path) -> Iterator[str]:
    """Links of a built site that lead to no file of it, or to no place in its page; those to other hosts are left."""
    pages: dict[Path, _Page] = {}
    for file in sorted(site.rglob("*.html")):
        pages[file] = _Page()
        pages[file].feed(file.read_text(encoding="utf-8"))
    for file, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file():
                yield f"{file.relative_to(site)}: link to {link}: no such file"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids:
                yield f"{file.relative_to(site)}: link to {link}: no such place"


def undescribed(shown: dict[str, dict[str, str]], site: Path) -> Iterator[str]:
    """Public names that the reference lacks."""
    for face, names in shown.items():
        page = _Page()
        page.feed((site / "api" / f"{face}.html").read_text(encoding="utf-8"))
        linked = {urlsplit(link).fragment for link in page.links}
        for name, home in names.items():
            if f"{home}.{name}" not in (page.ids if home == face else linked):
                yield f"{face}.{name}: not in the reference"


def main() -> int:
    """Builds the site, prints every defect and returns the exit code."""
    from sphinx.cmd.build import build_main

    shown = stage()
    shutil.rmtree(SITE, ignore_errors=True)
    cache = SITE.with_name("site-cache")
    code = build_main(["-W", "--keep-going", "-q", "-E", "-d", str(cache), str(SOURCE), str(SITE)])
    if code:
        return code
    defects = [*broken_links(SITE), *undescribed(shown, SITE)]
    names = sum(map(len, shown.values()))
    print(
        "\n".join(defects) or f"{SITE.relative_to(ROOT)}/index.html: {names} public names, every link leads somewhere"
    )
    return 1 if defects else 0


if __name__ == "__main__":
    sys.exit(main())
