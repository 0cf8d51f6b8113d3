"""Tables in Markdown."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column is text, and whose others are numbers."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def as_markdown(self) -> str:
        """Write title, head and rows."""
        rule = "|".join(["---", *["---:"] * (len(self.columns) - 1)])
        lines = [" | ".join(cells) for cells in (self.columns, *self.rows)]
        lines = [f"| {line} |" for line in lines]
        return "\n".join([f"*{self.title}*", "", lines[0], f"|{rule}|", *lines[1:]])
