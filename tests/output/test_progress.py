"""Progress lines and the table of times, with a clock that the tests move."""

import io
import re

import pytest

from yasps import DataError
from yasps.output import FrameProgress, TimeTable, TimeTableError


class HandClock:
    """A clock that only moves when told to."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    def isatty(self):
        return True


def run(total, *, stream, seconds_per_frame=0.0, stop_after=None):
    clock = HandClock()
    with FrameProgress(total, stream=stream, clock=clock) as progress:
        for frame in range(1, (stop_after or total) + 1):
            clock.now += seconds_per_frame
            progress.update(frame=frame, newton_iterations=3, cg_iterations=120 + frame, contacts=7, milliseconds=12.4)


def test_a_file_gets_a_line_for_every_tenth():
    stream = io.StringIO()
    run(200, stream=stream)
    lines = stream.getvalue().splitlines()
    assert [int(re.match(r"frames (\d+)/200: ", line).group(1)) for line in lines] == list(range(20, 201, 20))
    assert lines[0] == "frames 20/200: 3 Newton, 140 CG, 7 contacts, 12 ms"


def test_a_slow_run_gets_a_line_every_five_seconds():
    stream = io.StringIO()
    run(1000, stream=stream, seconds_per_frame=2.0, stop_after=10)
    assert [line.split()[1] for line in stream.getvalue().splitlines()] == ["3/1000:", "6/1000:", "9/1000:"]


def test_the_last_frame_has_its_line_once():
    stream = io.StringIO()
    run(13, stream=stream)
    assert stream.getvalue().splitlines()[-1].startswith("frames 13/13:")
    assert stream.getvalue().count("13/13") == 1


def test_a_terminal_gets_a_bar_with_the_last_numbers(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "150")
    stream = Terminal()
    run(5, stream=stream)
    assert "5/5" in stream.getvalue()
    assert "3 Newton, 125 CG, 7 contacts, 12 ms" in stream.getvalue()
    assert "frames 5/5:" not in stream.getvalue()


def test_progress_goes_to_stderr(capsys):
    with FrameProgress(1) as progress:
        progress.update(frame=1, newton_iterations=1, cg_iterations=2, contacts=3, milliseconds=4)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "frames 1/1: 1 Newton, 2 CG, 3 contacts, 4 ms\n"


def test_negative_number_of_frames_is_refused():
    with pytest.raises(DataError, match="-1"):
        FrameProgress(-1)


def filled_table():
    clock = HandClock()
    times = TimeTable(clock=clock)
    clock.now += 1.0
    for _ in range(2):
        with times.stage("step"):
            clock.now += 2.0
            with times.stage("assembly"):
                clock.now += 3.0
            with times.stage("assembly"), times.stage("step"):  # a stage inside itself
                clock.now += 0.5
    clock.now += 2.0
    return times, clock


def test_nested_stages_add_up_to_the_wall_time():
    times, _ = filled_table()
    rows = {row.stage: row for row in times.rows()}
    assert list(rows) == ["step", "assembly", "other"]
    assert [row.total_seconds for row in rows.values()] == [5.0, 6.0, 3.0]
    assert [row.calls for row in rows.values()] == [4, 4, 0]
    assert sum(row.share_percent for row in rows.values()) == pytest.approx(100)
    assert rows["assembly"].share_percent == pytest.approx(100 * 6 / 14)
    assert rows["assembly"].mean_milliseconds == 1500.0


def test_a_stage_that_raises_is_counted_and_left():
    clock = HandClock()
    times = TimeTable(clock=clock)

    def failing_stage():
        with times.stage("bad"):
            clock.now += 1.0
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        failing_stage()
    clock.now += 4.0
    assert [row.total_seconds for row in times.rows()] == [1.0, 4.0]


def test_rows_include_the_running_stage():
    clock = HandClock()
    times = TimeTable(clock=clock)
    with times.stage("long"):
        clock.now += 3.0
        assert times.rows()[0].total_seconds == 3.0
        clock.now += 1.0
    assert times.rows()[0].total_seconds == 4.0


def test_the_table_is_printed_with_all_columns():
    times, _ = filled_table()
    stream = io.StringIO()
    times.print(stream=stream)
    text = stream.getvalue()
    for heading in ("stage", "calls", "total s", "share %", "mean ms"):
        assert heading in text
    cells = [re.split(r"\s*│\s*", line.strip("│ \n")) for line in text.splitlines() if line.startswith("│")]
    assert ["assembly", "4", "6.000", "42.9", "1500.000"] in cells
    assert cells[-1][:3] == ["wall time", "", "14.000"]


@pytest.mark.parametrize("name", ["", "other"])
def test_names_that_would_confuse_the_table_are_refused(name):
    times = TimeTable()
    with pytest.raises(TimeTableError, match="can't be named"), times.stage(name):
        pass
