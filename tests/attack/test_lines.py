"""Bad command lines: one line that says what is wrong, status 2, no traceback, no hang, nothing left."""

import os

from tests.attack.lines import BAD_NUMBERS, MISSING, ODD_NUMBERS, file_lines, number_lines, word_lines
from tests.samples import sample

SAMPLE = int(os.environ.get("HOTICE_ATTACK_LINES", "170"))
"""Lines of each of the two large tables, others in each run; those with bad words are run all."""


def test_bad_files(attack, bad):
    attack(sample(file_lines(bad), SAMPLE))


def test_bad_numbers(attack):
    """Each is refused for the number, not for what else is wrong with the line."""
    attack(sample(number_lines(BAD_NUMBERS), SAMPLE), unsaid=MISSING)


def test_odd_numbers(attack):
    attack(sample(number_lines(ODD_NUMBERS), SAMPLE // 5))


def test_bad_words(attack):
    attack(word_lines())


def test_there_are_enough(bad):
    assert 2 * SAMPLE + len(list(word_lines())) >= 300
    assert len(list(file_lines(bad))) > 400 and len(list(number_lines(BAD_NUMBERS))) > 1000


def test_the_shell_tells_what_is_wrong(shell, tmp_path):
    """A traceback, a hang, an end without a word and a file that is left are all seen."""
    assert shell(["load:nonsense", "x"], tmp_path).faults() == ["status 1", "a traceback"]
    assert shell(["tables"], tmp_path).faults() == ["status 0"]
    assert shell(["scene", "show", "gap", "--html", "left.html"], tmp_path).faults((0,)) == []
    assert shell(["scene", "show", "gap", "--port", "0"], tmp_path, limit_s=2.0).status is None
    assert shell(["nope"], tmp_path).faults() == []
