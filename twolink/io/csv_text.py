"""CSV text as columns of numbers; every error names the line."""

import csv
import io
from collections.abc import Iterator

import numpy as np

from twolink.errors import TwolinkError
from twolink.io.text import first_repeated, parse_number

Columns = dict[str, np.ndarray]


def parse_csv(text: str, where: str, error: type[TwolinkError] = TwolinkError, rows: int = 0) -> Columns:
    """The columns of a CSV text by the names in its first line.

    Parameters
    ----------
    text : str
        Cells separated by commas. Blank lines do not count.
    where : str
        The name of the text for errors.
    error : type
        The class of the errors.
    rows : int
        The smallest number of rows below the header.

    Returns
    -------
    dict
        One array (n,) for each column, in their order.

    Raises
    ------
    error
        Code "csv": no header, too few rows, a name used twice, a row of another length, or a cell without a number.
    """
    lines = list(csv_rows(text, where, error))
    if len(lines) < 1 + rows:
        expected = "a header" + (f" and at least {'one row' if rows == 1 else f'{rows} rows'}" if rows else "")
        what = f"{'it is empty' if not lines else 'there are too few rows'}, expected {expected}"
        raise error(what, where=where, remedy="such as q0,q1,v0,v1 in the first line", code="csv")
    header = [name.strip() for name in lines[0][1]]
    repeated = first_repeated(header)
    if repeated is not None:
        raise error(f"column {repeated!r} is there twice", where=where, remedy="keep one", code="csv")
    values = np.empty((len(lines) - 1, len(header)))
    for k, (line, cells) in enumerate(lines[1:]):
        if len(cells) != len(header):
            what = f"it has {len(cells)} cells, the header has {len(header)}"
            raise error(what, where=f"{where}, line {line}", remedy="give each row a cell for each column", code="csv")
        try:
            values[k] = [parse_number(cell) for cell in cells]
        except ValueError as failure:
            what, remedy = f"not a row of numbers: {failure}", "check the numbers and their decimal points"
            raise error(what, where=f"{where}, line {line}", remedy=remedy, code="csv") from None
    return dict(zip(header, values.T, strict=True))


def csv_rows(text: str, where: str, error: type[TwolinkError]) -> Iterator[tuple[int, list[str]]]:
    """The line number and the cells of every row that is not blank. Raises `error`."""
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        yield from ((reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells))
    except csv.Error as failure:
        raise error(f"not CSV: {failure}", where=where, remedy="save it as CSV again", code="csv") from None
