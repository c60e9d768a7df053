"""Builds the site: `python docs/site.py` writes `site/` from pages, parsers and package.

Pages are staged in a folder of their own, their links put right, and made into HTML by Zensical.
The swim page is `site/swim/index.html`.
"""

import argparse
import contextlib
import html.parser
import io
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parent.parent
STUDIES = ("paper/results/report", "bars", "factors", "budget", "short", "transfer")
# Sections of the site, and what is in each: a title and a page of the repository.
# ruff: noqa: E501
PAGES = {
    "Start": {
        "Start": "docs/index.md", "Gallery": "docs/gallery.md", "Installing, and all of it once": "README.md",
        "See it and touch it": "docs/see.md", "Glossary": "docs/glossary.md",
    },
    "Tutorials": {
        "From Python": "docs/python.md", "Train": "docs/training.md", "Evaluate": "docs/evaluate.md",
        "Judge in trouble": "docs/suite.md", "Worlds": "docs/world.md", "Dynamics": "docs/dynamics.md", "Tasks": "docs/tasks.md",
        "On a robot": "docs/interop/export.md", "Compare": "docs/compare.md",
    },
    "How to": {
        title: f"docs/recipes/{name}.md" for title, name in (
            ("An observation", "observation"), ("A model", "model"), ("A reward term", "reward"),
            ("A task", "task"), ("A world", "world"), ("Part and join", "parting"),
            ("A controller", "controller"), ("A controller in PyTorch", "controller_torch"),
            ("A logger", "logger"), ("A search", "search"), ("A training loop", "loop"),
            ("A bridge", "bridge"),
        )
    } | {
        title: f"docs/interop/{name}.md" for title, name in (
            ("Other people's tools", "README"), ("Gymnasium", "gymnasium"),
            ("PettingZoo", "pettingzoo"), ("Brax", "brax"), ("VMAS", "vmas"),
            ("TorchRL", "torchrl"), ("BenchMARL", "benchmarl"),
        )
    },
    "Science": {
        "One controller, any length": "docs/any-length.md", "How far it gets, and why": "docs/any-length-results.md",
        "What was tried": "docs/any-length-log.md", "The paper's study": "docs/study.md",
        "Derivatives": "docs/gradients.md", "Best-known solutions": "docs/best.md",
        "What physics allows": "docs/bounds.md", "All studies": "studies/README.md",
    } | {f"Study: {name.partition('/')[0]}": f"studies/{name}/report.md" for name in STUDIES},
    "Reference": {
        "Public names": "docs/api.md", "Command line": "cli", "Settings": "docs/settings.md",
        "Columns and files": "docs/formats.md", "Architecture": "docs/architecture.md",
        "All pages": "docs/README.md", "Contributing": "CONTRIBUTING.md",
    },
    "Measurements": {"Measurements": "docs/measurements.md"},
    "Changes": {"Changes": "CHANGELOG.md"},
}  # fmt: skip
WIDE = "---\nhide:\n  - navigation\n  - toc\n---\n\n"  # where the swim page is embedded
LINK = re.compile(r"(\]\(|<img src=\")([^)\"\s]+)(\)|\")")
FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)


def places() -> dict[str, str]:
    """For each page of the repository its place in the site's sources."""
    found = {}
    for section in PAGES.values():
        for source in section.values():
            name = source.removeprefix("docs/").replace("README", "overview").lower()
            found[source] = "pages.md" if source == "docs/README.md" else name
    return found


def stage(folder: Path) -> None:
    """Writes the sources of the site: pages, what they show and link, and the parsers' help."""
    where = places()
    folder.mkdir(parents=True, exist_ok=True)
    for source, place in where.items():
        text = command_line() if source == "cli" else (ROOT / source).read_text(encoding="utf-8")
        place = folder / (place if place.endswith(".md") else f"{place}.md")
        place.parent.mkdir(parents=True, exist_ok=True)
        if source != "cli":
            text = relinked(text, ROOT / source, place, folder, where)
        text = WIDE + text if 'class="swim"' in text else text
        place.write_text(text, encoding="utf-8")
    (folder / "site.css").write_text(LOOK, encoding="utf-8")
    (folder / "offline.js").write_text(OFFLINE, encoding="utf-8")
    (folder / "labels.js").write_text(LABELS, encoding="utf-8")


