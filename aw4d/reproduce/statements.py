"""What the paper's text says of methods and ablations, held against its own tables."""

from __future__ import annotations

from aw4d.reproduce.check import Check, Verdict, same
from aw4d.reproduce.paper import NOT_PRINTED, Paper, Table

CAPABILITIES = "tab:comparison"
PAIRS, TRIPLES = "tab:syn_module_2", "tab:syn_module_3"
CLAIMS = {
    "RainyGS handles dynamic scenes": ("RainyGS", "dynamic scenes"),
    "Ditto is tuning-free": ("Ditto", "tuning-free"),
}
PIXELWISE = ("depth si-RMSE", "edge F1")
CLIP_CONTEXT = 77  # tokens that CLIP reads; begin and end are two of them


def checks(paper: Paper) -> list[Check]:
    """Every line about statements."""
    return [*_capabilities(paper), _cropped(paper), *_same_setup(paper), _combinations(paper), _prompts(paper)]


def _capabilities(paper: Paper) -> list[Check]:
    lines = []
    for name, (row, column) in CLAIMS.items():
        said, marked = paper.figures[name], paper.tables[CAPABILITIES].column(column)[row]
        line = Check(
            what=name,
            where=f"{said.section}; {CAPABILITIES}",
            printed="yes" if said.value else "no",
            gives="yes" if marked else "no",
            verdict=same(said.value == marked),
            how=f"the text: {said.about}; the table: column {column}",
        )
        lines.append(line)
    return lines


def _cropped(paper: Paper) -> Check:
    method = "Video-P2P"
    tables = [table for table in paper.tables.values() if method in table.rows]
    cells = {c.name: cell for t in tables for c, cell in zip(t.columns, t.rows[method], strict=True)}
    left_out = [name for name, cell in cells.items() if cell == NOT_PRINTED]
    pixelwise = [name for name in PIXELWISE if cells[name] != NOT_PRINTED]
    return Check(
        what=f"metrics of {method} left out since its frames are cropped",
        where=tables[0].label,
        printed=", ".join(left_out),
        gives=f"{', '.join(pixelwise)} are printed",
        verdict=Verdict.UNEXPLAINED if left_out and pixelwise else Verdict.AGREES,
        how="metrics by pixel need frames that lie on each other, as boxes do",
    )


def modules(row: str) -> frozenset[str]:
    """The modules of a row.

    >>> sorted(modules("1+4+5"))
    ['1', '4', '5']
    """
    return frozenset(row.split("+"))


def _outcomes(paper: Paper) -> list[tuple[Table, str, str]]:
    """Every row of the ablations' plans, and what came of it."""
    plans = [table for label, table in paper.tables.items() if label.startswith(("tab:ablation", "tab:syn"))]
    return [(table, row, str(outcome)) for table in plans for row, outcome in table.column("outcome").items()]


def _experiments(paper: Paper) -> dict[str, str]:
    """Rows by the experiment that was made of them."""
    return {outcome: row for _, row, outcome in _outcomes(paper) if outcome.startswith("experiment")}


def _same_setup(paper: Paper) -> list[Check]:
    lines = []
    for table, row, outcome in _outcomes(paper):
        if not outcome.startswith("same as "):
            continue
        other = _experiments(paper)[outcome.removeprefix("same as ")]
        line = Check(
            what=f"modules {row}",
            where=table.label,
            printed=outcome,
            gives=f"that is modules {other}",
            verdict=same(modules(row) == modules(other)),
            how="the modules of the two rows",
        )
        lines.append(line)
    return lines


def _combinations(paper: Paper) -> Check:
    rows = [*paper.tables[PAIRS].rows, *paper.tables[TRIPLES].rows]
    own = [row for row in _experiments(paper).values() if row in rows]
    return Check(
        what="combinations of two or three modules with VidRefiner: experiments of their own",
        where=f"{PAIRS}; {TRIPLES}",
        printed=f"{len(rows)} combinations",
        gives=len(own),
        verdict=Verdict.AGREES if len(own) == len(rows) else Verdict.UNEXPLAINED,
        how="the others are called not feasible, or the same as another",
    )


def _prompts(paper: Paper) -> Check:
    base, *instructions = (paper.prompt_tokens[name] for name in ("base", "night", "fog", "snow", "rain"))
    lengths = sorted(base + instruction + 2 for instruction in instructions)
    return Check(
        what="tokens of a prompt, base and instruction",
        where="Text Prompt Design and Templates",
        printed=f"CLIP reads {CLIP_CONTEXT}",
        gives=(lengths[0], lengths[-1]),
        verdict=Verdict.UNEXPLAINED if lengths[-1] > CLIP_CONTEXT else Verdict.AGREES,
        how=f"{base} of the example + {min(instructions)} to {max(instructions)} + begin and end; which part the CLIP "
        "score read is not said",
    )
