"""How a figure was computed, as tables for the fold at the end of its page."""

from __future__ import annotations

from dataclasses import asdict
from html import escape

from vtlib.experiments import named
from vtlib.experiments.reading import provenance


def settings_table(name: str) -> str:
    """Every parameter of every algorithm of an experiment, from the configuration it ran with."""
    algorithms = {k: asdict(v) for k, v in named(name).algorithms.items()}
    rows = dict.fromkeys(key for settings in algorithms.values() for key in settings)
    cells = [[key, *(_text(s.get(key)) for s in algorithms.values())] for key in rows]
    return html_table(["parameter", *algorithms], cells)


def cost_table(name: str) -> str:
    """Seconds, machine and versions of every stored result behind an experiment."""
    rows = [
        [
            f"{note['owner']}/{note['label']}",
            f"{note['seconds']:.0f}",
            note["machine"]["processor"],
            f"torch {note['machine']['torch']}, numpy {note['machine']['numpy']}",
        ]
        for note in provenance(name)
    ]
    return html_table(["stored result", "seconds of one core", "processor", "versions"], rows)


def html_table(head: list[str], rows: list[list[str]]) -> str:
    """A plain HTML table."""

    def line(cells: list[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    return f"<table><thead>{line(head, 'th')}</thead><tbody>{body}</tbody></table>"


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)
