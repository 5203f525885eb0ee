"""Tables as offices write them: every way of writing one table reads alike; what has two meanings is refused, and the
cure that the message names is taken.
"""

import re
from pathlib import Path

import pytest

import wakeflow as wf
from wakeflow.scene.measured import read_trays
from wakeflow.scene.user_files import read_samples, read_sieves

TRAYS = "fraction,bin,mass,uncertainty\nwheat,near,10.2,0.1\nwheat,far,500,2.5\n"
GERMAN = "fraction;bin;mass;uncertainty\nwheat;near;10,2;0,1\nwheat;far;500;2,5\n"
WAYS = {
    "decimal commas": GERMAN.encode(),
    "a byte order mark": GERMAN.encode("utf-8-sig"),
    "UTF-16": GERMAN.encode("utf-16"),
    "Windows lines": GERMAN.replace("\n", "\r\n").encode(),
    "tabs": GERMAN.replace(";", "\t").encode(),
    "commas in quotes": TRAYS.replace("10.2", '"10,2"').encode(),
    "a named separator": b"sep=;\n" + GERMAN.encode(),
    "another named separator": b"sep=|\n" + GERMAN.replace(";", "|").encode(),
    "a closing separator": GERMAN.replace("\n", ";\n").encode(),
    "empty rows": (GERMAN + ";;;\n\n;;;\n").encode(),
    "a sum": (GERMAN + "Summe;;510,2;\n").encode(),
    "notes": ("# of 3 May\n" + GERMAN).encode(),
}


@pytest.mark.parametrize("way", WAYS)
def test_trays_read_alike_however_they_are_written(way: str, tmp_path: Path) -> None:
    (tmp_path / "plain.csv").write_text(TRAYS)
    (tmp_path / "way.csv").write_bytes(WAYS[way])
    assert read_trays(tmp_path / "way.csv") == read_trays(tmp_path / "plain.csv")


UNITS = {
    "in the heads": "fraction;bin;mass (g);uncertainty [g]\nwheat;near;10,2;0,1\nwheat;far;500;2,5\n",
    "in one head": "fraction,bin,mass (g),uncertainty\nwheat,near,10.2,0.1\nwheat,far,500,2.5\n",
    "in the cells": "fraction,bin,mass,uncertainty\nwheat,near,10.2 g,0.1 g\nwheat,far,0.5 kg,2500 mg\n",
}


@pytest.mark.parametrize("way", UNITS)
def test_masses_with_units_are_those_masses(way: str, tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text(UNITS[way])
    found = [(tray.mass, tray.uncertainty) for tray in read_trays(tmp_path / "way.csv")]
    assert found == [pytest.approx((0.0102, 1e-4)), pytest.approx((0.5, 2.5e-3))]


TWO_MEANINGS = {
    "a point": ("1.234", "500"),
    "a comma": ("1,234", "500"),
    "a point beside decimal commas": ("1.234", "12,5"),
    "both": ("1.234,5", "500"),
    "a blank": ("1 234", "500"),
}


@pytest.mark.parametrize("way", TWO_MEANINGS)
def test_thousands_are_refused_and_each_cure_is_taken(way: str, tmp_path: Path) -> None:
    file, (one, other) = tmp_path / "way.csv", TWO_MEANINGS[way]
    text = f"fraction;bin;mass;uncertainty\nwheat;near;{one};1\nwheat;far;{other};1\n"
    file.write_text(text)
    with pytest.raises(wf.SceneError, match=r"way.csv, line 2: .* may have thousands parted; write ") as caught:
        read_trays(file)
    cures = str(caught.value).rpartition("write ")[2].split(" or ")
    taken = []
    for cure in cures:
        file.write_text(text.replace(one, cure))
        taken.append(read_trays(file)[0].mass)
    assert taken == ([1234.5] if way == "both" else [1234.0, 1.234][: len(cures)])


def test_a_mark_that_other_numbers_explain_is_a_decimal_one(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time;a\n0.998;1\n0.999;2\n1.000;3\n1.001;4.5\n")
    assert read_samples("a.csv", tmp_path)["time"] == [0.998, 0.999, 1.0, 1.001]


def test_units_in_the_heads_of_samples_are_obeyed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Sensor 3\ntime (ms);acceleration (g)\n0;0,5\n2,5;-0,5\n")
    found = read_samples("a.csv", tmp_path)
    assert found["time"] == pytest.approx([0.0, 2.5e-3])
    assert found["acceleration"] == pytest.approx([4.903325, -4.903325])


def test_a_sum_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(GERMAN + "total;;600;\n")
    with pytest.raises(wf.SceneError, match=re.escape("line 4: 600 is not the sum of the rows before it, 510.2")):
        read_trays(tmp_path / "a.csv")


SIEVES = {
    "retained": "opening (mm);retained (g)\n4;0\n3;20\n2;50\n1;30\n",
    "its sum": "opening (mm);retained (g)\n4;0\n3;20\n2;50\n1;30\ntotal;100\n",
    "passing": "sieve [mm],passing [%]\n4,100\n3,80\n2,30\n1,0\n",
    "shares": "size,passing\n1 mm,0\n2 mm,0.3\n3 mm,0.8\n4 mm,1\n",
    "German": "Siebweite (mm);Durchgang (%)\n4,0;100\n3,0;80,0\n2,0;30,0\n1,0;0\n",
}


@pytest.mark.parametrize("way", SIEVES)
def test_a_sieve_analysis_is_a_size(way: str, tmp_path: Path, cases: Path) -> None:
    (tmp_path / "sieve.csv").write_text(SIEVES[way])
    found = read_sieves("sieve.csv", tmp_path, "size")
    assert found["diameters"] == pytest.approx([1e-3, 2e-3, 3e-3, 4e-3])
    assert found["passing"] == pytest.approx([0.0, 0.3, 0.8, 1.0])
    tables = wf.Scene.load(cases / "vacuum.toml").tables()
    tables["fraction"]["hard"]["size"] = {"file": "sieve.csv"}
    scene = wf.Scene.parse(tables, base=tmp_path)
    assert float(scene.fraction["hard"].size.quantile([0.3])[0]) == pytest.approx(2e-3)


WRONG_SIEVES = {
    "opening;retained\n4;0\n3;20\n": "needs an opening with its unit",
    "opening (mm);retained (g)\n4;5\n3;20\n": "5 lay on the widest sieve; add one that all passes",
    "opening (mm),passing\n4,100\n1,0\n": "write the head passing (%)",
    "a,b\n4,100\n": "its heads are a, b; write opening (mm);retained (g)",
}


@pytest.mark.parametrize("text", WRONG_SIEVES)
def test_a_sieve_analysis_that_says_less_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "sieve.csv").write_text(text)
    with pytest.raises(wf.SceneError, match=re.escape(WRONG_SIEVES[text])):
        read_sieves("sieve.csv", tmp_path, "size")
