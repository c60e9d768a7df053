"""The report of a study: one page, as Markdown and as HTML that needs no other file."""

import base64
import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from salpchain.files import StrPath, write_text
from salpchain.report.claims import ABOUT_CLAIMS, Claim

# A cell that holds a number: with a unit, a spread or one beside it at the most.
NUMBER = re.compile(r"-|-?[\d.,]+( %| min)?( \([^)]*\))?|(-|[\d.]+) / (-|[\d.]+)")
VERDICTS = {True: "held", False: "did not hold", None: "cannot tell"}
LOOK = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; }
body { max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.9rem; }
th, td { border-bottom: 1px solid #ddd; padding: 0.3rem 0.7rem; }
th, td { text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; }
.held { color: #00624a; } .not { color: #b04000; } .unknown { color: #666; }
"""


@dataclass(frozen=True)
class Table:
    """Rows under a heading; the first column names them."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True)
class Report:
    """What the page says."""

    title: str
    about: Sequence[str]  # paragraphs
    claims: Sequence[Claim]
    tables: Sequence[Table] = ()
    figures: dict[str, Path] = field(default_factory=dict)  # PNG by caption


def write_report(report: Report, folder: StrPath) -> list[Path]:
    """`report.md`, which shows the figures beside it, and `report.html`, which holds them."""
    folder = Path(folder)
    pages = {folder / "report.md": markdown(report), folder / "report.html": page(report)}
    for path, text in pages.items():
        write_text(path, text)
    return list(pages)


def _claims_table(claims: Sequence[Claim]) -> Table:
    rows = [[c.text, VERDICTS[c.held], c.evidence, c.where] for c in claims]
    columns = ["claim", "here", "evidence", "in the paper"]
    return Table("The paper's claims", columns, rows, ABOUT_CLAIMS)


def markdown(report: Report) -> str:
    """The page as Markdown."""
    parts = [f"# {report.title}", *report.about]
    for table in (_claims_table(report.claims), *report.tables):
        parts += [f"## {table.title}", _markdown_table(table), table.note]
    for caption, path in report.figures.items():
        parts += [f"![{caption}]({path.name})", f"*{caption}*"]
    return "\n\n".join(part for part in parts if part) + "\n"


def _markdown_table(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return "\n".join(
        [line(table.columns), line(["---"] * len(table.columns)), *map(line, table.rows)]
    )


def page(report: Report) -> str:
    """The page as HTML, its figures inside."""
    parts = [f"<h1>{html.escape(report.title)}</h1>"]
    parts += [f"<p>{html.escape(text)}</p>" for text in report.about]
    for table in (_claims_table(report.claims), *report.tables):
        parts += [f"<h2>{html.escape(table.title)}</h2>", _html_table(table)]
        parts += [f"<p>{html.escape(table.note)}</p>"] if table.note else []
    for caption, path in report.figures.items():
        image = base64.b64encode(path.read_bytes()).decode()
        name = html.escape(caption)
        parts.append(
            f'<figure><img alt="{name}" src="data:image/png;base64,{image}">'
            f"<figcaption>{name}</figcaption></figure>"
        )
    head = f'<meta charset="utf-8"><title>{html.escape(report.title)}</title><style>{LOOK}</style>'
    body = "\n".join(parts)
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _html_table(table: Table) -> str:
    names = "".join(f"<th>{html.escape(name)}</th>" for name in table.columns)
    rows = "\n".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in table.rows)
    return f"<table><tr>{names}</tr>\n{rows}</table>"


def _cell(text: str) -> str:
    kinds = {VERDICTS[True]: "held", VERDICTS[False]: "not", VERDICTS[None]: "unknown"}
    number = bool(NUMBER.fullmatch(text))
    kind = kinds.get(text, "number" if number else "")
    inside = html.escape(text)
    return f'<td class="{kind}">{inside}</td>' if kind else f"<td>{inside}</td>"
