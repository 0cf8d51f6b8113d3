"""Tables to read in a terminal or to paste into a README."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Table:
    """Words and figures; the first column is text, the others are numbers."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def as_markdown(self) -> str:
        """For a README."""
        rule = "|".join(["---", *["---:"] * (len(self.columns) - 1)])
        lines = [" | ".join(cells) for cells in (self.columns, *self.rows)]
        lines = [f"| {line} |" for line in lines]
        return "\n".join([f"*{self.title}*", "", lines[0], f"|{rule}|", *lines[1:]])

    def as_text(self) -> str:
        """For a terminal."""
        cells = [self.columns, *self.rows]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        lines = []
        for row in cells:
            first, *others = (cell.ljust(w) for cell, w in zip(row, widths, strict=True))
            others = [cell.strip().rjust(w) for cell, w in zip(others, widths[1:], strict=True)]
            lines.append("  ".join([first, *others]))
        rule = "-" * len(lines[0])
        return "\n".join([self.title, rule, lines[0], rule, *lines[1:]])
