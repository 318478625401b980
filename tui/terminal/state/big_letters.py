"""Words in letters of five rows, or of ten or fifteen where there is room."""

from __future__ import annotations

ROWS = 5
_FONT = {
    " ": ("  ", "  ", "  ", "  ", "  "),
    "A": (" ### ", "#   #", "#####", "#   #", "#   #"),
    "B": ("#### ", "#   #", "#### ", "#   #", "#### "),
    "C": (" ####", "#    ", "#    ", "#    ", " ####"),
    "D": ("#### ", "#   #", "#   #", "#   #", "#### "),
    "E": ("#####", "#    ", "#### ", "#    ", "#####"),
    "G": (" ####", "#    ", "#  ##", "#   #", " ####"),
    "I": ("###", " # ", " # ", " # ", "###"),
    "J": ("  ###", "    #", "    #", "#   #", " ### "),
    "L": ("#    ", "#    ", "#    ", "#    ", "#####"),
    "M": ("#   #", "## ##", "# # #", "#   #", "#   #"),
    "N": ("#   #", "##  #", "# # #", "#  ##", "#   #"),
    "O": (" ### ", "#   #", "#   #", "#   #", " ### "),
    "P": ("#### ", "#   #", "#### ", "#    ", "#    "),
    "R": ("#### ", "#   #", "#### ", "#  # ", "#   #"),
    "S": (" ####", "#    ", " ### ", "    #", "#### "),
    "T": ("#####", "  #  ", "  #  ", "  #  ", "  #  "),
    "U": ("#   #", "#   #", "#   #", "#   #", " ### "),
    "W": ("#   #", "#   #", "# # #", "## ##", "#   #"),
    "Y": ("#   #", " # # ", "  #  ", "  #  ", "  #  "),
}


def big_word(word: str, width: int, height: int, full: str) -> list[str]:
    """Return the rows of a word in the largest size that fits; no row where none fits.

    `width`, `height`: cells.  `full`: the character that fills a cell.
    """
    rows = [" ".join(_FONT[letter][row] for letter in word) for row in range(ROWS)]
    times = min(3, width // max(1, len(rows[0])), height // ROWS)
    wide = ["".join(full * times if dot == "#" else " " * times for dot in row) for row in rows]
    return [row for row in wide for _ in range(times)]