def relinked(text: str, source: Path, place: Path, folder: Path, where: dict[str, str]) -> str:
    """A page whose links lead to staged pages; other files that it links are put beside them."""

    def lead(match: re.Match) -> str:
        target, _, anchor = match[2].partition("#")
        if not target or "://" in target or target.startswith("mailto:"):
            return match[0]
        file = (source.parent / target).resolve()
        name = file.relative_to(ROOT).as_posix()
        if file.is_dir() and f"{name}/README.md" in where:
            name = f"{name}/README.md"
        goal = folder / where[name] if name in where else copied(file, name, folder)
        way = Path(*[".."] * len(place.parent.relative_to(folder).parts), goal.relative_to(folder))
        return f"{match[1]}{way.as_posix()}{'#' + anchor if anchor else ''}{match[3]}"

    parts = FENCE.split(text)
    return "".join(part if part.startswith("```") else LINK.sub(lead, part) for part in parts)


def copied(file: Path, name: str, folder: Path) -> Path:
    """A file of the repository that is no page, beside the pages; of a folder, its list of files."""
    goal = folder / "files" / name.removeprefix("docs/")
    if file.is_dir():
        goal = goal / "files.txt"
        names = sorted(
            path.relative_to(file).as_posix() for path in file.rglob("*") if path.is_file()
        )
        goal.parent.mkdir(parents=True, exist_ok=True)
        goal.write_text("\n".join(names) + "\n", encoding="utf-8")
        return goal
    goal = goal.with_name(goal.name + ".txt") if goal.suffix in (".md", ".html", "") else goal
    goal.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, goal)
    return goal


def command_line() -> str:
    """The page of the command line: what each parser says of itself."""
    from salpchain.cli.main import COMMANDS, run

    parts = [
        "# Command line\n",
        "What `salpchain COMMAND --help` prints, written from the parsers. Wrong words are one line"
        " and exit status 2.\n",
    ]
    for name in ("", *COMMANDS):
        told = io.StringIO()
        with contextlib.redirect_stdout(told):
            run([name, "--help"] if name else ["--help"])
        parts.append(
            f"## salpchain {name}".rstrip() + f"\n\n```text\n{told.getvalue().rstrip()}\n```\n"
        )
    return "\n".join(parts)


SETTINGS = """[project]
site_name = "salpchain"
site_description = "Simulate chains of jet-driven units, and train one controller for any length"
docs_dir = "docs"
site_dir = "site"
use_directory_urls = false
extra_css = ["site.css"]
extra_javascript = ["labels.js"]
nav = [NAVIGATION]

[project.theme]
language = "en"
font = false
features = ["navigation.tabs", "navigation.top", "navigation.footer", "content.code.copy", "search.highlight"]

[[project.theme.palette]]
media = "(prefers-color-scheme: light)"
scheme = "default"
toggle.icon = "lucide/sun"
toggle.name = "Switch to dark"

[[project.theme.palette]]
media = "(prefers-color-scheme: dark)"
scheme = "slate"
toggle.icon = "lucide/moon"
toggle.name = "Switch to light"

[project.plugins.search]

[project.plugins.offline]

[project.markdown_extensions.toc]
permalink = true

[project.markdown_extensions.tables]

[project.markdown_extensions.pymdownx.superfences]

[project.markdown_extensions.pymdownx.highlight]
"""


def settings() -> str:
    """Zensical's settings. JSON's texts and lists are TOML's too."""
    where = places()
    nav = [
        {
            title: [
                {name: where[page] if page != "cli" else "cli.md"} for name, page in pages.items()
            ]
        }
        for title, pages in PAGES.items()
    ]
    return SETTINGS.replace("NAVIGATION", ", ".join(_table(one) for one in nav))


def _table(one: dict) -> str:
    """A dictionary as an inline table of TOML."""
    ((key, value),) = one.items()
    told = (
        json.dumps(value) if isinstance(value, str) else "[" + ", ".join(map(_table, value)) + "]"
    )
    return f"{{ {json.dumps(key)} = {told} }}"


