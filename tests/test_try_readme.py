"""The tool that types what the README says."""

import subprocess

import pytest

from tools import try_readme

TEXT = """
```sh
make demo PIP_ARGS="--x y"    # says something
source .venv/bin/activate
hotice evaluate --policy student --scenes bench20 --rollouts 4 --seed 1
hotice play --view --scene beam    # until Ctrl-C
hotice play --scene beam
```

```python
print("a snippet")
```
"""


def test_every_block_is_typed_with_small_numbers(tmp_path):
    text = try_readme.script(TEXT, tmp_path / "venv", tmp_path)
    typed = [line for line in text.splitlines() if not line.startswith("echo")]
    assert typed[-5:] == [
        'make demo PIP_ARGS="--x y"',
        "hotice evaluate --policy student --scenes gap --rollouts 1 --objects 1 --threads 1 --seed 1",
        "timeout --signal INT 20 hotice play --view --scene beam || [ $? = 124 ]",
        "hotice play --scene beam --rollouts 1",
        "python block2.py",
    ]
    assert (tmp_path / "block2.py").read_text() == 'print("a snippet")\n'


def test_the_first_failure_ends_it(tmp_path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "activate").write_text("")
    text = try_readme.script("```sh\necho one\nfalse\necho two\n```\n", tmp_path, tmp_path)
    done = subprocess.run(["bash", "-c", text], capture_output=True, text=True)
    assert done.returncode == 1 and "one" in done.stdout.split() and "two" not in done.stdout


def test_a_block_that_cannot_be_run_is_an_error():
    with pytest.raises(ValueError, match="a block of yaml"):
        list(try_readme.blocks("```yaml\na: 1\n```\n"))


def test_the_readme_can_be_typed_and_says_nothing_long(tmp_path):
    text = try_readme.script(try_readme.README.read_text(encoding="utf-8"), tmp_path, tmp_path)
    assert "hotice --help" in text and "--max-minutes 10" not in text and "bench20" not in text.replace("$ ", "")
