"""Timing in turn, rows, table and JSON of the benchmarks."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from benchmarks.measure import Peer, Report, Row, measure, show, write_json


def test_peers_take_turns_after_one_warm_up_each() -> None:
    now, calls = 0.0, []

    def work(name: str, seconds: list[float]) -> None:
        nonlocal now
        calls.append(name)
        now += seconds.pop(0)

    slow, fast = [9.0, 4.0, 2.0, 3.0], [7.0, 0.5, 0.25, 0.25]
    peers = [
        Peer("case", "slow", 1, lambda: work("slow", slow), 1e3, "ms"),
        Peer("case", "fast", 2, lambda: work("fast", fast), 10.0, "ds"),
    ]
    rows = measure(peers, 3, clock=lambda: now)
    assert calls == ["slow", "fast"] * 4
    assert rows == [Row("case", "slow", 1, 2000.0, "ms", 3000.0), Row("case", "fast", 2, 2.5, "ds", 2.5)]


def test_json_holds_the_five_keys_and_full_precision(tmp_path: Path) -> None:
    path = tmp_path / "rows.json"
    write_json(path, [Row("a", "yasps", 2, 1 / 3, "ns/element", 0.5), Row("b", "copy", 1, 4.0, "GB/s")])
    assert json.loads(path.read_text()) == [
        {"case": "a", "implementation": "yasps", "threads": 2, "value": 1 / 3, "unit": "ns/element"},
        {"case": "b", "implementation": "copy", "threads": 1, "value": 4.0, "unit": "GB/s"},
    ]


@pytest.mark.parametrize(("value", "text"), [(12345.6, "12,346"), (99.96, "100"), (3.14159, "3.14"), (0.02, "0.02")])
def test_table_shows_three_digits_at_most(value: float, text: str) -> None:
    stream = io.StringIO()
    report = Report([Row("structure", "yasps", 1, value, "ns/element")], ["[a note] in brackets"])
    show("title", report, Console(file=stream, width=100))
    printed = stream.getvalue()
    assert f" {text} " in printed
    assert "structure" in printed
    assert "- [a note] in brackets" in printed
