"""One HTML page that holds a whole report: pictures inside, no script, nothing from the network."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.files.plain import Table, Value, one_line
from dronecombat_jax.report.map_panels import Area

FIGHTS_NAME = "fights.html"  # the page that a click on the win-rate map opens
MOST_ROWS = 300  # of a table on the page; the file beside it has all
STYLE = """
:root { color-scheme: light }
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; background: #fff; max-width: 78rem; margin: 0 auto; padding: 1.5rem }
h1 { font-size: 1.7rem; margin: 0 0 .3rem } h2 { font-size: 1.25rem; margin: 2.4rem 0 .4rem }
p { max-width: 60rem; overflow-wrap: anywhere } .verdict { border-left: .3rem solid #0072b2; padding-left: 1rem; font-weight: 600 }
.gap { border-left: .3rem solid #d55e00; padding-left: 1rem }
pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; font-size: .82rem }
figure { margin: 0 } img { max-width: 100%; height: auto; border: 1px solid #ddd }
.picture { position: relative; display: inline-block } .picture svg { position: absolute; inset: 0; width: 100%; height: 100% }
rect { fill: transparent } a:hover rect, a:focus rect { stroke: #d55e00; stroke-width: 3; vector-effect: non-scaling-stroke }
nav a { margin-right: 1rem; white-space: nowrap } a { color: #005a8e }
details { margin: .6rem 0 } summary { cursor: pointer; font-weight: 600 }
.wide { overflow-x: auto; max-height: 32rem; overflow-y: auto } table { border-collapse: collapse; font-size: .82rem }
th, td { padding: .2rem .55rem; border-bottom: 1px solid #e3e3e3; text-align: right; white-space: nowrap }
th { position: sticky; top: 0; background: #f5f5f5 } .claims td { text-align: left; white-space: normal; vertical-align: top } .claims td:last-child { font-weight: 600 }
td.text, th.text { text-align: left; max-width: 22rem; overflow: hidden; text-overflow: ellipsis }
"""


class Picture(NamedTuple):
    """One figure of the page."""

    name: str  # of its files
    heading: str
    about: str
    png: bytes
    links: str = ""  # markup that lies over it


class Claims(NamedTuple):
    """The table of the paper's claims, and how to read it; without rows there is none."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    notes: Sequence[str]


NO_CLAIMS = Claims((), (), ())


def with_links(picture: Picture, areas: Sequence[Area]) -> Picture:
    """The picture with areas that link into the page of fights beside this page."""
    cells = "".join(
        f'<a href="{FIGHTS_NAME}#{"-".join(map(str, area.cell))}" target="_blank"><rect x="{area.left:.5f}" '
        f'y="{area.top:.5f}" width="{area.width:.5f}" height="{area.height:.5f}"/></a>'
        for area in areas
    )
    about = f"{picture.about} Click on a cell: a fight of that pair plays ({FIGHTS_NAME})."
    links = f'<svg viewBox="0 0 1 1" preserveAspectRatio="none" aria-hidden="true">{cells}</svg>'
    return picture._replace(about=about, links=links)


def page(
    title: str,
    summary: Sequence[str],
    verdict: tuple[Sequence[str], str],
    gaps: Sequence[str],
    pictures: Sequence[Picture],
    tables: Sequence[Table],
    claims: Claims = NO_CLAIMS,
) -> str:
    """The page; every text is foreign and is escaped. `verdict`: sentences, and the numbers behind
    them; `claims`: the paper's, beside ours.
    """
    links = "".join(
        f'<a href="#{escape(picture.name)}">{escape(picture.heading)}</a> ' for picture in pictures
    )
    if claims.rows:
        links = f"<a href='#claims'>The paper's claims</a> {links}"
    parts = [
        f"<h1>{_text(title)}</h1>",
        *(f"<p>{_text(line)}</p>" for line in summary),
        f"<nav>{links}<a href='#tables'>Tables</a></nav>",
    ]
    sentences, numbers = verdict
    if sentences:
        parts += [
            "<h2>Which defender is better?</h2>",
            *(f'<p class="verdict">{_text(sentence)}</p>' for sentence in sentences),
        ]
        parts.append(
            f"<details><summary>The numbers</summary><pre>{escape(numbers)}</pre></details>"
        )
    parts += _claims(claims)
    if gaps:
        parts += [
            "<h2>What is missing, and what to know</h2>",
            *(f'<p class="gap">{_text(line)}</p>' for line in gaps),
        ]
    parts += [_picture(picture) for picture in pictures]
    parts += ["<h2 id='tables'>Tables</h2>", *(_table(table) for table in tables)]
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n"
        f"<title>{_text(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def files_of(picture: Picture) -> tuple[Path, Path]:
    """Where a picture's files lie, relative to the page."""
    return Path("figures") / f"{picture.name}.png", Path("figures") / f"{picture.name}.pdf"


def _picture(picture: Picture) -> str:
    data = base64.b64encode(picture.png).decode()
    return (
        f'<h2 id="{escape(picture.name)}">{_text(picture.heading)}</h2>\n<figure><div class="picture"><img alt="{_text(picture.heading)}" '
        f'src="data:image/png;base64,{data}">{picture.links}</div>\n<figcaption><p>{_text(picture.about)} '
        f"Files: {_text(' and '.join(map(str, files_of(picture))))}.</p></figcaption></figure>"
    )


def _claims(claims: Claims) -> list[str]:
    if not claims.rows:
        return []
    head = "".join(f'<th class="text">{_text(name)}</th>' for name in claims.columns)
    rows = "".join(
        "<tr>" + "".join(f"<td>{_text(value)}</td>" for value in row) + "</tr>"
        for row in claims.rows
    )
    return [
        "<h2 id='claims'>The paper's claims</h2>",
        f'<table class="claims"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>',
        *(f"<p>{_text(note)}</p>" for note in claims.notes),
    ]


def _table(table: Table) -> str:
    text = [any(isinstance(row[i], str) for row in table.rows) for i in range(len(table.columns))]
    kind = [' class="text"' if is_text else "" for is_text in text]
    head = "".join(
        f"<th{k}>{_text(name.replace('_', ' '))}</th>"
        for name, k in zip(table.columns, kind, strict=True)
    )
    rows = "\n".join(
        "<tr>"
        + "".join(f"<td{k}>{_cell(value)}</td>" for value, k in zip(row, kind, strict=True))
        + "</tr>"
        for row in table.rows[:MOST_ROWS]
    )
    cut = f" (the first {MOST_ROWS} of {len(table.rows)})" if len(table.rows) > MOST_ROWS else ""
    return (
        f"<details><summary>{_text(table.name.replace('_', ' '))}{cut}</summary>\n<p>{_text(table.about)} "
        f"Files: tables/{_text(table.name)}.csv, tables/{_text(table.name)}.json.</p>\n"
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{rows}\n</tbody></table></div></details>'
    )


def _cell(value: Value) -> str:
    if value is None or value != value:
        return "&ndash;"
    if isinstance(value, str):
        return (
            f'<span title="{_text(value)}">{_text(value)}</span>'
            if len(value) > 30
            else _text(value)
        )
    if isinstance(value, float):
        return escape(f"{value:.4g}" if abs(value) < 1000 else f"{value:.1f}")
    return escape(f"{value:,}" if isinstance(value, int) and abs(value) >= 10_000 else str(value))


def _text(text: str) -> str:
    return escape(one_line(str(text)))
