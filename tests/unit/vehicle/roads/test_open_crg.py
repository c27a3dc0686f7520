"""Roads of OpenCRG files: the heights that were written, along straight and bent reference lines."""

import sys

import numpy as np
import pytest

from simwarp.core.types import ModelError
from simwarp.vehicle import SpecError
from simwarp.vehicle.roads import load_road

V = np.linspace(-2.0, 2.0, 9)


def test_a_straight_road_has_the_heights_of_its_file(tmp_path):
    pycrg = pytest.importorskip("pycrg")
    z = 0.05 * np.random.default_rng(1).standard_normal((41, len(V)))
    pycrg.write(tmp_path / "straight.crg", z, 0.5, V, x0=-5.0, mods={})
    road = load_road(tmp_path / "straight.crg")
    assert road.origin == pytest.approx((-5.0, -2.0))
    assert road.size == pytest.approx((20.0, 4.0))
    # stored in single precision
    np.testing.assert_allclose(road.heights, z.T, rtol=0.0, atol=1e-7)


def test_a_bent_road_is_where_its_line_leads(tmp_path):
    pycrg = pytest.importorskip("pycrg")
    headings = 0.02 * np.arange(80)
    z = np.tile(0.01 * np.arange(81)[:, None], (1, len(V)))
    pycrg.write(tmp_path / "bent.crg", z, 0.5, V, headings, mods={})
    road = load_road(tmp_path / "bent.crg")
    x, y = (np.concatenate([[0.0], 0.5 * np.cumsum(turn(headings))]) for turn in (np.cos, np.sin))
    points = np.stack([x, y], axis=1)[5:76]
    # a rise of 2 % along the line; between nodes that are 0.5 m apart it is off by less than a tenth of a cell's rise
    np.testing.assert_allclose(road.height_at(points), 0.01 * np.arange(81)[5:76], rtol=0.0, atol=1e-3)


def without(text, title):
    """A file's head without a section."""
    lines = text.split("\n")
    first = next(k for k, line in enumerate(lines) if line.strip() == title)
    last = next(k for k in range(first + 1, len(lines)) if lines[k].startswith("$"))
    return "\n".join(lines[:first] + lines[last:])


def test_files_with_a_part_missing_are_one_line(tmp_path):
    pycrg = pytest.importorskip("pycrg")
    whole = tmp_path / "whole.crg"
    pycrg.write(whole, np.zeros((41, len(V))), 0.5, V, mods={})
    content = whole.read_bytes()
    end = content.find(b"$$$$")
    head = content[:end].decode("latin1")
    parts = {
        "line": without(head, "$ROAD_CRG").encode("latin1") + content[end:],
        "definition": without(head, "$KD_DEFINITION").encode("latin1") + content[end:],
        "head": content[end:], "data": content[: end + 400], "end": content[:-700], "all": b"",
    }  # fmt: skip
    for name, part in parts.items():
        (tmp_path / f"{name}.crg").write_bytes(part)
        with pytest.raises(SpecError, match=f"^{name}.crg: cannot be read: ") as caught:
            load_road(tmp_path / f"{name}.crg")
        assert "\n" not in str(caught.value)


def test_what_is_no_road_is_refused(tmp_path, monkeypatch):
    pytest.importorskip("pycrg")
    (tmp_path / "text.crg").write_text("no road")
    for name in ("text.crg", "none.crg"):
        with pytest.raises(SpecError, match=f"{name}: cannot be read: ") as caught:
            load_road(tmp_path / name)
        assert "\n" not in str(caught.value)
    monkeypatch.setitem(sys.modules, "pycrg", None)
    with pytest.raises(ModelError, match=r"pip install 'simwarp\[crg\]'"):
        load_road(tmp_path / "text.crg")
