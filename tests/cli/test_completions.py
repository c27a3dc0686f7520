"""`simwarp completions`: what the shells themselves make of the scripts, and that they know what commands take."""

import json
import shutil
import subprocess
import sys

import pytest

from scripts import completion_words
from simwarp import cli
from simwarp.cli.options import unknown_option

SHELLS = list(completion_words.SHELLS)


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    """Folder with the script of each shell."""
    folder = tmp_path_factory.mktemp("scripts")
    for shell in SHELLS:
        command = [sys.executable, "-m", "simwarp", "completions", shell]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        (folder / shell).write_text(done.stdout, encoding="utf-8")
    return folder


def completed(scripts, shell, line):
    """The words that a shell offers at the end of a line."""
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    script = scripts / shell
    parts = line.split(" ")
    if shell == "fish":
        words = ["--no-config", "-c", f"source {script}; complete --do-complete '{line}'"]
    elif shell == "bash":
        code = (
            f'source {script}; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _simwarp; printf "%s\\n" "${{COMPREPLY[@]}}"'
        )
        words = ["--norc", "-c", code, "bash", *parts]
    else:  # what zsh adds is printed in the place of its menu
        code = "compdef() {}; compadd() { shift; print -l -- $@ }; _files() {}; "
        code += f'source {script}; words=("$@"); CURRENT=$#; _simwarp'
        words = ["-f", "-c", code, "zsh", *parts]
    done = subprocess.run([shell, *words], capture_output=True, text=True, check=True, timeout=60)
    return {word.split("\t")[0] for word in done.stdout.split("\n") if word.startswith(parts[-1])} - {""}


@pytest.mark.parametrize("shell", SHELLS)
def test_commands_tasks_and_options_are_completed(scripts, shell):
    assert {"train", "trim"} <= completed(scripts, shell, "simwarp tr")
    assert completed(scripts, shell, "simwarp train pend") == {"pendulum"}
    assert "hmmwv" in completed(scripts, shell, "simwarp drive hm")
    assert "pendulum" not in completed(scripts, shell, "simwarp drive ")
    assert {"--num-envs", "--network.kind"} <= completed(scripts, shell, "simwarp train pendulum --n")
    assert "--task.hills" in completed(scripts, shell, "simwarp play off-road --task.h")
    assert "--task.hills" not in completed(scripts, shell, "simwarp play pendulum --task.h")
    assert completed(scripts, shell, "simwarp completions z") == {"zsh"}


def test_the_words_are_those_of_the_commands():
    made = completion_words.text(completion_words.completions())
    assert made == completion_words.FILE.read_text(encoding="utf-8"), "python -m scripts.completion_words writes them"


def test_every_command_is_there_and_its_options_are_known():
    content = json.loads(completion_words.FILE.read_text(encoding="utf-8"))
    assert list(content["commands"]) == list(cli.COMMANDS)
    for name, entry in content["commands"].items():
        assert entry["options"], name
    assert "did you mean --num-envs" in unknown_option("--num-env", content["commands"]["train"]["options"])


def test_neither_torch_nor_warp_is_imported():
    code = "import sys; from simwarp.cli import main; main(['completions', 'bash']); "
    code += "print({'torch', 'warp', 'numpy', 'tyro'} & set(sys.modules), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "set()"
    assert done.stdout.startswith("# Completion")


@pytest.mark.parametrize("words", [[], ["tcsh"], ["bash", "zsh"]])
def test_another_shell_is_one_line(words, capsys):
    assert cli.main(["completions", *words]) == cli.WRONG_INPUT
    error = capsys.readouterr().err
    assert error.startswith("simwarp: usage: simwarp completions bash|zsh|fish")
    assert error.count("\n") == 1


def test_help_names_where_scripts_go(capsys):
    assert cli.main(["completions", "--help"]) == cli.DONE
    assert "~/.config/fish/completions" in capsys.readouterr().out
