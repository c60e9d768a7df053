"""Pages for people, taken apart: their blocks of code, commands and links."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
OTHERS = [ROOT / "CONTRIBUTING.md", ROOT / "studies" / "README.md"]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *OTHERS]
LANGUAGES = {"python", "sh", "toml", "text", "nginx"}  # text and nginx are shown, not run
OPERATORS = {"&&", "||", "|", ";", "&", "(", ")"}
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """Code between fences, and where it stands."""

    page: Path
    number: int  # among all blocks of the page
    language: str
    code: str

    @property
    def name(self) -> str:
        return f"{name_of(self.page)}-{self.number}"


def name_of(page: Path) -> str:
    """Short and without a slash, for the names of tests."""
    return str(page.relative_to(ROOT).with_suffix("")).replace("/", "-")


def blocks(page: Path) -> list[Block]:
    found = enumerate(_BLOCK.findall(page.read_text()))
    return [Block(page, number, language, code) for number, (language, code) in found]


def commands(code: str) -> list[list[str]]:
    """The simple commands of a shell script, as words."""
    lines = code.replace("\\\n", " ").splitlines()
    return [words for line in lines for words in _commands_of(line) if words]


def inline_commands(page: Path) -> list[list[str]]:
    """The commands in the running text; none that is cut short by dots."""
    text = _BLOCK.sub("", page.read_text())
    spans = re.findall(r"(?<!`)`((?:salpchain|make|python3?|pip) [^`]+)`(?!`)", text)
    whole = [" ".join(span.split()) for span in spans if "..." not in span and " | " not in span]
    return [words for span in whole for words in commands(span)]


def links(page: Path) -> list[str]:
    """Targets of links and pictures that point into the repository."""
    found = re.findall(r"\]\(([^)\s]+)\)", _BLOCK.sub("", page.read_text()))
    return [target for target in found if "://" not in target]


def anchors(page: Path) -> set[str]:
    """What a link may name after a `#`: the page's headings."""
    titles = re.findall(r"^#+ (.*)$", _BLOCK.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def _commands_of(line: str) -> list[list[str]]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    found: list[list[str]] = [[]]
    for word in lexer:
        if word in (">", "<"):
            next(lexer)
        elif word in OPERATORS:
            found.append([])
        else:
            found[-1].append(word)
    return found
