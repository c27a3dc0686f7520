"""Tables of arrays in docs/conventions.md, made of their declarations: `python -m scripts.array_tables` writes them.

A table stands between `<!-- arrays: NAME -->` and `<!-- end of arrays -->`, NAME being a class of
`simwarp.kernels.core.fields`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from simwarp.core.fields import FieldGroup, type_name
from simwarp.kernels.core import fields

PAGE = Path(__file__).resolve().parent.parent / "docs" / "conventions.md"
BLOCK = re.compile(r"(<!-- arrays: (\w+) -->\n).*?(<!-- end of arrays -->)", re.DOTALL)


def table(group: type[FieldGroup]) -> str:
    """Return the table of a class of declarations."""
    if all(each.per_world for each in group.FIELDS.values()):
        lines = ["| parameter | dtype | shape, meaning |", "|---|---|---|"]
        lines += [
            f"| `{name}` | {type_name(each.dtype)} | {each.shape_text} {each.text} |"
            for name, each in group.FIELDS.items()
        ]
    else:
        lines = ["| array | shape, dtype | meaning |", "|---|---|---|"]
        lines += [f"| `{name}` | {each.kind_text} | {each.text} |" for name, each in group.FIELDS.items()]
    return "\n".join(lines) + "\n"


def with_tables(page: str) -> str:
    """Return a page with all its tables of arrays made anew."""
    return BLOCK.sub(lambda match: f"{match[1]}{table(getattr(fields, match[2]))}{match[3]}", page)


def main() -> int:
    """Write the page; exit code 0."""
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
