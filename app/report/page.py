"""Parts that the pages of reports share: style, document, tables, numbers as text."""

from collections.abc import Iterable, Sequence
from html import escape

from app.report.bundle import csp_source, figure_scripts, figure_style

NOT_A_DEVICE = (
    "MarginGuard is research software. It is not a medical device and must not be used to treat "
    "or diagnose a patient."
)

PAGE_STYLE = """
:root { color-scheme: light; --ink: #1c2733; --line: #d5dce3; --soft: #f4f6f8; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 76rem; padding: 1.5rem; color: var(--ink);
       font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Liberation Sans", sans-serif; }
h1 { margin: 0 0 .2rem; font-size: 1.7rem; }
h2 { margin: 2.2rem 0 .6rem; font-size: 1.15rem; }
p.note { margin: .2rem 0; color: #51606e; }
p.device { margin: .8rem 0 1.2rem; padding: .5rem .8rem; border-left: 4px solid #c8381e;
           background: #fdf3f0; }
ul.tiles { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1rem 0; padding: 0;
           list-style: none; }
ul.tiles li { flex: 1 1 9rem; padding: .7rem .9rem; border: 1px solid var(--line);
              border-radius: 6px; background: var(--soft); }
ul.tiles b { display: block; font-size: 1.45rem; line-height: 1.2;
             font-variant-numeric: tabular-nums; }
div.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(22rem, 1fr));
              gap: 0 2.5rem; }
div.wide { overflow-x: auto; }
table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .6rem; border-bottom: 1px solid var(--line); text-align: left;
         vertical-align: top; overflow-wrap: break-word; }
th { background: var(--soft); font-weight: 600; }
td.number, th.number { text-align: right; white-space: nowrap; }
td.pass, td.fail { font-weight: 600; white-space: nowrap; }
td.pass { color: #00694c; }
td.fail { color: #a32a14; }
p { overflow-wrap: anywhere; }
div.figure { overflow-x: auto; border: 1px solid var(--line); border-radius: 6px; padding: .5rem; }
div.figure svg { display: block; margin: 0 auto; min-width: 34rem; max-width: 56rem;
                 width: 100%; height: auto; }
div.figure img { min-width: 46rem; border: 0; }
img { display: block; width: 100%; height: auto; border: 1px solid var(--line);
      border-radius: 6px; }
@media print {
  body { max-width: none; padding: 0; }
  h2 { break-after: avoid; }
  div.wide { overflow-x: visible; }
  div.wide table { font-size: .75em; }
  div.wide th, div.wide td { padding: .2rem .3rem; white-space: normal; }
}
"""

Cell = str | int | float | None


def document(title: str, sections: Iterable[str], *, figures: bool = False) -> str:
    """A page of ``sections``, without the empty ones; they are HTML, ``title`` is text.

    With ``figures`` the sections have figures of `TimePlot.html` or `coverage_figure`, and the page
    has the scripts that draw them. Its policy allows these scripts alone, by their hashes, and no
    other resources.
    """
    style = PAGE_STYLE + (figure_style() if figures else "")
    scripts = figure_scripts() if figures else ()
    allowed = " ".join(map(csp_source, scripts)) or "'none'"
    policy = (
        f"default-src 'none'; img-src data:; style-src {csp_source(style)}; "
        f"script-src {allowed}; base-uri 'none'; form-action 'none'"
    )
    body = [*(section for section in sections if section)]
    body += [f"<script>{script}</script>" for script in scripts]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{style}</style>\n</head>\n"
        "<body>\n<main>\n" + "\n".join(body) + "\n</main>\n</body>\n</html>\n"
    )


def table(
    title: str, header: Sequence[str], rows: Iterable[Sequence[Cell]], *, numbers: bool = True
) -> str:
    """A table under its title; with ``numbers`` all columns but the first are right-aligned."""

    def cells(tag: str, values: Sequence[Cell]) -> str:
        return "".join(
            f'<{tag} class="number">{escape(text_of(value))}</{tag}>'
            if numbers and column > 0
            else f"<{tag}>{escape(text_of(value))}</{tag}>"
            for column, value in enumerate(values)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<h2>{escape(title)}</h2>\n<table><tr>{cells('th', header)}</tr>{body}</table>"


def scrolling(content: str, label: str, kind: str = "wide") -> str:
    """``content`` (HTML) that scrolls sideways where it is wider than the page, also by keys.

    ``kind`` is the class of its style: ``wide`` of a table, ``figure`` of a picture, ``static`` of
    the picture in an interactive figure.
    """
    named = f'tabindex="0" role="group" aria-label="{escape(label)}"'
    return f'<div class="{kind}" {named}>{content}</div>'


def length(value_mm: float | None) -> str:
    """A length with two decimals; a dash if it is not known."""
    return "-" if value_mm is None else f"{value_mm:.2f} mm"


def time_text(value_s: float) -> str:
    """A time in seconds with three decimals."""
    return f"{value_s:.3f} s"


def text_of(value: Cell | bool) -> str:
    """A value of a table; a dash if it is not known."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
