"""Tables printed in a terminal."""

from collections.abc import Iterable, Sequence

from forcebound.files import printable

LONGEST_CELL = 500  # characters
WIDEST = 200  # characters; a table leaves a narrower terminal before it breaks a number in two


def print_rows(
    head: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None
) -> None:
    """Print a table whose first column is flush left."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    def cell(text: str) -> Text:  # no markup: a name may hold brackets
        return Text(printable(text, LONGEST_CELL))

    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column(cell(head[0]))
    for name in head[1:]:
        table.add_column(cell(name), justify="right", overflow="fold")
    for row in rows:
        table.add_row(*map(cell, row))
    console = Console()
    needed = console.measure(table, options=console.options.update(max_width=WIDEST)).maximum
    Console(width=max(console.width, needed)).print(table)