SHIM = "https://unpkg.com/iframe-worker/shim"  # that Zensical asks for where there is no server
# Browsers make no worker of a file on disk: the search's own script then runs in a hidden frame.
OFFLINE = """if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      const inside = this.frame.contentWindow, script = inside.document.createElement("script");
      inside.postMessage = (data) => {
        const event = new MessageEvent("message", { data });
        this.onmessage?.(event);
        this.dispatchEvent(event);
      };
      script.src = new URL(address, location.href);
      this.there = new Promise((done) => { script.onload = done; });
      inside.document.head.append(script);
    }
    postMessage(data) {
      const { contentWindow: inside } = this.frame;
      this.there.then(() => inside.dispatchEvent(new inside.MessageEvent("message", { data })));
    }
    terminate() { this.frame.remove(); }
  };
}
"""
# What axe-core misses in the search and in wide tables of Zensical 0.0.60: names, and a way in by key.
LABELS = """const seen = new WeakSet();
const label = (root) => {
  if (!seen.has(root)) { // the search has a tree of its own, behind a shadow root
    seen.add(root);
    new MutationObserver(() => label(root)).observe(root, { childList: true, subtree: true });
  }
  for (const one of root.querySelectorAll("*")) if (one.shadowRoot) label(one.shadowRoot);
  const list = [...root.querySelectorAll("ol")].at(-1);
  for (const input of root.querySelectorAll("input[role=combobox]")) {
    if (!list || input.hasAttribute("aria-controls")) continue;
    list.id ||= "search-results";
    input.setAttribute("aria-controls", list.id);
    input.setAttribute("aria-expanded", "true");
    input.setAttribute("aria-label", "Search");
  }
  for (const button of root.querySelectorAll("button:not([aria-label]):not([title])")) {
    if (!button.textContent.trim()) button.setAttribute("aria-label", "Search: clear or filter");
  }
  const areas = root === document ? ".md-typeset__scrollwrap" : "div:has(> div > ol), div:has(> ol)";
  for (const area of root.querySelectorAll(areas)) area.tabIndex = 0;
};
label(document);
"""
LOOK = """[data-md-color-scheme] { --md-typeset-a-color: #00627d; --md-accent-fg-color: #00627d; }
[data-md-color-scheme="slate"] { --md-typeset-a-color: #6fd3ec; --md-accent-fg-color: #6fd3ec; }
.md-typeset h1 { margin-bottom: 1rem; }
.swim {
  display: block; width: 100%; height: min(68vh, 38rem); min-height: 26rem; border: 0; border-radius: 0.9rem;
}
.md-typeset table:not([class]) { font-size: 0.68rem; }
.md-typeset pre > code { font-size: 0.82em; }
"""


class _Reader(html.parser.HTMLParser):
    """Where a page leads, and what can be led to in it."""

    def __init__(self) -> None:
        super().__init__()
        self.leads: list[str] = []
        self.loads: list[str] = []
        self.names: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("href", "src") and value:
                loaded = name == "src" or dict(attrs).get("rel") == "stylesheet"
                (self.loads if loaded else self.leads).append(value)
            elif name in ("id", "name") and value:
                self.names.add(value)


def broken(site: Path) -> Iterator[str]:
    """Links of the built pages that lead nowhere, and what they load from other hosts."""
    read: dict[Path, _Reader] = {}
    for page in sorted(site.rglob("*.html")):
        read[page] = _Reader()
        read[page].feed(page.read_text(encoding="utf-8"))
    for page, reader in read.items():
        for lead in reader.leads + reader.loads:
            parts = urlsplit(lead)
            if parts.netloc and lead in reader.loads:
                yield f"{page.relative_to(site)} loads {lead} from another host"
            if parts.scheme or parts.netloc or page == site / "404.html":
                continue
            goal = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            goal = goal / "index.html" if goal.is_dir() else goal
            anchor = unquote(parts.fragment)
            if not goal.exists():
                yield f"{page.relative_to(site)} leads to {lead}, which is not there"
            elif (
                anchor
                and goal in read
                and goal.parent.name != "swim"
                and anchor not in read[goal].names
            ):
                yield f"{page.relative_to(site)} leads to {lead}, where there is no such heading"


def build(out: Path) -> int:
    """The whole site; how many of its links lead nowhere."""
    from salpchain.web.swim_page import swim_page

    with tempfile.TemporaryDirectory() as made:
        project = Path(made)
        stage(project / "docs")
        (project / "zensical.toml").write_text(settings(), encoding="utf-8")
        command = [sys.executable, "-m", "zensical", "build", "--strict"]
        subprocess.run(command, cwd=project, check=True)
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(project / "site", out)
    for page in out.rglob("*.html"):
        up = "../" * len(page.parent.relative_to(out).parts)
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace(SHIM, f"{up}offline.js"), encoding="utf-8")
    (out / "swim").mkdir(parents=True, exist_ok=True)
    (out / "swim" / "index.html").write_text(swim_page(), encoding="utf-8")
    wrong = list(broken(out))
    print("\n".join(wrong) or f"all links of {out} lead somewhere", file=sys.stderr)
    return len(wrong)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "site")
    sys.exit(min(build(parser.parse_args().out.resolve()), 1))
