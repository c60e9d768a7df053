"""What is printed never decides over what is done, and each stream has its own."""

import os
import subprocess
import sys

import pytest

from salpchain.cli.main import COMMANDS

SWIM = ["video", "greedy", "--length", "2", "--size", "64x64", "--speed", "50", "--out"]
# Standard output or error that cannot be written; what the shell does to the command.
STREAMS = {
    "full disk": (">/dev/full", 1),
    "closed output": (">&-", 0),
    "closed error": ("2>&-", 0),
    "full disk behind error": ("2>/dev/full", 0),
    "all closed": ("<&- >&- 2>&-", 0),
}


def shell(words, redirection="", **environment):
    line = f'exec "$@" {redirection}'
    command = ["sh", "-c", line, "sh", sys.executable, "-m", "salpchain", *words]
    return subprocess.run(
        command, capture_output=True, check=False, env={**os.environ, **environment},
        encoding=environment.get("PYTHONIOENCODING", "utf-8"),
    )  # fmt: skip


@pytest.mark.parametrize("stream", STREAMS)
def test_a_file_is_written_whatever_the_streams_are(stream, tmp_path):
    redirection, status = STREAMS[stream]
    out = tmp_path / "swim.gif"
    done = shell([*SWIM, str(out)], redirection)
    assert done.returncode == status and "Traceback" not in done.stderr
    assert out.read_bytes().startswith(b"GIF8")
    if status:
        assert "not all output could be written: no space left on device" in done.stderr


def test_a_reader_that_leaves_does_not_end_the_work(tmp_path):
    out = tmp_path / "swim.gif"
    command = [sys.executable, "-u", "-m", "salpchain", *SWIM, str(out)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    process.stderr.close()
    assert process.wait() == 0 and out.read_bytes().startswith(b"GIF8")


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "utf-8"])
def test_a_name_that_the_stream_cannot_show_is_no_error(encoding, tmp_path):
    out = tmp_path / "plavání-鯨.gif"
    done = shell([*SWIM, str(out)], PYTHONIOENCODING=encoding)
    assert done.returncode == 0 and "Traceback" not in done.stderr
    assert out.read_bytes().startswith(b"GIF8") and "wrote" in done.stdout
    missing = shell(["evaluate", "鯨"], PYTHONIOENCODING=encoding)
    assert missing.returncode == 2 and missing.stderr.count("\n") == 1


def test_a_name_that_is_no_text_is_no_error(tmp_path):
    name = os.fsencode(tmp_path) + b"/swim-\xff.gif"
    command = [os.fsencode(sys.executable), b"-m", b"salpchain", *map(os.fsencode, SWIM), name]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 0 and os.path.getsize(name), done.stderr  # noqa: PTH202


@pytest.mark.parametrize("command", COMMANDS)
def test_every_page_of_help_is_shown_in_ascii(command):
    done = shell([command, "--help"], PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and "Example:" in done.stdout and done.stderr == ""


def test_a_table_is_shown_in_ascii_and_progress_apart_from_it(tmp_path):
    words = ["evaluate", "greedy", "--lengths", "2", "--trials", "1", "--out", str(tmp_path)]
    done = shell(words, PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and "greedy: 1 trials" in done.stdout and "wrote" in done.stdout
    assert "testing" in done.stderr and "testing" not in done.stdout
    assert "\x1b" not in done.stdout + done.stderr


def test_quiet_leaves_results_and_errors_alone(tmp_path):
    done = shell([*SWIM, str(tmp_path / "swim.gif"), "--quiet"])
    assert done.stdout.startswith("wrote") and done.stderr == ""
    wrong = shell(["video", "nobody", "--quiet", "--out", str(tmp_path / "no.gif")])
    assert wrong.returncode == 2 and "no such run folder or policy" in wrong.stderr
