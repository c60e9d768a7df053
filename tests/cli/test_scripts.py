"""The command line for scripts and shells: JSON alone, completion at TAB, lines of usage."""

import json
import re
import subprocess
import sys

import pytest

from salpchain.cli.main import COMMANDS, USAGE, run


def printed(capsys, *words):
    assert run([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_models_are_json_with_what_the_list_says(capsys):
    content = printed(capsys, "models", "--length", "8")
    assert {"name": "gcn", "parameters": 102_804} in content["models"]
    cards = {card["name"]: card for card in content["released"]}
    assert printed(capsys, "models", "any-length") == {
        key: value for key, value in cards["any-length"].items() if key != "name"
    }


@pytest.mark.slow
def test_speeds_are_json_with_one_entry_for_each_length_and_part(capsys):
    content = printed(capsys, "bench", "--lengths", "2", "--envs", "2", "--world", "current")
    assert content["envs"] == 2 and {row["length"] for row in content["measurements"]} == {2}
    assert content["world"] == "current" and len(content["measurements"]) == 2
    assert all(row["steps_per_second"] > 0 for row in content["measurements"])


def test_an_evaluation_is_json_as_in_its_file(tmp_path, capsys):
    words = "evaluate", "greedy", "--lengths", "2", "--trials", "1", "--out", str(tmp_path)
    content = printed(capsys, *words)
    assert content == json.loads((tmp_path / "evaluation.json").read_text())


# What is typed, the last word being completed, and what is offered for it.
TYPED = {
    "salpchain ev": ["evaluate"],
    "salpchain train --s": ["--seed", "--set", "--steps"],
    "salpchain evaluate any-length --time-limit s": ["scaled"],
    "salpchain evaluate any-length --q": ["--quiet"],
    "salpchain train --out ru": ["runs"],
}
TAB = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _tyro_salpchain; printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(tmp_path, capsys):
    assert run(["completion", "bash"]) == 0
    (tmp_path / "script").write_text(capsys.readouterr().out)
    (tmp_path / "runs").mkdir()
    return tmp_path / "script"


@pytest.mark.parametrize("line", TYPED)
def test_bash_completes_commands_options_choices_and_files(line, script):
    command = ["bash", "-c", TAB, "bash", str(script), *line.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=script.parent)
    assert sorted(done.stdout.split()) == TYPED[line] and done.stderr == ""


def test_bash_offers_files_where_no_name_fits(script):
    assert "complete -o default -F" in script.read_text()
    command = ["bash", "-c", TAB, "bash", str(script), "salpchain", "evaluate", "ru"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_script_names_every_command_and_option_and_starts_no_salpchain(shell, capsys):
    assert run(["completion", shell]) == 0
    text = capsys.readouterr().out
    names = re.search(r"COMPLETION_SPEC = (.*)", text)
    assert names is not None and "\\n" not in names[1]
    for command in COMMANDS:
        assert run([command, "--help"]) == 0
        for option in re.findall(r"│ (--[\w-]+)", capsys.readouterr().out):
            assert option in names[1], (command, option)
        assert f"'{command}'" in names[1]
    assert "-m salpchain" not in text and "import salpchain" not in text
    fallback = {"bash": "-o default", "zsh": '-z "$completions" ||', "fish": "complete --command"}
    assert fallback[shell] in text


def test_another_shell_is_refused(capsys):
    assert run(["completion", "tcsh"]) == 2
    assert "choose one of bash, zsh, fish" in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_the_line_of_usage_says_what_the_page_explains(command, capsys):
    assert run([command, "--help"]) == 0
    first, _, rest = capsys.readouterr().out.partition("\n\n")
    assert first == f"usage: salpchain {command} {USAGE[command]}"
    words = set(re.findall(r"--[a-z]+|[A-Z_]{4,}", USAGE[command])) - {"OPTIONS", "PATH", "VALUE"}
    assert [word for word in words if word not in rest] == []


@pytest.mark.slow
def test_what_is_piped_has_no_colours(tmp_path):
    words = ["evaluate", "greedy", "--lengths", "2", "--trials", "1", "--out", str(tmp_path)]
    for command in (["train", "--help"], ["models"], words):
        done = subprocess.run(
            [sys.executable, "-m", "salpchain", *command], capture_output=True, check=True
        )
        assert b"\x1b" not in done.stdout + done.stderr
