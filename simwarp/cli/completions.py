"""``simwarp completions SHELL``: a script by which a shell completes commands, tasks, vehicles and options."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.resources import files
from typing import Any, Final

from simwarp.cli import DONE, HELP, UsageError, shortened

USAGE: Final = """\
usage: simwarp completions SHELL

Prints a script for bash, zsh or fish that completes commands, tasks, vehicles and options:

  bash   simwarp completions bash > ~/.local/share/bash-completion/completions/simwarp
  zsh    simwarp completions zsh > DIR/_simwarp, of a folder DIR of fpath
  fish   simwarp completions fish > ~/.config/fish/completions/simwarp.fish
"""


def run(arguments: list[str]) -> int:
    """Print the script."""
    words = [word for word in arguments if word != "--debug"]
    if HELP & set(words):
        print(USAGE, end="")
        return DONE
    if len(words) != 1 or words[0] not in SCRIPTS:
        got = f", got '{shortened(words[0])}'" if words else ""
        raise UsageError(f"usage: simwarp completions {'|'.join(SCRIPTS)}{got}")
    content = json.loads((files("simwarp") / "data" / "completions.json").read_text(encoding="utf-8"))
    print(SCRIPTS[words[0]](content), end="")
    return DONE


def _targets(content: dict[str, Any], command: str) -> str:
    """Return the words that may follow a command."""
    kinds = content["commands"][command]["words"]
    return " ".join(dict.fromkeys(word for kind in kinds for word in content["words"][kind]))


def _has_task(content: dict[str, Any], command: str) -> bool:
    return "tasks" in content["commands"][command]["words"]


def _words(content: dict[str, Any]) -> str:
    """Return the function of bash and zsh that prints what may stand at a place, from the words before it."""
    commands = content["commands"]
    targets = "\n".join(f"      {name}) echo {found} ;;" for name in commands if (found := _targets(content, name)))
    options = "\n".join(f"    {name}) echo {' '.join(entry['options'])} ;;" for name, entry in commands.items())
    tasks = "\n".join(f"    {name}) echo {' '.join(entry)} ;;" for name, entry in content["tasks"].items())
    taking = "|".join(name for name in commands if _has_task(content, name))
    return f"""\
_simwarp_words() {{
  # number of the word, command, target, beginning of the word
  if [ "$1" -eq 1 ]; then echo {" ".join(commands)} --help --version; return; fi
  case "$4" in -*) ;; *)
    [ "$1" -eq 2 ] && case "$2" in
{targets}
    esac
    return ;;
  esac
  case "$2" in
{options}
  esac
  case "$2" in {taking}) ;; *) return ;; esac
  case "$3" in
{tasks}
  esac
}}
"""


def _bash(content: dict[str, Any]) -> str:
    return f"""\
# Completion of simwarp for bash
{_words(content)}
_simwarp() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}"
  local words="$(_simwarp_words "$COMP_CWORD" "${{COMP_WORDS[1]}}" "${{COMP_WORDS[2]}}" "$current")"
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _simwarp simwarp
"""


def _zsh(content: dict[str, Any]) -> str:
    return f"""\
#compdef simwarp
# Completion of simwarp for zsh
{_words(content)}
_simwarp() {{
  local -a found
  found=(${{=$(_simwarp_words "$((CURRENT - 1))" "$words[2]" "$words[3]" "$words[CURRENT]")}})
  compadd -- $found || _files
}}
if [ "$funcstack[1]" = "_simwarp" ]; then _simwarp "$@"; else compdef _simwarp simwarp; fi
"""


def _fish(content: dict[str, Any]) -> str:
    commands = content["commands"]
    lines = ["# Completion of simwarp for fish"]
    first = "test (count (commandline -opc)) -eq 1"
    lines += [f"complete -c simwarp -n '{first}' -f -a '{' '.join(commands)}'"]
    lines += [f"complete -c simwarp -n '{first}' -l {option}" for option in ("help", "version")]
    for name, entry in commands.items():
        after = f"__fish_seen_subcommand_from {name}"
        if found := _targets(content, name):
            lines.append(f"complete -c simwarp -n '{after}; and test (count (commandline -opc)) -eq 2' -a '{found}'")
        lines += [f"complete -c simwarp -n '{after}' -l {option[2:]}" for option in entry["options"]]
    taking = " ".join(name for name in commands if _has_task(content, name))
    for task, options in content["tasks"].items():
        after = f"__fish_seen_subcommand_from {taking}; and __fish_seen_subcommand_from {task}"
        lines += [f"complete -c simwarp -n '{after}' -l {option[2:]}" for option in options]
    return "\n".join(lines) + "\n"


SCRIPTS: Final[dict[str, Callable[[dict[str, Any]], str]]] = {"bash": _bash, "zsh": _zsh, "fish": _fish}
"""Shell -> function that writes its script."""
