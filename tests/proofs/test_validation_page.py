"""The page of the proofs is what their records say, and a new report takes the place of an old one."""

import re

import pytest

from proofs.report import Report, Table
from proofs.validation_page import CHAPTERS, PAGE, RECORDS, page, records, text_of, with_report
from support import DOCS

NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?")


def test_the_page_is_made_of_the_records() -> None:
    """Brought up to date by: python tests/proofs/validation_page.py."""
    assert PAGE.read_text() == page()
    assert len(page().splitlines()) <= 250


@pytest.mark.parametrize("name", [path.stem for path in sorted(RECORDS.glob("*.toml"))])
def test_a_record_has_what_it_claims(name: str) -> None:
    """Every number of three digits of the claim is in its tables or notes, and the file is what is written of it."""
    record = records()[name]
    if record["chapter"] not in CHAPTERS:  # told on the page of its subject
        assert record["chapter"] == "pages"
        assert any(f"records/{name}.toml" in " ".join(file.read_text().split()) for file in DOCS.glob("*.md"))
    assert re.fullmatch(r"\d{4}-\d\d-\d\d|no date was kept", record["date"])
    assert (RECORDS / f"{name}.toml").read_text() == text_of(record)
    told = record["notes"] + "".join(cell + " " for table in record.get("table", ()) for row in table["rows"]
                                     for cell in (*row, *table["head"]))  # fmt: skip
    long = [number for number in NUMBER.findall(record["claim"]) if len(re.sub(r"\D", "", number)) > 2]
    assert not [number for number in long if number not in told.replace(" ", "") and number not in told]


def test_a_new_report_takes_the_place_of_an_old_one() -> None:
    record = records()["problems"]
    rows = [{"name": "a", "error": 0.5}, {"name": "b", "error": 0.25}]
    report = Report("problems", [Table("errors", {"problem": "{name}", "error": "{error:.2f}"}, rows)], {})
    found = with_report(record, report.markdown())
    assert found["table"] == [{"title": "errors", "head": ["problem", "error"], "rows": [["a", "0.50"], ["b", "0.25"]]}]
    assert found["date"] == report.date[:10]
    assert found["claim"] == record["claim"]
