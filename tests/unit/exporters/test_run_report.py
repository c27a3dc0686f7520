"""The page of a run: all that came of it is there, nothing comes from elsewhere, and no name becomes markup."""

import base64
import io
import math
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from simwarp.core.files import FileError
from simwarp.exporters.run_report import Report, check_report, report_page, write_report
from simwarp.exporters.vehicle_sheet import Fact, Section
from simwarp.vehicle.assessment.verdict import at_most
from simwarp.vehicle.results.run_result import Result

HOSTILE = """<script>alert("1")</script>&amp;'"><img src=x onerror=y>$title"""
VOID = {"meta", "img"}


class Page(HTMLParser):
    """Tags with their attributes, and the text; elements must close in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def words(self) -> list[str]:
        return [" ".join(each.split()) for each in self.text if each.strip()]

    @property
    def pictures(self) -> list[Image.Image]:
        found: list[Image.Image] = []
        for tag, attributes in self.tags:
            if tag == "img":
                head, _, data = str(attributes["src"]).partition(",")
                assert head == "data:image/png;base64"
                found.append(Image.open(io.BytesIO(base64.b64decode(data, validate=True))))
        return found


def figure() -> Figure:
    found = Figure(figsize=(3.0, 2.0))
    FigureCanvasAgg(found)
    found.add_subplot().plot([0.0, 1.0], [0.0, 1.0])
    return found


def report(text: str = "plain", *, passed: bool | None = False) -> Report:
    return Report(
        title=text, passed=passed,
        verdicts=[at_most(text, 0.25, 0.2, "m", text), at_most("never came to it", math.nan, 1.0)],
        results=[Result(text, text, 14.89, "m/s"), Result("x", "stop", math.nan, "m", text)],
        parameters={text: text}, vehicle=[Section(text, (Fact(text, text, text), Fact("mass", "1671.3", "kg")))],
        portrait=np.full((6, 8, 3), 200, np.uint8), figures={text: figure()}, notes=[text],
    )  # fmt: skip


def external(page: Page) -> list[str]:
    """Attributes that would fetch something."""
    found = []
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            if name in ("src", "href", "srcset", "data", "action", "poster") and not str(value).startswith("data:"):
                found.append(f"{tag} {name}={value}")
            if name.startswith("on"):
                found.append(f"{tag} {name}")
    return found


def test_a_page_has_all_that_came_of_a_run():
    page = Page(report_page(report()))
    words = page.words
    assert words.count("failed") == 1
    assert {"0.25", "0.2", "FAIL", "14.89", "m/s", "not reached", "1671.3", "kg"} <= set(words)
    assert [picture.size for picture in page.pictures] == [(330, 220), (8, 6)]
    for picture in page.pictures:
        picture.load()


@pytest.mark.parametrize(("passed", "word"), [(True, "passed"), (False, "failed"), (None, "no verdict asked for")])
def test_the_verdict_is_at_the_top(passed, word):
    words = Page(report_page(report(passed=passed))).words
    assert word in words[words.index("plain") :][:6]


def test_nothing_is_looked_up_elsewhere():
    text = report_page(report())
    assert external(Page(text)) == []
    assert not any(word in text for word in ("http:", "https:", "url(", "@import", "<script", "<link", "<iframe"))


def test_names_become_no_markup():
    text = report_page(report(HOSTILE))
    page = Page(text)
    assert {tag for tag, _ in page.tags} == {tag for tag, _ in Page(report_page(report())).tags}
    assert external(page) == []
    # escaped and back: title twice, and every place where a name stands
    assert page.words.count(HOSTILE) >= 10
    assert all(attributes["alt"] in (HOSTILE, "the vehicle as built") for tag, attributes in page.tags if tag == "img")


def test_the_page_is_written_whole(tmp_path):
    write_report(report("größer"), tmp_path / "a.html")
    assert "größer" in (tmp_path / "a.html").read_text(encoding="utf-8")
    with pytest.raises(FileError, match="does not exist"):
        write_report(report(), tmp_path / "none" / "a.html")
    with pytest.raises(FileError, match=r"--report: the name must end in \.html, got 'a.pdf'"):
        check_report(tmp_path / "a.pdf", "--report")
