import subprocess
import sys

import pytest

from salpchain.errors import InputError
from salpchain.evaluation.config import lengths_as_text, list_lengths, parse_lengths

GOOD = {
    "8": [8],
    " 8 ": [8],
    "4,8,16": [4, 8, 16],
    "16, 4,8 ,8": [4, 8, 16],
    "4:64:4": list(range(4, 65, 4)),
    "4:10:4": [4, 8],
    "5:5:1": [5],
    "4:8:2,64,512": [4, 6, 8, 64, 512],
    "2": [2],
    "4..8": [4, 5, 6, 7, 8],
    "2, 4..6": [2, 4, 5, 6],
}
BAD = {
    "": "a number is missing",
    ",": "a number is missing",
    "4,,8": "a number is missing",
    "64:4": "three numbers",
    "4:64": "three numbers",
    "4:64:4:2": "three numbers",
    "64:4:4": "backwards",
    "16..4": "backwards",
    "4..": "a number is missing",
    "4...8": "not a whole number",
    "4:64:0": "step must be positive",
    "4:64:-4": "step must be positive",
    "1": "2 to 1024",
    "0:8:4": "2 to 1024",
    "-4": "2 to 1024",
    "1025": "2 to 1024",
    "4:100000000000:1": "2 to 1024",
    "eight": "not a whole number",
    "8.0": "not a whole number",
    "4:x:4": "not a whole number",
    "²": "not a whole number",
    "--4": "not a whole number",
    "4;8": "not a whole number",
}


@pytest.mark.parametrize("text", GOOD)
def test_lengths_are_read_ascending_and_each_once(text):
    assert parse_lengths(text) == GOOD[text]


def test_lengths_can_be_had_as_typed():
    assert list_lengths("16, 4..6 ,5") == [16, 4, 5, 6, 5]


@pytest.mark.parametrize("text", ["8", "4,5", "4..6", "4,5,7", "4,8,16"])
def test_lengths_are_written_as_one_types_them(text):
    assert lengths_as_text(parse_lengths(text)) == text


@pytest.mark.parametrize("text", BAD)
def test_nonsense_is_refused_in_one_line_that_repeats_it_and_says_why(text):
    with pytest.raises(InputError) as caught:
        parse_lengths(text)
    message = str(caught.value)
    assert repr(text) in message and BAD[text] in message
    assert "\n" not in message


def test_reading_lengths_loads_neither_jax_nor_pandas():
    code = (
        "import sys, salpchain.evaluation.config;"
        "sys.exit(any(name in sys.modules for name in ('jax', 'pandas', 'scipy')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
