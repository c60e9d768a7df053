"""A report: one page, as Markdown and as HTML that needs no other file."""

import base64
import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from salpchain.files import StrPath, write_text

# A cell that holds a number: with a unit, a spread or one beside it at the most.
NUMBER = re.compile(r"-|-?[\d.,]+( %| min)?( \([^)]*\))?|(-|[\d.]+) / (-|[\d.]+)")
VERDICTS = {"held": "held", "did not hold": "not", "cannot tell": "unknown"}  # and their look
STYLE = files("salpchain.report") / "page" / "report.css"
CODE = re.compile(r"`([^`]+)`")


@dataclass(frozen=True)
class Table:
    """Rows under a heading; the first column names them."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    words: bool = False  # sentences, which become cards on a narrow screen


@dataclass(frozen=True)
class Report:
    """What the page says."""

    title: str
    verdict: str  # one line: what came out
    about: Sequence[str]  # paragraphs
    tables: Sequence[Table] = ()
    figures: Mapping[str, StrPath] = field(default_factory=dict)  # PNG by caption


def write_report(report: Report, folder: StrPath, name: str = "report") -> list[Path]:
    """`NAME.md`, which shows the figures beside it, and `NAME.html`, which holds them."""
    folder = Path(folder)
    pages = {folder / f"{name}.md": markdown(report), folder / f"{name}.html": page(report)}
    for path, text in pages.items():
        write_text(path, text)
    return list(pages)


def _summary(caption: str) -> str:
    """What a caption says before its first colon or full stop."""
    return re.split(r"[:.](?: |$)", caption)[0]


def markdown(report: Report) -> str:
    """The page as Markdown."""
    parts = [f"# {report.title}", f"**{report.verdict}**", *report.about]
    for caption, path in report.figures.items():
        parts += [f"![{_summary(caption)}]({Path(path).name})", f"*{caption}*"]
    for table in report.tables:
        parts += [f"## {table.title}", _markdown_table(table), table.note]
    return "\n\n".join(part for part in parts if part) + "\n"


def _markdown_table(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return "\n".join(
        [line(table.columns), line(["---"] * len(table.columns)), *map(line, table.rows)]
    )


def page(report: Report) -> str:
    """The page as HTML, its figures inside."""
    parts = [f"<h1>{_text(report.title)}</h1>", f'<p class="verdict">{_text(report.verdict)}</p>']
    parts += [f"<p>{_text(text)}</p>" for text in report.about]
    parts += [_html_figure(caption, Path(path)) for caption, path in report.figures.items()]
    for table in report.tables:
        parts += [f"<h2>{_text(table.title)}</h2>", _html_table(table)]
        parts += [f'<p class="note">{_text(table.note)}</p>'] if table.note else []
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(report.title)}</title><style>{STYLE.read_text('utf-8')}</style>"
    )
    body = "\n".join(parts)
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _text(words: str) -> str:
    """Words as HTML; what stands in backticks as code."""
    return CODE.sub(r"<code>\1</code>", html.escape(words))


def _html_figure(caption: str, path: Path) -> str:
    content = path.read_bytes()
    width, height = (int.from_bytes(content[at : at + 4], "big") for at in (16, 20))  # PNG's header
    image = base64.b64encode(content).decode()
    name = html.escape(_summary(caption))
    return (
        f'<figure><div class="wide" tabindex="0" role="region" aria-label="{name}">'
        f'<img alt="{name}" width="{width}" height="{height}" src="data:image/png;base64,{image}">'
        f"</div><figcaption>{_text(caption)}</figcaption></figure>"
    )


def _html_table(table: Table) -> str:
    """A table that scrolls in itself; one of words becomes a list of cards on a narrow screen."""
    numbers = [
        all(NUMBER.fullmatch(row[k]) for row in table.rows) for k in range(len(table.columns))
    ]
    names = "".join(
        f'<th class="number">{_text(name)}</th>' if number else f"<th>{_text(name)}</th>"
        for name, number in zip(table.columns, numbers, strict=True)
    )
    rows = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    kind, title = "wide words" if table.words else "wide", html.escape(table.title)
    return (
        f'<div class="{kind}" tabindex="0" role="region" aria-label="{title}">'
        f'<table><tr class="names">{names}</tr>\n{rows}</table></div>'
    )


def _cell(text: str) -> str:
    number = bool(NUMBER.fullmatch(text))
    kind = VERDICTS.get(text, "number" if number else "")
    return f'<td class="{kind}">{_text(text)}</td>' if kind else f"<td>{_text(text)}</td>"
