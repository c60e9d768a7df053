"""Progress: what is told where there is no terminal, and the time left."""

import pytest

from salpchain.cli import display
from salpchain.cli.display import Pace, share_display
from salpchain.cli.streams import set_quiet


class Clock:
    """Stands in for the time (s)."""

    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(display.time, "monotonic", clock)
    return clock


def play(watch, clock, *told):
    """Tells (seconds since the last, share, what is done), one after the other."""
    for seconds, share, now in told:
        clock.now += seconds
        watch(share, now)


COMPILED = [  # 60 s of compilation, then a tenth of the work each second
    (0, 0.0, "compiling for 8 units"),
    (60, 0.0, "8 units"),
    (1, 0.1, "8 units"),
    (1, 0.2, "8 units"),
]


def test_the_time_left_is_that_of_the_work_without_compilation(clock):
    pace, told = Pace(), []
    play(lambda share, now: told.append(pace.left(share, now)), clock, *COMPILED)
    assert told[:2] == [None, None]
    assert told[2:] == pytest.approx([9.0, 8.0])
    play(lambda *now: told.append(pace.left(*now)), clock, (0, 0.2, "compiling for 9 units"),
         (30, 0.2, "9 units"))  # fmt: skip
    assert told[-1] == pytest.approx(8.0)


def test_programs_that_are_still_to_be_compiled_are_part_of_the_time_left(clock):
    pace, told = Pace(programs=3), []
    play(lambda *now: told.append(pace.left(*now)), clock, *COMPILED)
    assert told[2:] == pytest.approx([9.0 + 2 * 60, 8.0 + 2 * 60])
    play(lambda *now: told.append(pace.left(*now)), clock, (0, 0.2, "compiling for 24 units"),
         (30, 0.2, "24 units"))  # fmt: skip
    assert told[-1] == pytest.approx(8.0 + 45)


def test_lines_say_that_it_compiles_and_how_far_it_is(clock, capsys):
    with share_display("testing") as watch:
        play(watch, clock, *COMPILED, (1, 0.3, "8 units"), *[(0.2, 0.4, "8 units")] * 5)
        play(watch, clock, (1, 1.0, "8 units"))
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [
        "testing compiling for 8 units  (0 % done)",
        "testing 8 units  (0 % done)",
        "testing 8 units  (20 % done, 0 min 08 s left)",
        "testing 8 units  (40 % done, 0 min 06 s left)",
        "testing 8 units  (100 % done, 0 min 00 s left)",
    ]


def test_a_long_line_stays_one_line(clock, capsys):
    with share_display("testing") as watch:
        watch(0.0, "a-rather-long-name-of-a-policy and greedy, compiling for 8 units, and more")
    assert capsys.readouterr().err.count("\n") == 1


def test_nothing_is_said_with_quiet(clock, capsys):
    set_quiet(True)
    try:
        with share_display("testing") as watch:
            play(watch, clock, *COMPILED)
    finally:
        set_quiet(False)
    assert capsys.readouterr() == ("", "")


def test_a_terminal_is_told_the_same(clock, monkeypatch, capsys):
    from rich.console import Console

    console = Console(force_terminal=True, width=120, record=True, stderr=True)
    monkeypatch.setattr(display, "notices", lambda: console)
    with share_display("testing") as watch:
        play(watch, clock, *COMPILED[:1])
    with share_display("testing") as watch:
        play(watch, clock, *COMPILED)
    said = console.export_text()
    assert "testing compiling for 8 units" in said
    assert "20%" in said and "0 min 08 s left" in said
    assert capsys.readouterr().out == ""
