"""The paper's LaTeX source, as far as the tests of its tables read it."""

from __future__ import annotations

import re

COMMANDS = re.compile(
    r"\\includegraphics\[[^]]*\]|\\(?:cite|ref|label|cline|setcounter)\{[^}]*\}|\\(?:textcolor|color)\{\w+\}|\\textbf|\\textit"
)
HEADING = re.compile(r"\\(?:sub)*section\*?\{([^}]*)\}|\\paragraph\{([^}]*)\}")
RINGED = {f"\\ding{{{172 + i}}}": str(i + 1) for i in range(5)}  # a digit in a ring


def without_comments(tex: str) -> str:
    return re.sub(r"(?<!\\)%.*", "", tex)


def table_labels(tex: str) -> list[str]:
    return re.findall(r"\\label\{(tab:[^}]*)\}", tex)


def table_source(tex: str, label: str) -> str:
    """The whole environment of a table, caption and all."""
    environments = re.findall(r"\\begin\{table\*?\}.*?\\end\{table\*?\}", tex, re.DOTALL)
    return next(source for source in environments if f"\\label{{{label}}}" in source)


def table_rows(tex: str, label: str) -> list[list[str]]:
    """Cells of a table below its head, without commands; ringed digits are digits."""
    body = table_source(tex, label).split("\\midrule", 1)[1].split("\\bottomrule")[0].replace("\\midrule", "")
    for command, digit in RINGED.items():
        body = body.replace(command, digit)
    rows = [row.split("&") for row in body.split("\\\\") if "&" in row]
    return [[COMMANDS.sub("", cell).strip(" \n~") for cell in row] for row in rows]


def section(tex: str, title: str) -> str:
    """The text from a heading to the next one; of a table's label: its environment."""
    if title.startswith("tab:"):
        return table_source(tex, title)
    headings = list(HEADING.finditer(tex))
    ends = [heading.start() for heading in headings[1:]] + [len(tex)]
    parts = {h.group(1) or h.group(2): tex[h.end() : end] for h, end in zip(headings, ends, strict=True)}
    return parts[title]


def numbers(text: str) -> list[str]:
    """Numbers in the order in which they stand, thousands without commas; without the (1), (2) of a list."""
    bare = COMMANDS.sub("", re.sub(r"(?<=\d),(?=\d{3})|\(\d\)", "", text))
    return re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?![\w])", bare)
